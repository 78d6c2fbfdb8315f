"""Sources before their import: what is stated, what is asked, and the clocks."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import write_table
from running_app import Client

SHAPE = (32, 48)
Ask = Callable[..., Any]


@pytest.fixture
def asked(served: Client) -> Ask:
    """Ask for sources of the folder; return the answer, or the line of a refusal."""

    def ask(
        path: str, names: str, planes: Any = (), columns: Any = (), **options: Any
    ) -> Any:
        body = {"operands": names.split(), "options": options}
        body |= {"planes": dict(planes), "columns": list(columns)}
        status, found, headers = served.ask("POST", f"/api/{path}", body)
        if status != 200:
            return found.decode()
        is_json = headers["content-type"] == "application/json"
        return json.loads(found) if is_json else found

    return ask


def write_stack(path: Path, frames: int = 5) -> None:
    stack = np.random.default_rng(0).integers(0, 4096, (frames, *SHAPE), np.uint16)
    tifffile.imwrite(path, stack, photometric="minisblack")


def test_what_the_files_leave_open_is_asked_and_frames_may_be_left_out(
    asked: Ask, tmp_path: Path
) -> None:
    write_stack(tmp_path / "scan.tif")
    rows = [(10 * n, n) for n in range(400)]
    write_table(tmp_path / "log.csv", "Clock,Pull", *rows)
    names = "scan.tif log.csv"
    open_point = asked("sources", names)
    assert open_point["field"] == "columns"
    columns = [{"name": name, "unit": "", "first": "0"} for name in ("Clock", "Pull")]
    assert open_point["table"]["columns"] == columns
    assert open_point["table"]["read"] == {}
    given = {"columns": ("time=Clock:ms", "fz=Pull:mN")}
    found = asked("sources", names, width_mm=15.0, **given)
    assert (found["frames"], found["rows"], found["columns"]) == (5, *SHAPE)
    assert {"depth_mm", "bits", "rate_hz", "eye", "gauge"} <= set(found["missing"])
    assert "width_mm" not in found["missing"]
    assert found["stated"]["axis"]["value"] == "fz"
    assert max(found["log"]["fz"]["high"]) == pytest.approx(399.0)
    assert asked("sources", names, first_frame=2, last_frame=3, **given)["frames"] == 2
    assert "frames 1 to 6 of 5" in asked("sources", names, last_frame=6, **given)
    assert asked("picture?number=4", names, **given).startswith(b"\x89PNG")
    assert "frame 6: there are 5" in asked("picture?number=5", names, **given)


def test_a_log_says_its_columns_with_the_units_that_it_states(
    asked: Ask, tmp_path: Path
) -> None:
    write_table(
        tmp_path / "log.csv",
        "Clock,Time (ms),side / mN,pull,Fz (mN)",
        "2026-05-31 10:00:00,0,1,2,3",
        "2026-05-31 10:00:01,1,1,2,3",
    )
    write_stack(tmp_path / "scan.tif")
    given = {"columns": ("fx=side / mN:mN",)}
    table = asked("sources", "scan.tif log.csv", **given)["table"]
    assert {column["name"]: column["unit"] for column in table["columns"]} == {
        "Clock": "iso",
        "Time (ms)": "ms",
        "side / mN": "mN",
        "pull": "",
        "Fz (mN)": "mN",
    }
    assert table["read"] == {
        "time": {"name": "Time (ms)", "unit": "ms"},
        "fz": {"name": "Fz (mN)", "unit": "mN"},
    }
    assert asked("sources", "scan.tif")["table"] is None


def test_names_with_gaps_are_asked_about_and_a_changed_table_is_read_again(
    asked: Ask, tmp_path: Path
) -> None:
    names = "f1.png f2.png f4.png"
    for column, name in enumerate(names.split()):
        pixels = np.zeros(SHAPE, np.uint8)
        pixels[:, column] = 200
        cv2.imwrite(str(tmp_path / name), pixels)

    open_point = asked("sources", names, rate_hz=2.0)
    assert (open_point["field"], open_point["forms"]) == ("frames_by", [])
    assert "f4.png follows f2.png" in open_point["question"]
    for by in ("numbers", "order", "times:s"):
        assert asked("sources", names, frames_by=by)["frames"] == 3

    firsts = []
    for time_s in (1, 11):
        rows = [("f1.png", time_s), ("f2.png", 2), ("f4.png", 3)]
        write_table(tmp_path / "t.csv", "file,time_s", *rows)
        first = asked("picture?number=0", names, times="t.csv")
        firsts.append(cv2.imdecode(np.frombuffer(first, np.uint8), 0)[0].argmax())
    assert firsts == [0, 1]


def test_stacks_of_two_planes_are_one_scan_without_a_gap_to_give(
    asked: Ask, tmp_path: Path
) -> None:
    names = ("along.tif", "across.tif")
    for name in names:
        write_stack(tmp_path / name, 3)

    joined = asked("sources", " ".join(names))
    assert (joined["frames"], "gap_mm" in joined["missing"]) == (6, True)
    planes = zip(names, ("along:0:0", "across:0:90"), strict=True)
    crossed = asked("sources", " ".join(names), planes)
    assert (crossed["frames"], "gap_mm" in crossed["missing"]) == (3, False)


def test_a_frame_with_gaps_is_shown_and_one_without_a_wall_has_no_dent(
    asked: Ask, tmp_path: Path
) -> None:
    stack = np.random.default_rng(0).random((8, *SHAPE), dtype=np.float32)
    stack[1, :5] = np.nan
    stack[2] = np.nan
    np.save(tmp_path / "scan.npy", stack)
    rows = [(n / 100, 0) for n in range(400)]
    write_table(tmp_path / "log.csv", "time_s,fz_n", *rows)
    size = {"width_mm": 15.0, "depth_mm": 4.0}
    given = {"axes": "frame,depth,lateral", "rate_hz": 10.0}
    names = "scan.npy log.csv"

    for number in range(3):
        shown = asked(f"picture?number={number}", names, **given)
        picture = cv2.imdecode(np.frombuffer(shown, np.uint8), 0)
        assert bool(picture.any()) == (number != 2)

    assert asked("clocks", names, **size, **given)["dent_mm"] == [None] * 8
    assert "fx is not in the force log" in asked(
        "clocks", names, **size, **given, axis="fx"
    )
    assert "give the frames' size" in asked("clocks", names, **given)
