"""The app's server: who is answered, what it may write, and that paths stay inside the
folder.
"""

import json
import os
import shutil
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
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

from scleraforce.base.errors import InputError
from scleraforce.base.kept_results import keep_result
from scleraforce.front.app.app_server import HOST, RESULTS, Holder
from scleraforce.front.app.recording_views import (
    RecordingViews,
    mask_between,
    read_draft,
    remove_draft,
    write_draft,
)
from scleraforce.front.app.request_end import RequestEndedError, check_wanted
from scleraforce.front.app.work_folder import Folder
from scleraforce.recordings.drawn_walls import RecordedWalls, remove_wall, write_wall
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.recording_folder import check_alone, read_recording
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


def refusal(
    app: Client, method: str, path: str, body: Any = None, **headers: str
) -> tuple[int, str]:
    status, text, _ = app.ask(method, path, body, **headers)
    return status, text.decode()


def test_the_token_is_exchanged_for_a_cookie_that_scripts_and_other_sites_do_not_get(
    app: Client,
) -> None:
    status, _, headers = app.ask("GET", f"/?token={'t' * 32}", Cookie="")
    assert (status, headers["location"]) == (303, "/")
    assert {"httponly", "samesite=strict"} <= {
        part.strip().lower() for part in headers["set-cookie"].split(";")
    }
    assert "t" * 32 not in headers["set-cookie"]
    # apps on two ports are open at once
    assert headers["set-cookie"].startswith(f"scleraforce-{app.port}=")


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/main.js",
        "/api/state",
        "/?token=wrong",
        "/api/frame?name=small&file=0000.png",
    ],
)
def test_nothing_is_answered_without_the_cookie(app: Client, path: str) -> None:
    assert refusal(app, "GET", path, Cookie="")[0] == 403
    assert refusal(app, "GET", path, Cookie=app.cookie + "x")[0] == 403


def test_other_hosts_and_origins_are_refused(app: Client) -> None:
    assert refusal(app, "GET", "/api/state", Host="evil.example")[0] == 403
    assert refusal(app, "DELETE", "/api/run", Origin="http://evil.example")[0] == 403
    assert refusal(app, "DELETE", "/api/run", Origin="")[0] == 403
    assert refusal(app, "DELETE", "/api/run")[0] == 200


def test_a_second_tab_reads_and_does_not_write(app: Client) -> None:
    assert app.json("GET", "/api/state?tab=tab-1")["writes"]
    assert not app.json("GET", "/api/state?tab=tab-2")["writes"]
    status, text = refusal(app, "DELETE", "/api/run", X_Tab="tab-2")
    assert (status, "another tab" in text) == (409, True)
    assert refusal(app, "DELETE", "/api/run", X_Tab="")[0] == 409


def test_a_tab_that_is_silent_loses_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    monkeypatch.setattr("scleraforce.front.app.app_server.monotonic", lambda: now_s[0])
    holder = Holder()
    assert holder.is_held_by("a")
    now_s[0] += 5.0
    assert not holder.is_held_by("b")
    now_s[0] += 2.0
    assert holder.is_held_by("b")
    assert not holder.is_held_by("a")


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


@pytest.mark.parametrize(
    "name",
    ["..", "../outside", "link", "/etc", "small/../../outside", "\0", "x" * 5000, ""],
)
def test_paths_that_lead_out_are_refused(app: Client, name: str) -> None:
    assert refusal(app, "GET", f"/api/recording?name={quote(name)}")[0] == 422
    assert refusal(app, "POST", "/api/sources", {"operands": [name]})[0] == 422
    run = {"command": "evaluate", "operands": ["default", name]}
    assert refusal(app, "POST", "/api/run", run)[0] == 422


def test_a_recording_is_summed_up_and_its_frames_are_pictures(
    app: Client, folder: Path
) -> None:
    found = app.json("GET", "/api/recording?name=small")
    assert (found["rows"], found["columns"], found["files"][0]) == (
        ROWS,
        COLUMNS,
        "0000.png",
    )
    _, text, headers = app.ask("GET", "/api/frame?name=small&file=0000.png&height=12")
    assert headers["content-type"] == "image/png"
    (folder / "small.png").write_bytes(text)
    assert read_frame(folder / "small.png").shape == (12, 16)
    (folder / "small.png").unlink()
    assert (
        refusal(app, "GET", "/api/frame?name=small&file=../../recording.toml")[0] == 422
    )


def test_a_dropped_file_is_kept_once_and_whole(app: Client, folder: Path) -> None:
    data = b"time_s,fz_n\n0,0\n1,0\n" * 3
    assert app.json("PUT", "/api/source?name=push.csv", data) == {
        "name": "sources/push.csv"
    }
    assert (folder / "sources" / "push.csv").read_bytes() == data
    status, text = refusal(app, "PUT", "/api/source?name=push.csv", b"other")
    assert (status, text) == (422, "push.csv: exists already; choose another name")

    for name in ("../out.csv", ".hidden", "a/b.csv", ""):
        assert refusal(app, "PUT", f"/api/source?name={name}", data)[0] == 422

    assert refusal(app, "PUT", "/api/source?name=empty.csv", b"")[0] == 422
    with ThreadPoolExecutor() as pool:
        answers = list(
            pool.map(
                lambda n: refusal(app, "PUT", "/api/source?name=twice.csv", b"%d" % n)[
                    0
                ],
                range(6),
            )
        )

    assert sorted(answers) == [200] + [422] * 5
    with socket.create_connection(
        (HOST, app.port)
    ) as link:  # an upload that breaks off
        head = {
            "Host": f"{HOST}:{app.port}",
            "Origin": f"http://{HOST}:{app.port}",
            "Cookie": app.cookie,
            "X-Tab": app.tab,
            "Content-Length": "1000",
        }
        lines = "".join(f"{key}: {value}\r\n" for key, value in head.items())
        link.sendall(
            f"PUT /api/source?name=cut.csv HTTP/1.1\r\n{lines}\r\ntime_s".encode()
        )
        wait_until(
            lambda: any(
                name.endswith(".part") for name in os.listdir(folder / "sources")
            )
        )

    wait_until(
        lambda: sorted(os.listdir(folder / "sources")) == ["push.csv", "twice.csv"]
    )


def test_a_request_that_is_not_a_dropped_file_is_small(app: Client) -> None:
    run = {"command": "calibrate", "operands": ["x" * 5_000_000]}
    assert refusal(app, "POST", "/api/words", run)[0] == 413


@pytest.mark.parametrize(
    ("length", "status"),
    [
        ("Transfer-Encoding: chunked", 411),
        ("Transfer-Encoding: Chunked\r\nContent-Length: 2", 411),
        ("Content-Length: 000000000100000000", 413),
        ("Content-Length: 100000000", 413),
    ],
)
@pytest.mark.parametrize("path", ["/api/words", "/api/source?name=a.csv", "/"])
def test_a_body_of_no_stated_or_too_large_a_size_is_refused_before_the_token(
    app: Client, length: str, status: int, path: str
) -> None:
    if path.startswith("/api/source") and length == "Content-Length: 100000000":
        status = 403  # a file may have this size, but nothing of it is taken
    head = f"Host: {HOST}:{app.port}\r\nOrigin: http://{HOST}:{app.port}\r\n{length}"
    with socket.create_connection((HOST, app.port)) as link:
        link.sendall(f"POST {path} HTTP/1.1\r\n{head}\r\n\r\n".encode())
        with link.makefile("rb") as answer:
            assert answer.readline().split()[1] == str(status).encode()


def test_the_token_of_the_opened_browser_is_valid_once(folder: Path) -> None:
    with running_app(folder, once="o" * 32) as client:
        assert [client.ask("GET", f"/?token={'o' * 32}")[0] for _ in range(2)] == [
            303,
            403,
        ]
        assert [client.ask("GET", f"/?token={'t' * 32}")[0] for _ in range(2)] == [
            303,
            303,
        ]


def test_links_out_of_the_folder_are_neither_read_nor_written(
    app: Client, folder: Path, tmp_path: Path
) -> None:
    outside = write_small_recording(tmp_path / "outside", frames=2)
    linked = write_small_recording(folder / "linked", frames=2)
    (linked / "walls").symlink_to(tmp_path)
    wall = {"outer": [4.0] * COLUMNS, "inner": [9.0] * COLUMNS, "unseen": []}

    for path in ("draft", "wall"):
        assert (
            refusal(app, "PUT", f"/api/{path}?name=linked&file=0000.png", wall)[0]
            == 422
        )

    assert os.listdir(tmp_path) == ["outside"]
    (linked / "walls").unlink()
    (linked / "frames" / "0001.png").unlink()
    (linked / "frames" / "0001.png").symlink_to(outside / "frames" / "0001.png")
    assert refusal(app, "GET", "/api/frame?name=linked&file=0001.png")[0] == 422
    assert (
        refusal(app, "POST", "/api/sources", {"operands": ["linked/frames"]})[0] == 422
    )
    assert (
        refusal(
            app,
            "POST",
            "/api/run",
            {"command": "evaluate", "operands": ["default", "linked"]},
        )[0]
        == 422
    )
    shutil.rmtree(linked)


@pytest.mark.parametrize(
    "wall",
    [
        {"outer": [4.0], "inner": [9.0], "unseen": []},
        {"outer": [4.0] * COLUMNS, "inner": [9.0] * COLUMNS, "unseen": [COLUMNS]},
        {"outer": [float("nan")] * COLUMNS, "inner": [9.0] * COLUMNS, "unseen": []},
    ],
)
def test_a_wall_that_does_not_fit_its_frame_is_refused(
    app: Client, folder: Path, wall: Any
) -> None:
    for path in ("draft", "wall"):
        assert (
            refusal(app, "PUT", f"/api/{path}?name=small&file=0000.png", wall)[0] == 422
        )
    assert not (folder / "small" / "walls").exists()


@pytest.mark.parametrize(
    "answers",
    [
        {"bits": "abc"},
        {"bits": 1.5},
        {"bits": True},
        {"width_mm": "1"},
        {"eye": 1.0},
        {"by_arrival": 1.0},
        {"secret": 1},
        {"width_mm": float("nan")},
    ],
)
def test_answers_of_another_name_or_type_are_refused(app: Client, answers: Any) -> None:
    status, text = refusal(
        app, "POST", "/api/sources", {"operands": ["log.csv"], "options": answers}
    )
    assert (status, {*text.partition(":")[0].split(".")} >= {*answers}) == (422, True)


def test_a_request_without_operands_is_refused(app: Client) -> None:
    assert refusal(app, "POST", "/api/sources", {"operands": []})[0] == 422


def test_entries_that_change_or_cannot_be_read_are_listed_as_they_are_now(
    tmp_path: Path,
) -> None:
    recording = write_small_recording(tmp_path / "small", frames=1)
    (tmp_path / "loop").symlink_to("loop")
    folder = Folder(tmp_path)
    before = (recording / "recording.toml").read_text()
    eye = folder.contents()["recordings"][0]["eye"]
    (recording / "recording.toml").write_text(before.replace(f"'{eye}'", "'another'"))
    assert folder.contents()["recordings"] == [{"name": "small", "eye": "another"}]


def test_frames_of_one_stem_are_not_corrected(tmp_path: Path) -> None:
    path = write_small_recording(tmp_path / "small", frames=2)
    (path / "frames" / "0001.png").rename(path / "frames" / "0000.tif")
    (path / "frames.csv").write_text(
        (path / "frames.csv").read_text().replace("0001.png", "0000.tif")
    )

    with pytest.raises(
        InputError, match=r"0000.tif: walls/0000.png would be the wall of 0000.png too"
    ):
        check_alone(read_recording(path), "0000.tif")


def test_commands_are_shown_as_they_would_be_typed(app: Client) -> None:
    run = {
        "command": "evaluate",
        "operands": ["default", "small"],
        "options": {"html": "a page.html"},
    }
    assert (
        app.json("POST", "/api/words", run)["command"]
        == "scleraforce evaluate default small '--html=a page.html'"
    )
    run = {
        "command": "calibrate",
        "operands": ["small"],
        "out": "e.json",
        "options": {"frames": 3, "without_force": True},
    }
    words = "scleraforce calibrate small --frames=3 --without-force --out=e.json"
    assert app.json("POST", "/api/words", run)["command"] == words
    run = {
        "command": "import",
        "operands": ["small", "log.csv"],
        "out": "eye",
        "planes": {"small": "across:0:90"},
        "options": {"clock_offset_s": 1764325500.125},
    }
    words = (
        "import log.csv --plane=across:0:90 small --clock-offset-s=1764325500.125"
        " --out=eye"
    )
    assert app.json("POST", "/api/words", run)["command"] == f"scleraforce {words}"


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"command": "monitor"}, "not a command of the app"),
        ({"options": {"study": "x.toml"}}, "not an option of calibrate"),
        ({"out": "small"}, "exists already"),
        ({"out": "../e.json"}, "plain name"),
        ({"operands": ["missing"]}, "does not exist"),
        ({"options": {"frames": 0}}, "--frames: 0; give at least 1"),
        ({"options": {"thickness_um": 0.6}}, "--thickness-um: 0.6 is below"),
    ],
)
def test_other_commands_options_and_existing_files_are_refused(
    app: Client, change: Any, fault: str
) -> None:
    run = {"command": "calibrate", "operands": ["small"], "out": "e.json", **change}
    assert fault in app.json("POST", "/api/words", run)["fault"]
    assert refusal(app, "POST", "/api/run", run)[0] == 422


def test_a_command_that_fails_tells_its_line_and_leaves_nothing(
    app: Client, folder: Path
) -> None:
    before = sorted(os.listdir(folder))
    job = app.json(
        "POST",
        "/api/run",
        {"command": "calibrate", "operands": ["small"], "out": "e.json"},
    )["job"]
    wait_until(lambda: app.json("GET", "/api/state?tab=tab-1")["job"]["done"])
    ended = app.json("GET", "/api/state")["job"]
    assert ended["number"] == job
    assert "small" in ended["fault"]
    assert app.json("GET", "/api/result?command=calibrate") is None
    assert refusal(app, "GET", "/api/csv")[0] == 422
    assert refusal(app, "GET", "/api/result?command=../../secret")[0] == 422
    assert sorted(os.listdir(folder)) == before


def kept_reading(folder: Path, **more: Any) -> None:
    """Keep a result of evaluate in a folder, as a job does."""
    frames = [frame_answer(recording="small", file="0000.png", time_s=1.5)]
    evaluation = evaluation_of(frames)
    reading = {"model": "default", "calibration": "e.json", "recordings": ["small"]}
    (folder / RESULTS).mkdir(exist_ok=True)
    keep_result(
        {"command": "x", "time_utc": "y", "result": evaluation.to_dict(), **more}
        | (reading if more else {}),
        folder / RESULTS / "evaluate.kept",
    )


def test_the_state_says_with_what_frames_were_last_read_and_the_table_has_times(
    tmp_path: Path,
) -> None:
    write_small_recording(tmp_path / "small", frames=1)
    with running_app(tmp_path) as client:
        client.open()
        assert client.json("GET", "/api/state")["read"] is None
        kept_reading(tmp_path)  # of a version that kept no rows
        assert client.json("GET", "/api/state")["read"] is None
        assert client.json("GET", "/api/result?command=evaluate") is None
        assert refusal(client, "GET", "/api/csv")[0] == 422
        kept_reading(tmp_path, rows=[{"file": "0000.png", "time_s": 1.5}])
        assert client.json("GET", "/api/state")["read"] == {
            "model": "default",
            "calibration": "e.json",
            "recordings": ["small"],
        }
        assert client.json("GET", "/api/csv")["text"] == "file,time_s\n0000.png,1.5\n"


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
    status, text = refusal(app, "GET", f"/api/look?name=small&file=0000.png&{query}")
    assert (status, fault in text) == (422, True), text


def test_a_frame_is_read_with_the_calibration_of_its_eye(
    folder: Path, app: Client
) -> None:
    (folder / "e.json").write_text(calibration_text(0.3, {"small": {}}))
    path = "/api/look?name=small&file=0000.png"
    found = app.json("GET", f"{path}&calibration=e.json")
    assert found["command"] == (
        "scleraforce read default --calibration=e.json small/frames/0000.png"
    )
    assert (found["model"], found["calibration"]) == ("default", "e.json")
    bare = app.json("GET", path)
    assert bare["command"] == "scleraforce read default small/frames/0000.png"
    assert (bare["model"], bare["calibration"]) == ("default", "")
    (folder / "e.json").write_text(calibration_text(0.3, {"another": {}}))
    said = app.json("GET", f"{path}&calibration=e.json")["answer"]["warnings"]
    assert any("e.json" in warning and "small" in warning for warning in said)
    assert not any(str(folder) in warning for warning in said)
    (folder / "e.json").unlink()


def test_a_frame_is_read_by_a_model_of_the_folder(folder: Path, app: Client) -> None:
    shutil.copytree(SHIPPED_READER, folder / "reader")
    found = app.json("GET", "/api/look?name=small&file=0000.png&model=./reader")
    assert found["command"] == "scleraforce read ./reader small/frames/0000.png"
    assert found["answer"]["model"] == "reader"
    shutil.rmtree(folder / "reader")


def test_what_an_import_remarked_stays_with_its_recording(tmp_path: Path) -> None:
    recording = write_small_recording(tmp_path / "small", frames=1)
    views = RecordingViews()
    assert views.summary(recording)["imported"] == []
    remark = Remark("clock-found", "clock offset 0 s", ("clock_offset_s",)).to_dict()
    (recording / "import.json").write_text(json.dumps({"remarks": [remark]}))
    assert views.summary(recording)["imported"] == [remark]
    (recording / "import.json").write_text("damaged")
    assert views.summary(recording)["imported"] == []
    assert "import.json" in views.summary(recording)["notes"][0]


@pytest.mark.parametrize(
    ("table", "kind"),
    [
        ("file,time_s,pierced\n0001.png,1,0\n0002.png,2,0\n", "times"),
        ("index,time_s\n0,1\n1,2\n", "times"),
        ("frame,date\n1,2026-05-31 10:00:00\n2,2026-05-31 10:00:01\n", "times"),
        ("image,time_s,exposure\na.png,1,4\nb.png,2,5\n", "times"),
        ("time_s\n1\n2\n", "times"),
        ("frame,time_s,pull\n1,1,4\n2,2,5\n", "log"),
        ("clock,pull\n1,4\n2,5\n", "log"),
        ("file,time_s,fz_n\na.png,1,4\nb.png,2,5\n", "log"),
    ],
)
def test_a_table_of_times_is_told_from_a_force_log(
    tmp_path: Path, table: str, kind: str
) -> None:
    (tmp_path / "table.csv").write_text(table)
    listed = Folder(tmp_path.resolve()).contents()["sources"]
    assert listed == [{"name": "table.csv", "kind": kind}]


def test_a_wall_that_is_accepted_is_a_mask_with_its_author_and_frame(
    tmp_path: Path,
) -> None:
    recording = write_small_recording(tmp_path / "small", frames=2)
    outer = [4.3] * COLUMNS
    inner = [9.6] * (COLUMNS - 1) + [None]
    mask = mask_between(outer, inner, [0, 1], ROWS, COLUMNS)
    assert (mask[:, 0] == 128).all()
    assert np.flatnonzero(mask[:, 5] == 255).tolist() == [5, 6, 7, 8, 9]
    # an inner boundary that is not seen
    assert np.flatnonzero(mask[:, -1] == 255)[-1] == ROWS - 1
    write_wall(recording, "0000.png", mask, "somebody", "2026-01-02T03:04:05Z")
    walls = RecordedWalls(recording)
    np.testing.assert_array_equal(walls.wall("0000.png"), mask)
    assert walls.wall("0001.png") is None
    assert ",somebody,2026-01-02T03:04:05Z," in (recording / "walls.csv").read_text()
    write_wall(recording, "0001.png", mask, "other", "2026-01-02T03:04:06Z")
    (recording / "frames" / "0001.png").write_bytes(
        (recording / "frames" / "0000.png").read_bytes()
    )
    changed = RecordedWalls(recording)
    assert changed.wall("0001.png") is None
    assert "another version" in " ".join(map(str, changed.remarks))
    remove_wall(recording, "0000.png")
    assert RecordedWalls(recording).wall("0000.png") is None


def test_walls_of_the_users_own_keep_counting_when_the_app_adds_one(
    tmp_path: Path,
) -> None:
    recording = write_small_recording(tmp_path / "small", frames=2)
    mask = np.zeros((ROWS, COLUMNS), np.uint8)
    mask[5:9] = 255
    write_wall(recording, "0001.png", mask, "me", "")
    (recording / "walls.csv").unlink()
    write_wall(recording, "0000.png", mask, "me", "2026-01-02T03:04:05Z")
    walls = RecordedWalls(recording)
    assert walls.wall("0000.png") is not None
    assert walls.wall("0001.png") is not None


def test_a_draft_is_kept_for_its_frame_alone(tmp_path: Path) -> None:
    recording = read_recording(write_small_recording(tmp_path / "small", frames=2))
    drawn = {"outer": [1.0], "inner": [None], "unseen": [0]}
    write_draft(recording, "0000.png", drawn)
    assert read_draft(recording, "0000.png") == drawn
    assert read_draft(recording, "0001.png") is None
    # damaged
    (recording.path / "walls" / ".0001.draft.json").write_text('{"outer": [NaN')
    assert read_draft(recording, "0001.png") is None
    remove_draft(recording, "0001.png")
    (recording.path / "frames" / "0000.png").write_bytes(
        (recording.path / "frames" / "0001.png").read_bytes()
    )
    assert read_draft(recording, "0000.png") is None
    remove_draft(recording, "0000.png")
    assert os.listdir(recording.path / "walls") == []


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
    begun = Event()
    gone = Event()
    looked_at = list[Path]()

    def look(path: Path, _: object) -> tuple[str, dict[str, str]]:
        begun.set()
        assert gone.wait(FUSE_S)
        if not looked_at:
            wait_until(has_ended)
        looked_at.append(path)
        return "", {}

    monkeypatch.setattr("scleraforce.front.app.work_folder._entry", look)
    with running_app(folder) as client:
        client.open()
        with socket.create_connection((HOST, client.port)) as link:
            head = {"Host": f"{HOST}:{client.port}", "Cookie": client.cookie}
            lines = "".join(f"{key}: {value}\r\n" for key, value in head.items())
            link.sendall(f"GET /api/state HTTP/1.1\r\n{lines}\r\n".encode())
            assert begun.wait(FUSE_S)

        gone.set()
        wait_until(lambda: looked_at != [])
        client.json("GET", "/api/state")  # others are served as before
        entries = looked_at[1:]
        assert looked_at[0] == entries[0]
        assert 2 < len(entries) == len(set(entries))


def test_a_request_that_waits_for_its_answer_has_not_ended() -> None:
    """Nor does a thread that works for none."""
    assert not has_ended()
