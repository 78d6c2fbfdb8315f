"""Remarks at every face: an import, a calibration and an evaluation say the same in
their files, in JSON, in Python, in Jupyter and in words.
"""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from foreign_files import options_of, stack, write_log
from small_recordings import write_small_recording

import scleraforce as sf
from scleraforce.calibration.calibration import Calibration, parse_calibration
from scleraforce.front.cli.field_flags import json_in_flags
from scleraforce.records.calibration_file import open_calibration
from scleraforce.records.remark import SEVERITY_OF, sentences

KEYS = {"code", "severity", "words", "fields", "about"}
EVERY_INPUT = {"iop_pa", "globe", "thickness_m", "relaxation"}


def coded(remarks: Any, code: str) -> list[Any]:
    """The remarks of a result in JSON that have a code."""
    return [remark for remark in remarks if remark["code"] == code]


@pytest.fixture
def imported(shell, tmp_path: Path):
    """Import a stack and a log into `r`; return the printed object."""
    stack(tmp_path / "a.tif")
    write_log(tmp_path / "log.csv")
    sources = [tmp_path / "a.tif", tmp_path / "log.csv", "--clock-offset-s", 0]

    def run_import(*more: object, out: str = "r") -> dict[str, Any]:
        return shell.json("import", *sources, *more, "--out", tmp_path / out)

    return run_import


def test_an_import_says_the_same_in_json_in_its_file_and_in_python(
    imported, shell, tmp_path: Path
) -> None:
    options = options_of("--bits", 13, "--contact-sign", -1)
    printed = imported(*options)
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert json_in_flags(kept["remarks"], "import") == printed["remarks"]
    assert all(set(remark) == KEYS for remark in kept["remarks"])
    assert [SEVERITY_OF[one["code"]] for one in kept["remarks"]] == [
        one["severity"] for one in kept["remarks"]
    ]
    remarks = sf.read_recording(tmp_path / "r").remarks
    assert [remark.to_dict() for remark in remarks] == kept["remarks"]
    assert list(sentences(remarks)) == kept["notes"]
    missing = coded(kept["remarks"], "missing-input")
    assert {name for one in missing for name in one["fields"]} == EVERY_INPUT

    shown = shell.json("show", tmp_path / "r")
    assert coded(shown["remarks"], "missing-input") == missing
    text = " ".join(shell.text("show", tmp_path / "r").split())
    assert all(f"caution {one['words']}" in text for one in missing)


def test_what_is_stated_is_not_missing(imported) -> None:
    options = options_of("--bits", 13, "--contact-sign", -1, "--iop-mmhg", 2)
    found = imported(
        *options, "--globe", "open", "--relaxation", "none", "--thickness-um", 600
    )
    assert coded(found["remarks"], "missing-input") == []


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('{"remarks": 7}', "remarks"),
        ('{"remarks": [{"code": "log-slow"}]}', r"remarks\[0\].words: missing"),
        (
            '{"remarks": [{"code": "odd", "words": "a"}]}',
            r"remarks\[0\].code: 'odd' is no code of a remark",
        ),
        ('{"notes": ["a", 3]}', r"notes"),
    ],
)
def test_damaged_remarks_of_an_import_name_file_and_field(
    tmp_path: Path, shell, content: str, words: str
) -> None:
    folder = write_small_recording(tmp_path / "r")
    (folder / "import.json").write_text(content)
    with pytest.raises(sf.InputError, match=rf"import\.json: {words}"):
        assert sf.read_recording(folder).remarks
    assert "import.json" in shell.refused("show", folder)


def test_sentences_of_an_earlier_import_are_remarks_without_a_code_of_their_own(
    tmp_path: Path,
) -> None:
    folder = write_small_recording(tmp_path / "r")
    assert sf.read_recording(folder).remarks == ()
    (folder / "import.json").write_text('{"notes": ["the clock steps back"]}')
    (remark,) = sf.read_recording(folder).remarks
    assert (remark.code, remark.words) == ("earlier-version", "the clock steps back")


def stated(folder: Path, **tables: str) -> Path:
    """A small recording whose recording.toml states more."""
    write_small_recording(folder)
    text = (folder / "recording.toml").read_text()
    for table, lines in tables.items():
        text = text.replace(f"[{table}]", f"[{table}]\n{lines}", 1)
    (folder / "recording.toml").write_text(text)
    return folder


OF_EYE = {
    "eye": 'thickness_m = 6e-4\niop_pa = 300.0\nglobe = "open"\nradius_m = 0.012\n'
    "relaxation = [[0.1, 1.0]]",
    "needle": "polar_angle_rad = 0.6\nlean_rad = 0.1",
    "oct": "plane_direction_rad = 0.4\nplane_tilt_rad = 0.05",
    "force": "range_n = 0.5",
}
NOT_COPIED = [
    "thickness_m",
    "iop_pa",
    "radius_m",
    "globe",
    "relaxation",
    "polar_rad",
    "lean_rad",
    "direction_rad",
]


def test_like_takes_the_laboratory_and_names_what_it_does_not_take(
    imported, tmp_path: Path
) -> None:
    other = stated(tmp_path / "other", **OF_EYE)
    like = ["--like", other, "--eye", "b", "--bits", 13]
    found = imported(*like, "--iop-mmhg", 3)
    (remark,) = coded(found["remarks"], "not-copied")
    assert remark["fields"] == [name for name in NOT_COPIED if name != "iop_pa"]
    assert str(other) in remark["words"]
    assert remark["severity"] == "info"

    info = sf.read_recording(tmp_path / "r").info
    assert info.scan.tilt_rad == 0.05
    assert info.force.range_n == 0.5
    assert info.eye.thickness_m is info.needle.polar_rad is None
    assert info.needle.gap_m == pytest.approx(0.5e-3)

    in_python = sf.import_recording(
        [tmp_path / "a.tif"], tmp_path / "s", like=other, eye="c", bits=13
    )
    (remark,) = [one for one in in_python.remarks if one.code == "not-copied"]
    assert list(remark.fields) == NOT_COPIED
    assert in_python.info.scan.tilt_rad == 0.05


@pytest.mark.parametrize(("answer", "is_taken"), [("numbers", True), ("order", False)])
def test_numbers_in_names_are_of_the_laboratory_and_a_given_order_of_one_session(
    tmp_path: Path, shell, answer: str, is_taken: bool
) -> None:
    other = stated(tmp_path / "other")
    answers = json.dumps({"answers": {"frames_by": answer}})
    (other / "import.json").write_text(answers)
    given = ["--like", other, "--eye", "b", "--rate-hz", 1, "--out", tmp_path / "r"]
    shell.json("import", other / "frames", *given)
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert ("frames_by" in kept["answers"]) == is_taken


def test_readings_beyond_a_stated_range_of_the_sensor_have_no_force(
    imported, tmp_path: Path
) -> None:
    options = options_of("--bits", 13, "--contact-sign", -1)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    time_ms, *others, _ = lines[400].split(",")
    lines[400] = ",".join([time_ms, *others, "-60.0"])
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    imported(*options)
    assert sf.read_recording(tmp_path / "r").forces.remarks == ()
    imported(*options, "--range-n", 0.05, out="s")
    (remark,) = sf.read_recording(tmp_path / "s").forces.remarks
    assert remark.code == "samples-without-force"
    assert "the sensor's range is 0.05 N" in remark.words


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual recording with forces that does not state the kind of its globe."""
    folder = tmp_path_factory.mktemp("pushed")
    study = sf.parse_study("[mesh]\ncore = 4\nrings = 8\n")
    recording = sf.phantom(
        folder / "eye-a",
        study,
        forces_n=(0.012, 0.024, 0.036, 0.018),
        thickness_m=650e-6,
        youngs_modulus_pa=0.3e6,
        mechanics="finite-strain",
    )
    info = recording.path / "recording.toml"
    info.write_text(re.sub(r"(?m)^globe.*\n", "", info.read_text()))
    return recording.path


@pytest.fixture(scope="module")
def calibrated(
    pushed: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Calibration, Path]:
    file = tmp_path_factory.mktemp("calibrated") / "calibration.json"
    return sf.calibrate(pushed, frames=3, out=file), file


def test_a_calibration_says_the_same_in_python_in_its_file_and_where_it_is_shown(
    pushed: Path, calibrated, shell
) -> None:
    calibration, file = calibrated
    remarks = [remark.to_dict() for remark in calibration.remarks]
    assert [one["fields"] for one in coded(remarks, "missing-input")] == [["globe"]]
    assert coded(remarks, "missing-input")[0]["about"] == str(pushed)
    (eye,) = calibration.eyes.values()
    (found,) = [one for one in eye.remarks if one.code == "parameter-found"]
    assert (found.about, found.fields) == (eye.id, ("globe",))
    assert json.loads(file.read_text())["remarks"] == remarks

    again = parse_calibration(open_calibration(file))
    assert [remark.to_dict() for remark in again.remarks] == remarks
    assert json.loads(json.dumps(again.to_dict())) == json.loads(file.read_text())
    shown = shell.json("show", file)
    assert shown["remarks"] == json_in_flags(remarks)
    text = " ".join(shell.text("show", file).split())
    html = calibration._repr_html_()
    table = calibration.to_dataframe()
    for remark in calibration.remarks:
        assert f"{remark.severity} {remark}" in text
        assert str(remark) in html
    assert "k " in table["remarks"][0]


def test_a_calibration_of_an_earlier_version_is_read_with_its_doubts(
    calibrated, tmp_path: Path
) -> None:
    _, file = calibrated
    content = json.loads(file.read_text())
    del content["remarks"]
    for eye in content["eyes"].values():
        for recording in eye["recordings"]:
            del recording["remarks"]
            recording["doubts"] = ["its clock is odd"]
    old = tmp_path / "old.json"
    old.write_text(json.dumps(content))
    remarks = parse_calibration(open_calibration(old)).remarks
    (doubt,) = [one for one in remarks if one.code == "earlier-version"]
    assert doubt.words == "its clock is odd"
    assert not [one for one in remarks if one.code == "missing-input"]

    eye["recordings"][0]["remarks"] = [{"code": "odd", "words": "a"}]
    old.write_text(json.dumps(content))
    place = r"old\.json: eyes\..*\.recordings\[0\]\.remarks\[0\]\.code: 'odd'"
    with pytest.raises(sf.InputError, match=place):
        parse_calibration(open_calibration(old))


def test_the_command_prints_and_returns_what_a_calibration_remarks(
    pushed: Path, tmp_path: Path, shell
) -> None:
    given = ["calibrate", pushed, "--frames", 3, "--parameters", "e"]
    printed = shell.json(*given, "--out", tmp_path / "a.json")
    (note,) = printed["notes"]
    assert note.startswith(f"{pushed}: open or sealed is not stated (eye.globe)")
    assert {remark["code"] for remark in printed["remarks"]} == {
        "missing-input",
        "parameter-found",
    }
    text = " ".join(shell.text(*given, "--out", tmp_path / "b.json").split())
    assert text.startswith("note: ")
    assert "open or sealed is not stated (eye.globe)" in text


def test_an_evaluation_says_the_same_in_python_json_jupyter_and_its_page(
    pushed: Path, calibrated, tmp_path: Path, shell
) -> None:
    found = sf.evaluate("default", pushed)
    missing = [one for one in found.remarks if one.code == "missing-input"]
    assert {name for one in missing for name in one.fields} == {"globe", "relaxation"}
    assert {one.about for one in missing} == {str(pushed)}
    assert found.notes == sentences(found.remarks)
    assert found.to_dict()["remarks"] == [one.to_dict() for one in found.remarks]
    assert all(str(one) in found._repr_html_() for one in missing)
    page = tmp_path / "page.html"
    printed = shell.json("evaluate", "default", pushed, "--html", page)
    assert printed["remarks"] == json_in_flags(found.to_dict()["remarks"])
    assert all(f"<b>caution</b> {one}" in page.read_text() for one in missing)

    # what a calibration found is not missing
    calibration, _ = calibrated
    known = sf.evaluate("default", pushed, calibration)
    assert not [one for one in known.remarks if one.code == "missing-input"]


def test_a_table_of_many_recordings_has_their_remarks(
    pushed: Path, tmp_path: Path, shell
) -> None:
    table = tmp_path / "t.csv"
    first = shell.json("evaluate", "default", pushed, "--table", table)
    again = shell.json("evaluate", "default", pushed, "--table", table)
    assert (first["read"], again["read"]) == (1, 0)
    assert first["remarks"] == again["remarks"]
    assert len(coded(first["remarks"], "missing-input")) == 2
    assert first["notes"] == [
        f"{one['about']}: {one['words']}" for one in first["remarks"]
    ]
