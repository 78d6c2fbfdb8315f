"""Exported tables in a spreadsheet: no text is evaluated, and every column has its unit in its name."""

import csv
import json
import re
from io import StringIO
from pathlib import Path

import pytest
from format_frames import with_log
from small_recording import write_small_recording

from scleraforce.cli.main import run
from scleraforce.recording.export import csv_text
from scleraforce.recording.folder import read_recording
from scleraforce.segmentation.needle import SeenNeedle, needle_entry
from scleraforce.study.toml import format_record

FORMULAS = ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "\n=1", '=cmd|" /C calc"!A0']
UNITS = ("s", "ms", "mn", "mm", "um", "deg", "pa", "mpa", "mmhg", "mmhg13_per_ul")
# Columns that are counts, names, shares, classes, flags or sentences.
BARE = {
    "recording", "eye", "file", "pierced", "target", "predicted", "usable", "reason", "can_calibrate", "calibration",
    "excluded", "modulus_source", "needle", "needle_leans",
}  # fmt: skip


@pytest.mark.parametrize("text", FORMULAS)
def test_no_text_begins_as_a_formula_does(text: str) -> None:
    found = list(csv.reader(StringIO(csv_text([{"file": text, "deep": {"note": text}, text: 1}]), newline="")))
    assert found == [["file", "deep_note", f"'{text}"], [f"'{text}", f"'{text}", "1"]]


def test_numbers_stay_numbers_and_other_texts_stay_as_they_are() -> None:
    row = {"force_mn": -1.5, "count": -2, "flag": True, "file": "a=b -c.png", "note": "'quoted"}
    assert csv_text([row]).splitlines()[1] == "-1.5,-2,1,a=b -c.png,'quoted"


def test_what_is_null_in_one_row_and_an_object_in_another_has_the_columns_of_the_object() -> None:
    seen = SeenNeedle(angle_rad=0.0, tip_m=(1e-3, 2e-3), tip=(1.0, 1.0), top=(1.0, 0.0), hidden=(0, 2))
    rows = [{"needle": None, "interval_mn": None}, {"needle": needle_entry(seen), "interval_mn": [1.0, 2.0]}]
    assert csv_text(rows).splitlines() == [
        "interval_low_mn,interval_high_mn,needle_angle_deg,needle_leans,needle_tip_lateral_mm,needle_tip_depth_mm",
        ",,,,,",
        "1.0,2.0,0.0,right,1.0,2.0",
    ]


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording `r` and what `evaluate` says of it."""
    folder = tmp_path_factory.mktemp("answered")
    recording = with_log(write_small_recording(folder / "r", frames=3))
    for command in ("evaluate", "classify", "segment"):
        things = [recording] if command == "evaluate" else sorted((recording / "frames").glob("*.png"))
        model = [] if command == "segment" else ["default"]
        out = ["--out", folder / "masks"] if command == "segment" else []
        with pytest.MonkeyPatch.context() as patch:
            text = StringIO()
            patch.setattr("sys.stdout", text)
            assert run([command, *map(str, [*model, *things, *out]), "--json"]) == 0
        (folder / f"{command}.json").write_text(text.getvalue())
    return folder


@pytest.mark.parametrize("command", ["evaluate", "classify", "segment"])
def test_every_column_of_numbers_has_its_unit_in_its_name(answered: Path, command: str) -> None:
    out = answered / f"{command}.csv"
    answers = ["--answers", answered / f"{command}.json", "--out", out]
    assert run(["export", *map(str, [answered / "r", *answers])]) == 0
    columns = next(csv.reader(StringIO(out.read_text())))
    assert {"time_s", "measured_force_mn"} <= set(columns)
    bare = [name for name in columns if not re.search(rf"_({'|'.join(UNITS)})(_value|_source)?$", name)]
    listed = r"(probabilities|warnings)(_\d+)?|(scale|known)_(refractive_index|globe|stiffening)_(value|source)"
    others = {"mask", "inner_found", *BARE}
    assert [name for name in bare if name not in others and not re.fullmatch(listed, name)] == []


def test_the_settings_of_a_recording_have_the_keys_of_its_file(tmp_path: Path) -> None:
    folder = write_small_recording(tmp_path / "r", frames=2, log=False)
    text = (folder / "recording.toml").read_text()
    line = 'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.03'
    (folder / "recording.toml").write_text(re.sub(r"(?m)^(id = .*)$", rf"\1\n{line}", text))
    assert run(["export", str(folder), "--out", str(tmp_path / "a.json")]) == 0
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["eye"]["rigidity_mmhg13_per_ul"] == pytest.approx(0.03)
    assert all(name in format_record(read_recording(folder).info) for name in found["eye"])
