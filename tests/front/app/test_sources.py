"""Sources before their import: what is stated, what is asked, and the clocks."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from scleraforce.base.errors import InputError
from scleraforce.front.app.source_views import Checked, Sources
from scleraforce.recordings.formats.foreign_force_logs import parse_column
from scleraforce.recordings.log_tables import QUANTITY_OF, UNITS
from scleraforce.records.scan import parse_plane


def test_what_the_files_leave_open_is_asked_and_frames_may_be_left_out(
    tmp_path: Path,
) -> None:
    stack = np.random.default_rng(0).integers(0, 4096, (5, 32, 48), dtype=np.uint16)
    tifffile.imwrite(tmp_path / "scan.tif", stack, photometric="minisblack")
    (tmp_path / "log.csv").write_text(
        "Clock,Pull\n" + "".join(f"{n * 10},{n}\n" for n in range(400))
    )
    paths = [tmp_path / "scan.tif", tmp_path / "log.csv"]
    sources = Sources()
    asked = sources.describe(paths, [], Checked())
    assert asked["field"] == "columns"
    assert asked["table"]["columns"] == [
        {"name": "Clock", "unit": "", "first": "0"},
        {"name": "Pull", "unit": "", "first": "0"},
    ]
    assert asked["table"]["read"] == {}
    columns = ("time=Clock:ms", "fz=Pull:mN")
    found = sources.describe(paths, [], Checked(width_mm=15.0, columns=columns))
    assert (found["frames"], found["rows"], found["columns"]) == (5, 32, 48)
    assert {"depth_mm", "bits", "rate_hz", "eye", "gauge"} <= set(found["missing"])
    assert "width_mm" not in found["missing"]
    assert found["stated"]["axis"]["value"] == "fz"
    assert max(found["log"]["fz"]["high"]) == pytest.approx(399.0)
    some = sources.describe(
        paths, [], Checked(first_frame=2, last_frame=3, columns=columns)
    )
    assert some["frames"] == 2

    with pytest.raises(InputError, match="`last_frame`: frames 1 to 6 of 5"):
        sources.describe(paths, [], Checked(last_frame=6, columns=columns))

    assert sources.picture(paths, [], Checked(columns=columns), 4).startswith(
        b"\x89PNG"
    )
    with pytest.raises(InputError, match="frame 6: there are 5"):
        sources.picture(paths, [], Checked(columns=columns), 5)


def test_a_log_says_its_columns_with_the_units_that_it_states(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text(
        "Clock,Time (ms),side / mN,pull,Fz (mN)\n"
        "2026-05-31 10:00:00,0,1,2,3\n2026-05-31 10:00:01,1,1,2,3\n"
    )
    np.save(tmp_path / "scan.npy", np.ones((2, 32, 48), np.uint16))
    paths = [tmp_path / "scan.npy", tmp_path / "log.csv"]
    options = Checked(axes="frame,depth,lateral", columns=("fx=side / mN:mN",))
    table = Sources().describe(paths, [], options)["table"]
    units = {column["name"]: column["unit"] for column in table["columns"]}
    assert units == {
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
    assert (
        Sources().describe(paths[:1], [], Checked(axes="frame,depth,lateral"))["table"]
        is None
    )


@pytest.mark.parametrize("short", QUANTITY_OF)
def test_all_units_to_choose_from_are_units_of_their_column(short: str) -> None:
    for unit in UNITS[QUANTITY_OF[short]]:
        assert parse_column(f"{short}=Name:{unit}").unit == unit


def test_names_with_gaps_are_asked_about_and_a_changed_table_is_read_again(
    tmp_path: Path,
) -> None:
    names = [f"f{nth}.png" for nth in (1, 2, 4)]
    for name in names:
        cv2.imwrite(str(tmp_path / name), np.ones((32, 48), np.uint16))

    paths = [tmp_path / name for name in names]
    sources = Sources()
    asked = sources.describe(paths, [], Checked(rate_hz=2.0))
    assert (asked["field"], asked["forms"]) == ("frames_by", [])
    assert "f4.png follows f2.png" in asked["question"]
    for by in ("numbers", "order", "times:s"):
        assert sources.describe(paths, [], Checked(frames_by=by))["frames"] == 3

    table = tmp_path / "t.csv"
    table.write_text("file,time_s\nf1.png,1\nf2.png,2\nf4.png,3\n")
    timed = Checked(times=table)
    assert "f1.png" in sources.gathered(paths, [], timed).scan.names[0]
    table.write_text("file,time_s\nf1.png,11\nf2.png,2\nf4.png,3\n")
    assert "f2.png" in sources.gathered(paths, [], timed).scan.names[0]


def test_stacks_of_two_planes_are_one_scan_without_a_gap_to_give(
    tmp_path: Path,
) -> None:
    for name in ("along", "across"):
        tifffile.imwrite(
            tmp_path / f"{name}.tif",
            np.ones((3, 32, 48), np.uint16),
            photometric="minisblack",
        )

    paths = [tmp_path / "along.tif", tmp_path / "across.tif"]
    sources = Sources()
    joined = sources.describe(paths, [], Checked())
    assert (joined["frames"], "gap_mm" in joined["missing"]) == (6, True)
    crossed = sources.describe(
        paths, [parse_plane("along:0:0"), parse_plane("across:0:90")], Checked()
    )
    assert (crossed["frames"], "gap_mm" in crossed["missing"]) == (3, False)


def test_a_frame_with_gaps_is_shown_and_one_without_a_wall_has_no_dent(
    tmp_path: Path,
) -> None:
    stack = np.random.default_rng(0).random((8, 32, 48), dtype=np.float32)
    stack[1, :5] = np.nan
    stack[2] = np.nan
    np.save(tmp_path / "scan.npy", stack)
    (tmp_path / "log.csv").write_text(
        "time_s,fz_n\n" + "".join(f"{n / 100},0\n" for n in range(400))
    )
    paths = [tmp_path / "scan.npy", tmp_path / "log.csv"]
    sources = Sources()
    given: dict[str, Any] = {
        "axes": "frame,depth,lateral",
        "width_mm": 15.0,
        "depth_mm": 4.0,
        "rate_hz": 10.0,
    }

    for number in range(3):
        picture = cv2.imdecode(
            np.frombuffer(
                sources.picture(paths, [], Checked(**given), number), np.uint8
            ),
            0,
        )
        assert bool(picture.any()) == (number != 2)

    found = sources.clocks(paths, [], Checked(**given))
    assert found["dent_mm"] == [None] * 8

    for wrong in ({"axis": "fx"}, {"width_mm": -1.0}):
        with pytest.raises(
            InputError, match=r"fx is not in the force log|give the frames' size"
        ):
            sources.clocks(paths, [], Checked(**given | wrong))
