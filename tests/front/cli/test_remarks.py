"""Remarks at every face: an import, a calibration and an evaluation say the same in
their files, in JSON, in Python, in Jupyter and in words.
"""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from foreign_files import stack, write_frames, write_log
from small_recordings import write_small_recording

import scleraforce as sf
from scleraforce.calibration.calibration import Calibration, parse_calibration
from scleraforce.records.calibration_file import open_calibration
from scleraforce.records.remark import sentences

STATED = "--eye eye-1 --gauge 22 --gap-mm 0.6 --refractive-index 1.38 --bits 13"
EVERY_INPUT = {"iop_pa", "globe", "thickness_m", "relaxation"}


def coded(remarks: Any, code: str) -> list[Any]:
    """The remarks of a result in JSON that have a code."""
    return [remark for remark in remarks if remark["code"] == code]


def facts(remarks: Any) -> list[dict[str, Any]]:
    """All of remarks but their words, which name fields or options."""
    return [{**remark, "words": ""} for remark in remarks]


pytestmark = pytest.mark.usefixtures("undrawn")


@pytest.fixture
def imported(shell, tmp_path: Path):
    """Import a stack and a log into `r`; return the printed object."""
    stack(tmp_path / "a.tif")
    write_log(tmp_path / "log.csv")
    sources = [tmp_path / "a.tif", tmp_path / "log.csv", "--clock-offset-s 0"]

    def run_import(*more: object) -> dict[str, Any]:
        return shell.json("import", *sources, *more, "--out", tmp_path / "r")

    return run_import


def test_an_import_says_the_same_in_json_in_its_file_in_python_and_where_it_is_shown(
    imported, shell, tmp_path: Path
) -> None:
    printed = imported(STATED, "--contact-sign -1")["remarks"]
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert facts(printed) == facts(kept["remarks"])
    remarks = sf.read_recording(tmp_path / "r").remarks
    assert [remark.to_dict() for remark in remarks] == kept["remarks"]
    assert list(sentences(remarks)) == kept["notes"]
    missing = coded(kept["remarks"], "missing-input")
    assert {name for one in missing for name in one["fields"]} == EVERY_INPUT

    shown = shell.json("show", tmp_path / "r")
    assert coded(shown["remarks"], "missing-input") == missing
    text = shell.text("show", tmp_path / "r")
    assert all(f"caution {one['words']}" in text for one in missing)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('{"remarks": 7}', "remarks"),
        ('{"remarks": [{"code": "log-slow"}]}', r"remarks\[0\].words: missing"),
        ('{"remarks": [{"code": "a", "words": "b"}]}', r"remarks\[0\].code: 'a' is no"),
        ('{"notes": ["a", 3]}', "notes"),
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


@pytest.fixture
def other(tmp_path: Path):
    """Write a small recording that states more, or whose import had answers."""

    def write(answers: object = None, **tables: str) -> Path:
        folder = write_small_recording(tmp_path / "other")
        text = (folder / "recording.toml").read_text()
        for table, lines in tables.items():
            text = text.replace(f"[{table}]", f"[{table}]\n{lines}", 1)
        (folder / "recording.toml").write_text(text)
        if answers is not None:
            (folder / "import.json").write_text(json.dumps({"answers": answers}))
        return folder

    return write


SEALED = 'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.03\nleak_time_s = 30.0'
LOGARITHMIC = f'{SEALED}\nrigidity_law = "logarithmic"'
OF_EYE = {
    "eye": "thickness_m = 6e-4\nthickness_sd_m = 1e-5\niop_pa = 300.0\n"
    f"iop_sd_pa = 20.0\nradius_m = 0.012\nradius_sd_m = 1e-4\n{LOGARITHMIC}\n"
    "relaxation = [[0.1, 1.0]]",
    "needle": "polar_angle_rad = 0.6\nlean_rad = 0.1\nlean_azimuth_rad = 0.2",
    "oct": "plane_direction_rad = 0.4\nplane_tilt_rad = 0.05",
    "force": "range_n = 0.5",
}


def keys_in(words: str) -> list[str]:
    """The keys of recording.toml that a remark on what is not copied names."""
    named = re.search(r"eye or session: (.*) \(keys of recording\.toml\)", words)
    assert named is not None, words
    return named[1].split(", ")


def test_like_takes_the_laboratory_and_names_what_it_does_not_take(
    imported, other, tmp_path: Path
) -> None:
    folder = other(**OF_EYE)
    found = imported("--like", folder, "--eye b --bits 13 --iop-mmhg 3")
    (remark,) = coded(found["remarks"], "not-copied")
    assert {"thickness_m", "globe", "polar_rad", "direction_rad"} < {*remark["fields"]}
    assert "iop_pa" not in remark["fields"]
    assert str(folder) in remark["words"]
    assert remark["severity"] == "info"
    before, now = (
        tomllib.loads((path / "recording.toml").read_text())
        for path in (folder, tmp_path / "r")
    )
    taken = {f"{table}.{key}" for table, keys in now.items() for key in keys}
    stated = {f"{table}.{key}" for table, keys in before.items() for key in keys}
    assert stated - taken == {*keys_in(remark["words"])}

    info = sf.read_recording(tmp_path / "r").info
    assert (info.scan.tilt_rad, info.force.range_n) == (0.05, 0.5)
    assert info.eye.thickness_m is info.needle.polar_rad is None
    assert info.needle.gap_m == pytest.approx(0.5e-3)

    in_python = sf.import_recording(
        tmp_path / "a.tif", tmp_path / "s", like=folder, eye="c", bits=13
    )
    (remark,) = [one for one in in_python.remarks if one.code == "not-copied"]
    assert {"thickness_m", "iop_pa"} < {*remark.fields}
    assert in_python.info.scan.tilt_rad == 0.05


@pytest.mark.parametrize(
    ("before", "now", "named"),
    [
        (SEALED, "", ["globe", "rigidity_mmhg13_per_ul", "leak_time_s"]),
        (
            LOGARITHMIC,
            "--globe sealed",
            ["rigidity_mmhg13_per_ul", "rigidity_law", "leak_time_s"],
        ),
        (SEALED, "--globe open", []),
        ('globe = "open"', "--globe sealed", []),
    ],
)
def test_each_part_of_a_globe_that_is_not_stated_is_named(
    imported, other, before: str, now: str, named: list[str]
) -> None:
    found = imported("--like", other(eye=before), "--eye b --bits 13", now)
    remarks = coded(found["remarks"], "not-copied")
    keys = [key for remark in remarks for key in keys_in(remark["words"])]
    assert keys == [f"eye.{name}" for name in named]
    assert all(remark["fields"] == ["globe"] for remark in remarks)


def test_a_globe_that_python_states_whole_is_not_named(other, tmp_path: Path) -> None:
    globe = sf.Globe.declared("sealed", 1.5e8, "logarithmic", 20.0)
    recording = sf.import_recording(
        stack(tmp_path / "a.tif"),
        tmp_path / "s",
        like=other(eye=LOGARITHMIC),
        eye=sf.Eye("c", globe=globe),
        bits=13,
    )
    found = recording.info.eye.globe
    assert found.mean == pytest.approx(globe.mean)
    assert (found.law, found.leak_time_s) == (globe.law, globe.leak_time_s)
    assert [one for one in recording.remarks if one.code == "not-copied"] == []


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        (7, "answers: expected an object, found 7"),
        ({"columns": 5}, "answers.columns: expected a list"),
        ({"columns": [5]}, "answers.columns: expected a text"),
        ({"columns": ["fz"]}, "answers.columns: 'fz'; give COLUMN=NAME:UNIT"),
        ({"frames_by": "x"}, "answers.frames_by: 'x'; give numbers"),
        ({"axes": "a"}, "answers.axes: 'a'; give frame,depth,lateral"),
        ({"flip": "up"}, "answers.flip: 'up' is not one of rows, columns"),
        ({"grey_range": [1]}, "answers.grey_range: expected 2 entries"),
        ({"grey_range": [5, 1]}, "answers.grey_range: 5 1; give the darkest value"),
        ({"by_arrival": "no"}, "answers.by_arrival: expected true or false"),
    ],
)
def test_damaged_answers_of_an_import_name_file_and_field(
    tmp_path: Path, other, answers: object, words: str
) -> None:
    sources = stack(tmp_path / "a.tif")
    given = {"like": other(answers), "eye": "b", "bits": 13}
    with pytest.raises(sf.InputError, match=rf"import\.json: {words}"):
        sf.import_recording(sources, tmp_path / "r", **given)
    assert not (tmp_path / "r").exists()


# ---- answers that are taken from another recording, or not

SIZE = "--eye b --bits 13 --width-mm 3 --depth-mm 1"
LETTERS = ("a.png", "b.png")
SECONDS = ("10.png", "11.5.png", "12.png")
COUNTED = tuple(f"{n:04d}.png" for n in range(4))


@pytest.fixture
def again(shell, other, tmp_path: Path):
    """Import files like a recording whose frames went by an answer; return the answers
    that are kept, and the frames' times from the first one.
    """

    def run_import(
        answers: object, *words: object
    ) -> tuple[dict[str, str], list[float]]:
        given = ("--like", other(answers), SIZE, "--out", tmp_path / "r")
        shell.json("import", *words, *given)
        kept = json.loads((tmp_path / "r" / "import.json").read_text())
        frames = sf.read_recording(tmp_path / "r").frames
        times_s = [frame.time_s - frames[0].time_s for frame in frames]
        return kept["answers"], times_s

    return run_import


def test_answers_of_a_later_version_are_passed_over(again, tmp_path: Path) -> None:
    answers = {"axes": None, "flip": "columns", "of_later": 5}
    assert again(answers, stack(tmp_path / "a.tif"))[0] == {"flip": "columns"}


@pytest.mark.parametrize(
    ("answer", "source", "options", "is_taken", "times_s"),
    [
        ("numbers", COUNTED, "--rate-hz 2", True, [0.0, 0.5, 1.0, 1.5]),
        ("order", COUNTED, "--rate-hz 2", False, [0.0, 0.5, 1.0, 1.5]),
        ("times:s", SECONDS, "", True, [0.0, 1.5, 2.0]),
        ("times:s", SECONDS, "--frames-by order --rate-hz 2", True, [0.0, 0.5, 1.0]),
        # files that cannot have this order
        ("numbers", LETTERS, "--rate-hz 2", False, [0.0, 0.5]),
        ("times:s", LETTERS, "--rate-hz 2", False, [0.0, 0.5]),
        ("times:s", COUNTED[:1], "", False, [0.0]),
        ("numbers", 0.0, "--rate-hz 2", False, [0.0, 0.5, 1.0, 1.5, 2.0]),
        ("times:s", 1.0, "", False, [0.0, 1.0, 2.0, 3.0, 4.0]),
    ],
)
def test_an_order_of_frames_is_taken_where_it_is_the_laboratorys_and_the_files_can_have_it(
    again, tmp_path: Path, answer: str, source, options: str, is_taken: bool, times_s
) -> None:
    """`source`: the names of pictures, or the interval of a stack."""
    if isinstance(source, tuple):
        files = write_frames(tmp_path / "frames", *source)
    else:
        files = stack(tmp_path / "a.tif", finterval=source)
    kept, found_s = again({"frames_by": answer}, files, options)
    assert ("frames_by" in kept) == is_taken
    assert found_s == times_s


@pytest.mark.parametrize("is_taken", [True, False])
def test_planes_have_the_usual_order_where_the_files_of_all_allow_it(
    again, tmp_path: Path, is_taken: bool
) -> None:
    first = ("3.png", "7.png") if is_taken else ("1.png", "2.png")
    along = write_frames(tmp_path / "along", *first)
    second = ("3.png", "7.png") if is_taken else LETTERS
    across = write_frames(tmp_path / "across", *second)
    planes = ("--plane along:0:0", along, "--plane across:0:90", across)
    kept, times_s = again({"frames_by": "numbers"}, *planes, "--rate-hz 4")
    assert ("frames_by" in kept) == is_taken
    assert {*times_s} == {0.0, 1.0 if is_taken else 0.25}


# ---- calibrations and evaluations


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual recording with forces that does not state the kind of its globe."""
    recording = sf.phantom(
        tmp_path_factory.mktemp("pushed") / "eye-a",
        sf.parse_study("[mesh]\ncore = 2\nrings = 6\n"),
        forces_n=(0.012, 0.024, 0.036),
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
    (missing,) = coded(remarks, "missing-input")
    assert (missing["fields"], missing["about"]) == (["globe"], str(pushed))
    (eye,) = calibration.eyes.values()
    (found,) = [one for one in eye.remarks if one.code == "parameter-found"]
    assert (found.about, found.fields) == (eye.id, ("globe",))
    kept = json.loads(file.read_text())
    assert kept["remarks"] == remarks
    again = parse_calibration(open_calibration(file))
    assert json.loads(json.dumps(again.to_dict())) == kept
    assert facts(shell.json("show", file)["remarks"]) == facts(remarks)
    text = shell.text("show", file)
    html = calibration._repr_html_()
    for remark in calibration.remarks:
        assert f"{remark.severity} {remark}" in text
        assert str(remark) in html
    assert "k " in calibration.to_dataframe()["remarks"][0]


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

    eye["recordings"][0]["remarks"] = [{"code": "odd", "words": "a"}]
    old.write_text(json.dumps(content))
    place = r"old\.json: eyes\..*\.recordings\[0\]\.remarks\[0\]\.code: 'odd'"
    with pytest.raises(sf.InputError, match=place):
        parse_calibration(open_calibration(old))


def test_an_evaluation_says_the_same_in_python_json_jupyter_its_page_and_a_table(
    pushed: Path, calibrated, tmp_path: Path, shell
) -> None:
    found = sf.evaluate("default", pushed)
    missing = [one for one in found.remarks if one.code == "missing-input"]
    assert {name for one in missing for name in one.fields} == {"globe", "relaxation"}
    assert {one.about for one in missing} == {str(pushed)}
    assert found.notes == sentences(found.remarks)
    remarks = [one.to_dict() for one in found.remarks]
    assert found.to_dict()["remarks"] == remarks
    assert all(str(one) in found._repr_html_() for one in missing)
    page = tmp_path / "page.html"
    printed = shell.json("evaluate default", pushed, "--html", page)
    assert facts(printed["remarks"]) == facts(remarks)
    assert all(f"<b>caution</b> {one}" in page.read_text() for one in missing)

    # read, and kept from the first time
    given = ("evaluate default", pushed, "--table", tmp_path / "t.csv")
    for count in (1, 0):
        printed = shell.json(*given)
        assert printed["read"] == count
        assert len(coded(printed["remarks"], "missing-input")) == len(missing)

    # what a calibration found is not missing
    calibration, _ = calibrated
    known = sf.evaluate("default", pushed, calibration)
    assert not [one for one in known.remarks if one.code == "missing-input"]
