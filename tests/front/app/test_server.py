"""The app's server: who is answered, what it may write, and that paths stay inside the
folder.
"""

import json
import os
import shutil
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from running_app import Client, running_app
from small_recordings import (
    COLUMNS,
    ROWS,
    calibration_text,
    evaluation_of,
    frame_answer,
    write_small_recording,
)
from waiting import FUSE_S, wait_until

import scleraforce as sf
from scleraforce.base.kept_results import keep_result
from scleraforce.front.app.app_server import HOST
from scleraforce.front.app.request_end import RequestEndedError, check_wanted
from scleraforce.recordings.drawn_walls import RecordedWalls, write_wall
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.remark import Remark


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("app") / "root"
    write_small_recording(root / "small", frames=4)
    write_small_recording(root.parent / "outside", frames=1)
    (root / "link").symlink_to(root.parent / "outside")
    (root / "log.csv").write_text("time_s,fz_n\n0,0\n1,0\n")

    for name in ("stack", "empty"):
        (root / name).mkdir()

    (root / "stack" / "log.csv").write_text("time_s,fz_n\n")
    (root / "notes.xyz").write_bytes(b"\x01\x02 nothing that is read")
    return root


@pytest.fixture(scope="module")
def app(folder: Path) -> Iterator[Client]:
    with running_app(folder) as client:
        yield client.open()


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A recording of two frames in the folder of the test's own app."""
    return write_small_recording(tmp_path / "small", frames=2)


def refusal(
    app: Client, method: str, path: str, body: Any = None, **headers: str
) -> tuple[int, str]:
    status, text, _ = app.ask(method, path, body, **headers)
    return status, text.decode()


@contextmanager
def begun(app: Client, line: str, **headers: object) -> Iterator[socket.socket]:
    """Send the head of a request, with this first line."""
    lines = [f"{line} HTTP/1.1", f"Host: {HOST}:{app.port}"]
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    with socket.create_connection((HOST, app.port)) as link:
        link.sendall("\r\n".join([*lines, "", ""]).encode())
        yield link


FRAME = "name=small&file=0000.png"


def test_the_token_is_exchanged_for_a_cookie_that_scripts_and_other_sites_do_not_get(
    app: Client,
) -> None:
    status, _, headers = app.ask("GET", f"/?token={'t' * 32}", Cookie="")
    assert (status, headers["location"]) == (303, "/")
    parts = {part.strip().lower() for part in headers["set-cookie"].split(";")}
    assert {"httponly", "samesite=strict"} <= parts
    assert "t" * 32 not in headers["set-cookie"]
    # apps on two ports are open at once
    assert headers["set-cookie"].startswith(f"scleraforce-{app.port}=")


@pytest.mark.parametrize(
    "path", ["/", "/main.js", "/api/state", "/?token=wrong", f"/api/frame?{FRAME}"]
)
def test_nothing_is_answered_without_the_cookie(app: Client, path: str) -> None:
    for cookie in ("", f"{app.cookie}x"):
        assert refusal(app, "GET", path, Cookie=cookie)[0] == 403


def test_other_hosts_and_origins_are_refused(app: Client) -> None:
    assert refusal(app, "GET", "/api/state", Host="evil.example")[0] == 403
    for origin in ("http://evil.example", ""):
        assert refusal(app, "DELETE", "/api/run", Origin=origin)[0] == 403
    assert refusal(app, "DELETE", "/api/run")[0] == 200


def test_one_tab_writes_until_it_is_silent(
    served: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr("scleraforce.front.app.app_server.monotonic", lambda: now_s[0])

    def writes(tab: str, after_s: float = 0.0) -> bool:
        now_s[0] += after_s
        return served.json("GET", f"/api/state?tab={tab}")["writes"]

    assert writes("tab-1")
    assert not writes("tab-2")
    status, text = refusal(served, "DELETE", "/api/run", X_Tab="tab-2")
    assert (status, "another tab" in text) == (409, True)
    assert refusal(served, "DELETE", "/api/run", X_Tab="")[0] == 409
    assert not writes("tab-2", 5.0)
    assert writes("tab-2", 2.0)
    assert not writes("tab-1")


def test_the_token_of_the_opened_browser_is_valid_once(folder: Path) -> None:
    with running_app(folder, once="o" * 32) as client:
        for letter, statuses in (("o", [303, 403]), ("t", [303, 303])):
            path = f"/?token={letter * 32}"
            assert [client.ask("GET", path)[0] for _ in range(2)] == statuses


def test_the_folder_is_listed_and_files_that_cannot_be_read_say_why(
    app: Client,
) -> None:
    state = app.json("GET", "/api/state")
    assert [entry["name"] for entry in state["recordings"]] == ["small"]
    sources = {entry["name"]: entry for entry in state["sources"]}
    assert sources["log.csv"]["kind"] == "log"
    assert "of no kind that is read" in sources["notes.xyz"]["fault"]
    assert sources["stack"]["kind"] == "folder of log files"
    assert "empty" not in sources


def test_a_table_of_times_is_told_from_a_force_log(
    served: Client, tmp_path: Path
) -> None:
    tables = {
        "times": (
            "file,time_s,pierced\n0001.png,1,0\n0002.png,2,0\n",
            "index,time_s\n0,1\n1,2\n",
            "frame,date\n1,2026-05-31 10:00:00\n2,2026-05-31 10:00:01\n",
            "time_s\n1\n2\n",
        ),
        "log": (
            "frame,time_s,pull\n1,1,4\n2,2,5\n",
            "clock,pull\n1,4\n2,5\n",
            "file,time_s,fz_n\na.png,1,4\nb.png,2,5\n",
        ),
    }
    for kind, texts in tables.items():
        for number, text in enumerate(texts):
            (tmp_path / f"{kind}{number}.csv").write_text(text)
    for entry in served.json("GET", "/api/state")["sources"]:
        assert entry["kind"] == entry["name"][:-5], entry


def test_entries_that_change_or_cannot_be_read_are_listed_as_they_are_now(
    served: Client, small: Path, tmp_path: Path
) -> None:
    info = small / "recording.toml"
    (tmp_path / "loop").symlink_to("loop")
    for name in ("small", "another"):
        info.write_text(info.read_text().replace("'small'", f"'{name}'"))
        listed = served.json("GET", "/api/state")["recordings"]
        assert listed == [{"name": "small", "eye": name}]


@pytest.mark.parametrize(
    "name",
    ["..", "../outside", "link", "/etc", "small/../../outside", "\0", "x" * 5000, ""],
)
def test_paths_that_lead_out_are_refused(app: Client, name: str) -> None:
    run = {"command": "evaluate", "operands": ["default", name]}
    for method, path, body in (
        ("GET", f"/api/recording?name={quote(name)}", None),
        ("POST", "/api/sources", {"operands": [name]}),
        ("POST", "/api/run", run),
        ("GET", f"/api/result?command={quote(name)}", None),
    ):
        assert refusal(app, method, path, body)[0] == 422


def test_a_recording_is_summed_up_and_its_frames_are_pictures(
    app: Client, tmp_path: Path
) -> None:
    found = app.json("GET", "/api/recording?name=small")
    assert (found["rows"], found["columns"]) == (ROWS, COLUMNS)
    assert found["files"][0] == "0000.png"
    _, text, headers = app.ask("GET", f"/api/frame?{FRAME}&height=12")
    assert headers["content-type"] == "image/png"
    (tmp_path / "small.png").write_bytes(text)
    assert sf.read_frame(tmp_path / "small.png").shape == (12, 16)
    path = "/api/frame?name=small&file=../../recording.toml"
    assert refusal(app, "GET", path)[0] == 422


def test_a_dropped_file_is_kept_once_and_whole(app: Client, folder: Path) -> None:
    data = b"time_s,fz_n\n0,0\n1,0\n" * 3
    path = "/api/source?name="
    sources = folder / "sources"
    assert app.json("PUT", f"{path}push.csv", data) == {"name": "sources/push.csv"}
    assert (sources / "push.csv").read_bytes() == data
    status, text = refusal(app, "PUT", f"{path}push.csv", b"other")
    assert (status, text) == (422, "push.csv: exists already; choose another name")

    for name in ("../out.csv", ".hidden", "a/b.csv", ""):
        assert refusal(app, "PUT", f"{path}{name}", data)[0] == 422
    assert refusal(app, "PUT", f"{path}empty.csv", b"")[0] == 422

    def drop(number: int) -> int:
        return refusal(app, "PUT", f"{path}twice.csv", b"%d" % number)[0]

    with ThreadPoolExecutor() as pool:
        assert sorted(pool.map(drop, range(6))) == [200] + [422] * 5

    head = {"Origin": f"http://{HOST}:{app.port}", "X_Tab": app.tab}
    head |= {"Cookie": app.cookie, "Content_Length": 1000}
    with begun(app, f"PUT {path}cut.csv", **head) as link:  # and breaks off
        link.sendall(b"time_s")
        wait_until(lambda: any(name.endswith(".part") for name in os.listdir(sources)))

    wait_until(lambda: sorted(os.listdir(sources)) == ["push.csv", "twice.csv"])


@pytest.mark.parametrize(
    ("length", "status"),
    [
        ({"Transfer_Encoding": "chunked"}, 411),
        ({"Transfer_Encoding": "Chunked", "Content_Length": 2}, 411),
        ({"Content_Length": "000000000100000000"}, 413),
        ({"Content_Length": 100000000}, 413),
    ],
)
@pytest.mark.parametrize("path", ["/api/words", "/api/source?name=a.csv"])
def test_a_body_of_no_stated_or_too_large_a_size_is_refused_before_the_token(
    app: Client, length: dict[str, object], status: int, path: str
) -> None:
    if path.startswith("/api/source") and length == {"Content_Length": 100000000}:
        status = 403  # a file may have this size, but nothing of it is taken
    origin = f"http://{HOST}:{app.port}"
    with (
        begun(app, f"POST {path}", Origin=origin, **length) as link,
        link.makefile("rb") as answer,
    ):
        assert int(answer.readline().split()[1]) == status


WALL = {"outer": [4.3] * COLUMNS, "inner": [9.6] * COLUMNS, "unseen": []}


def test_links_out_of_the_folder_are_neither_read_nor_written(
    app: Client, folder: Path, tmp_path: Path
) -> None:
    outside = write_small_recording(tmp_path / "outside", frames=2)
    linked = write_small_recording(folder / "linked", frames=2)
    (linked / "walls").symlink_to(tmp_path)
    for path in ("draft", "wall"):
        path = f"/api/{path}?name=linked&file=0000.png"
        assert refusal(app, "PUT", path, WALL)[0] == 422

    assert os.listdir(tmp_path) == ["outside"]
    (linked / "walls").unlink()
    (linked / "frames" / "0001.png").unlink()
    (linked / "frames" / "0001.png").symlink_to(outside / "frames" / "0001.png")
    run = {"command": "evaluate", "operands": ["default", "linked"]}
    for method, path, body in (
        ("GET", "/api/frame?name=linked&file=0001.png", None),
        ("POST", "/api/sources", {"operands": ["linked/frames"]}),
        ("POST", "/api/run", run),
    ):
        assert refusal(app, method, path, body)[0] == 422
    shutil.rmtree(linked)


@pytest.mark.parametrize(
    "change",
    [
        {"outer": [4.0], "inner": [9.0]},
        {"unseen": [COLUMNS]},
        {"outer": [float("nan")] * COLUMNS},
    ],
)
def test_a_wall_that_does_not_fit_its_frame_is_refused(
    app: Client, folder: Path, change: Any
) -> None:
    for path in ("draft", "wall"):
        path = f"/api/{path}?{FRAME}"
        assert refusal(app, "PUT", path, WALL | change)[0] == 422
    assert not (folder / "small" / "walls").exists()


def test_frames_of_one_stem_are_not_corrected(served: Client, small: Path) -> None:
    (small / "frames" / "0001.png").rename(small / "frames" / "0000.tif")
    table = small / "frames.csv"
    table.write_text(table.read_text().replace("0001.png", "0000.tif"))
    status, text = refusal(served, "PUT", "/api/wall?name=small&file=0000.tif", WALL)
    words = "walls/0000.png would be the wall of 0000.png too"
    assert (status, words in text) == (422, True)


def test_a_wall_that_is_accepted_is_a_mask_until_it_is_removed(
    served: Client, small: Path
) -> None:
    path = f"/api/wall?{FRAME}"
    wall = {**WALL, "inner": [*WALL["inner"][1:], None], "unseen": [0, 1]}
    served.json("PUT", f"/api/draft?{FRAME}", WALL)
    accepted = served.json("PUT", path, wall)
    assert accepted["wall"]["source"] == "corrected"
    assert accepted["draft"] is None
    mask = RecordedWalls(small).wall("0000.png")
    assert (mask[:, 0] == 128).all()
    assert np.flatnonzero(mask[:, 5] == 255).tolist() == [5, 6, 7, 8, 9]
    # an inner boundary that is not seen
    assert np.flatnonzero(mask[:, -1] == 255)[-1] == ROWS - 1
    assert RecordedWalls(small).wall("0001.png") is None
    assert served.json("DELETE", path)["wall"]["source"] != "corrected"
    assert RecordedWalls(small).wall("0000.png") is None


def test_walls_of_the_users_own_keep_counting_when_the_app_adds_one(
    served: Client, small: Path
) -> None:
    mask = np.zeros((ROWS, COLUMNS), np.uint8)
    mask[5:9] = 255
    write_wall(small, "0001.png", mask, "me", "")
    (small / "walls.csv").unlink()
    served.json("PUT", f"/api/wall?{FRAME}", WALL)
    walls = RecordedWalls(small)
    assert walls.wall("0000.png") is not None
    assert walls.wall("0001.png") is not None


def test_a_draft_is_kept_for_its_frame_alone(served: Client, small: Path) -> None:

    def draft(file: str) -> Any:
        return served.json("GET", f"/api/look?name=small&file={file}")["draft"]

    served.json("PUT", f"/api/draft?{FRAME}", WALL)
    assert draft("0000.png") == WALL
    assert draft("0001.png") is None
    (small / "walls" / ".0001.draft.json").write_text('{"outer": [NaN')
    assert draft("0001.png") is None
    for file in ("0000.png", "0001.png"):
        served.json("DELETE", f"/api/wall?name=small&file={file}")
    assert os.listdir(small / "walls") == []
    served.json("PUT", f"/api/draft?{FRAME}", WALL)
    frames = small / "frames"
    shutil.copy(frames / "0001.png", frames / "0000.png")
    assert draft("0000.png") is None


@pytest.mark.parametrize(
    ("operands", "answers"),
    [
        (["log.csv"], {"bits": "abc"}),
        (["log.csv"], {"bits": 1.5}),
        (["log.csv"], {"bits": True}),
        (["log.csv"], {"width_mm": float("nan")}),
        (["log.csv"], {"secret": 1}),
        ([], {}),
    ],
)
def test_answers_of_another_name_or_type_are_refused(
    app: Client, operands: list[str], answers: Any
) -> None:
    asked = {"operands": operands, "options": answers}
    status, text = refusal(app, "POST", "/api/sources", asked)
    named = {*text.partition(":")[0].split(".")}
    assert (status, named >= {*answers}) == (422, True)


def test_commands_are_shown_as_they_would_be_typed(app: Client) -> None:
    run = {
        "command": "import",
        "operands": ["small", "log.csv"],
        "out": "an eye",
        "planes": {"small": "across:0:90"},
        "options": {"clock_offset_s": 1764325500.125},
    }
    words = "log.csv --plane=across:0:90 small --clock-offset-s=1764325500.125"
    command = app.json("POST", "/api/words", run)["command"]
    assert command == f"scleraforce import {words} '--out=an eye'"


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"command": "monitor"}, "not a command of the app"),
        ({"options": {"study": "x.toml"}}, "not an option of calibrate"),
        ({"out": "small"}, "exists already"),
        ({"out": "../e.json"}, "plain name"),
        ({"operands": ["missing"]}, "does not exist"),
        ({"options": {"frames": 0}}, "--frames: 0; give at least 1"),
        ({"options": {"frames": 1.5}}, "--frames: Expected `int"),
        ({"options": {"thickness_um": 0.65}}, "mean 650 µm"),
        ({"options": {"without_force": 1}}, "--without-force: Expected `bool"),
    ],
)
def test_other_commands_options_and_existing_files_are_refused(
    app: Client, change: Any, fault: str
) -> None:
    run = {"command": "calibrate", "operands": ["small"], "out": "e.json", **change}
    assert fault in app.json("POST", "/api/words", run)["fault"]
    assert refusal(app, "POST", "/api/run", run)[0] == 422


def test_the_state_says_with_what_frames_were_last_read_and_the_table_has_times(
    served: Client, small: Path
) -> None:
    evaluation = evaluation_of([frame_answer(recording="small", file="0000.png")])
    reading = {"model": "default", "calibration": "e.json", "recordings": ["small"]}
    rows = [{"file": "0000.png", "time_s": 1.5}]
    kept = {"command": "x", "time_utc": "y", "result": evaluation.to_dict()}
    kept_place = small.parent / ".scleraforce" / "evaluate.kept"
    kept_place.parent.mkdir()
    for more in (None, {}, {**reading, "rows": rows}):
        if more is not None:  # {}: of a version that kept no rows
            keep_result(kept | more, kept_place)
        read = served.json("GET", "/api/state")["read"]
        if more:
            assert read == reading
            text = served.json("GET", "/api/csv")["text"]
            assert text == "file,time_s\n0000.png,1.5\n"
        else:
            assert read is None
            assert served.json("GET", "/api/result?command=evaluate") is None
            assert refusal(served, "GET", "/api/csv")[0] == 422


@pytest.mark.parametrize(
    ("query", "fault"),
    [
        ("calibration=../e.json", "leads out"),
        ("calibration=link", "leads out"),
        ("calibration=missing.json", "missing.json: No such file"),
        ("model=../outside", "leads out"),
        ("model=./small", "model.json"),
    ],
)
def test_frames_are_looked_at_with_calibrations_and_models_of_the_folder_alone(
    app: Client, query: str, fault: str
) -> None:
    status, text = refusal(app, "GET", f"/api/look?{FRAME}&{query}")
    assert (status, fault in text) == (422, True), text


def test_a_frame_is_read_with_the_calibration_of_its_eye_or_a_model_of_the_folder(
    folder: Path, app: Client
) -> None:
    shutil.copytree(SHIPPED_READER, folder / "reader")
    calibration = folder / "e.json"
    calibration.write_text(calibration_text(0.3, {"another": {}}))
    asked = "&calibration=e.json"
    said = app.json("GET", f"/api/look?{FRAME}{asked}")["answer"]["warnings"]
    assert any("e.json" in warning and "small" in warning for warning in said)
    assert not any(str(folder) in warning for warning in said)
    calibration.write_text(calibration_text(0.3, {"small": {}}))
    for query, words, model in (
        ("", "default", "default"),
        (asked, "default --calibration=e.json", "default"),
        ("&model=./reader", "./reader", "reader"),
    ):
        found = app.json("GET", f"/api/look?{FRAME}{query}")
        frame = "small/frames/0000.png"
        assert found["command"] == f"scleraforce read {words} {frame}"
        assert found["answer"]["model"] == model
        assert found["calibration"] == ("e.json" if query == asked else "")
    calibration.unlink()
    shutil.rmtree(folder / "reader")


def test_what_an_import_remarked_stays_with_its_recording(
    served: Client, small: Path
) -> None:
    remark = Remark("clock-found", "clock offset 0 s", ("clock_offset_s",)).to_dict()
    for text, imported in (
        (json.dumps({"remarks": [remark]}), [remark]),
        ("damaged", []),
    ):
        (small / "import.json").write_text(text)
        found = served.json("GET", "/api/recording?name=small")
        assert found["imported"] == imported
    assert "import.json" in found["notes"][0]


def has_ended() -> bool:
    try:
        check_wanted()
    except RequestEndedError:
        return True
    return False


def test_work_ends_with_its_request(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page closes the connection while the first of many entries is looked at."""
    began = Event()
    gone = Event()
    looked_at = list[Path]()

    def look(path: Path, _: object) -> tuple[str, dict[str, str]]:
        began.set()
        assert gone.wait(FUSE_S)
        if not looked_at:
            wait_until(has_ended)
        looked_at.append(path)
        return "", {}

    monkeypatch.setattr("scleraforce.front.app.work_folder._entry", look)
    with running_app(folder) as client:
        client.open()
        with begun(client, "GET /api/state", Cookie=client.cookie):
            assert began.wait(FUSE_S)

        gone.set()
        wait_until(lambda: looked_at != [])
        client.json("GET", "/api/state")  # others are served as before
        entries = looked_at[1:]
        assert looked_at[0] == entries[0]
        assert 2 < len(entries) == len(set(entries))
