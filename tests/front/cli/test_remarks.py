"""Remarks at every face: an import, a calibration and an evaluation say the same in
their files, in JSON, in Python, in Jupyter and in words.
"""

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from foreign_files import options_of, stack, write_frames, write_log
from small_recordings import write_small_recording

import scleraforce as sf
from scleraforce.base.errors import RecordingError
from scleraforce.calibration.calibration import Calibration, parse_calibration
from scleraforce.front.cli.field_flags import json_in_flags
from scleraforce.recordings.recording_folder import read_info
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
    "eye": "thickness_m = 6e-4\nthickness_sd_m = 1e-5\niop_pa = 300.0\n"
    "iop_sd_pa = 20.0\nradius_m = 0.012\nradius_sd_m = 1e-4\n"
    'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.03\nrigidity_law = "logarithmic"\n'
    "leak_time_s = 30.0\nrelaxation = [[0.1, 1.0]]",
    "needle": "polar_angle_rad = 0.6\nlean_rad = 0.1\nlean_azimuth_rad = 0.2",
    "oct": "plane_direction_rad = 0.4\nplane_tilt_rad = 0.05",
    "force": "range_n = 0.5",
}
NOT_COPIED = [
    "eye.thickness_m",
    "eye.thickness_sd_m",
    "eye.iop_pa",
    "eye.iop_sd_pa",
    "eye.radius_m",
    "eye.radius_sd_m",
    "eye.globe",
    "eye.rigidity_mmhg13_per_ul",
    "eye.rigidity_law",
    "eye.leak_time_s",
    "eye.relaxation",
    "needle.polar_angle_rad",
    "needle.lean_rad",
    "needle.lean_azimuth_rad",
    "oct.plane_direction_rad",
]
FIELDS_NOT_COPIED = [
    "thickness_m",
    "thickness_sd_m",
    "iop_pa",
    "iop_sd_pa",
    "radius_m",
    "radius_sd_m",
    "globe",
    "relaxation",
    "polar_rad",
    "lean_rad",
    "lean_azimuth_rad",
    "direction_rad",
]


def keys_in(words: str) -> list[str]:
    """The keys of recording.toml that a remark on what is not copied names."""
    named = re.search(r"eye or session: (.*) \(keys of recording\.toml\)", words)
    assert named is not None, words
    return named[1].split(", ")


def test_like_takes_the_laboratory_and_names_what_it_does_not_take(
    imported, tmp_path: Path
) -> None:
    other = stated(tmp_path / "other", **OF_EYE)
    like = ["--like", other, "--eye", "b", "--bits", 13]
    found = imported(*like, "--iop-mmhg", 3)
    (remark,) = coded(found["remarks"], "not-copied")
    assert keys_in(remark["words"]) == [
        key for key in NOT_COPIED if key != "eye.iop_pa"
    ]
    assert remark["fields"] == [name for name in FIELDS_NOT_COPIED if name != "iop_pa"]
    assert str(other) in remark["words"]
    assert "--" not in remark["words"]
    assert "`" not in remark["words"]
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
    assert list(remark.fields) == FIELDS_NOT_COPIED
    assert in_python.info.scan.tilt_rad == 0.05


def test_each_key_of_the_other_recording_is_taken_or_named(
    imported, tmp_path: Path
) -> None:
    other = stated(tmp_path / "other", **OF_EYE)
    found = imported("--like", other, "--eye", "b", "--bits", 13)
    (remark,) = coded(found["remarks"], "not-copied")
    before, now = (
        tomllib.loads((folder / "recording.toml").read_text())
        for folder in (other, tmp_path / "r")
    )
    taken = {f"{table}.{key}" for table, keys in now.items() for key in keys}
    stated_keys = {f"{table}.{key}" for table, keys in before.items() for key in keys}
    assert stated_keys <= taken | set(keys_in(remark["words"]))


def test_a_key_that_is_named_can_be_stated_in_recording_toml(
    imported, tmp_path: Path
) -> None:
    other = stated(tmp_path / "other", **OF_EYE)
    imported("--like", other, "--eye", "b", "--bits", 13)
    text = (tmp_path / "r" / "recording.toml").read_text()
    for table in ("eye", "needle"):
        text = text.replace(f"[{table}]", f"[{table}]\n{OF_EYE[table]}", 1)
    text = text.replace("[oct]", "[oct]\nplane_direction_rad = 0.4", 1)
    (tmp_path / "r" / "recording.toml").write_text(text)
    before = read_info(other / "recording.toml")
    info = sf.read_recording(tmp_path / "r").info
    assert info.eye == replace(before.eye, name="b")
    assert info.needle == before.needle
    assert info.scan.direction_rad == before.scan.direction_rad


SEALED = 'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.03\nleak_time_s = 30.0'
LOGARITHMIC = f'{SEALED}\nrigidity_law = "logarithmic"'


@pytest.mark.parametrize(
    ("before", "now", "named"),
    [
        (SEALED, (), ["globe", "rigidity_mmhg13_per_ul", "leak_time_s"]),
        (SEALED, ("--globe", "sealed"), ["rigidity_mmhg13_per_ul", "leak_time_s"]),
        (
            LOGARITHMIC,
            ("--globe", "sealed"),
            ["rigidity_mmhg13_per_ul", "rigidity_law", "leak_time_s"],
        ),
        (SEALED, ("--globe", "open"), []),
        ('globe = "sealed"', ("--globe", "sealed"), []),
        ('globe = "open"', ("--globe", "sealed"), []),
    ],
)
def test_each_part_of_a_globe_that_is_not_stated_is_named(
    imported, tmp_path: Path, before: str, now: tuple[str, ...], named: list[str]
) -> None:
    other = stated(tmp_path / "other", eye=before)
    found = imported("--like", other, "--eye", "b", "--bits", 13, *now)
    remarks = coded(found["remarks"], "not-copied")
    keys = [key for remark in remarks for key in keys_in(remark["words"])]
    assert keys == [f"eye.{name}" for name in named]
    assert all(remark["fields"] == ["globe"] for remark in remarks)


def test_a_globe_that_python_states_whole_is_not_named(tmp_path: Path) -> None:
    other = stated(tmp_path / "other", eye=LOGARITHMIC)
    globe = sf.Globe.declared("sealed", 1.5e8, "logarithmic", 20.0)
    recording = sf.import_recording(
        [stack(tmp_path / "a.tif")],
        tmp_path / "s",
        like=other,
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
        ("7", "answers: expected an object, found 7"),
        ('{"columns": 5}', "answers.columns: expected a list, found 5"),
        ('{"columns": [5]}', r"answers.columns: expected a text, found 5"),
        ('{"columns": ["fz"]}', "answers.columns: 'fz'; give COLUMN=NAME:UNIT"),
        ('{"frames_by": 5}', "answers.frames_by: expected a text, found 5"),
        ('{"frames_by": "x"}', "answers.frames_by: 'x'; give numbers"),
        ('{"axes": ["a"]}', r"answers.axes: expected a text, found \['a'\]"),
        ('{"axes": "a"}', "answers.axes: 'a'; give frame,depth,lateral"),
        ('{"flip": "up"}', "answers.flip: 'up' is not one of rows, columns"),
        ('{"grey_range": "x"}', "answers.grey_range: expected a list, found 'x'"),
        ('{"grey_range": [1]}', r"answers.grey_range: expected 2 entries, found \[1\]"),
        ('{"grey_range": [5, 1]}', "answers.grey_range: 5 1; give the darkest value"),
        ('{"by_arrival": "no"}', "answers.by_arrival: expected true or false"),
        ('{"array": 5}', "answers.array: expected a text, found 5"),
    ],
)
def test_damaged_answers_of_an_import_name_file_and_field(
    tmp_path: Path, shell, answers: str, words: str
) -> None:
    other = stated(tmp_path / "other")
    (other / "import.json").write_text(f'{{"answers": {answers}}}')
    sources = [stack(tmp_path / "a.tif")]
    with pytest.raises(RecordingError, match=rf"import\.json: {words}"):
        sf.import_recording(sources, tmp_path / "r", like=other, eye="b", bits=13)
    options = ["--like", other, "--eye", "b", "--bits", 13, "--out", tmp_path / "r"]
    error = shell.refused("import", *sources, *options)
    assert re.search(rf"import\.json: {words}", " ".join(error.split()))
    assert not (tmp_path / "r").exists()


def test_answers_of_a_later_version_are_passed_over(tmp_path: Path, shell) -> None:
    other = stated(tmp_path / "other")
    answers = {"answers": {"axes": None, "flip": "columns", "of_later": 5}}
    (other / "import.json").write_text(json.dumps(answers))
    given = ["--like", other, "--eye", "b", "--bits", 13, "--out", tmp_path / "r"]
    shell.json("import", stack(tmp_path / "a.tif"), *given)
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert kept["answers"] == {"flip": "columns"}


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


@pytest.mark.parametrize("frames_by", ["numbers", "times:s"])
@pytest.mark.parametrize("source", ["stack", "one picture", "names", "own times"])
def test_an_order_of_frames_is_not_taken_where_the_files_cannot_have_it(
    tmp_path: Path, shell, source: str, frames_by: str
) -> None:
    other = stated(tmp_path / "other")
    (other / "import.json").write_text(
        json.dumps({"answers": {"frames_by": frames_by}})
    )
    if source == "stack":
        files = stack(tmp_path / "a.tif", finterval=0.0)
    elif source == "own times":
        files = stack(tmp_path / "a.tif")
    else:
        names = ("0001.png",) if source == "one picture" else ("a.png", "b.png")
        files = write_frames(tmp_path / "frames", *names)

    given = ["--like", other, "--eye", "b", "--bits", 13, "--width-mm", 3]
    given += ["--depth-mm", 1, "--out", tmp_path / "r"]
    rate = [] if source in ("one picture", "own times") else ["--rate-hz", 2]
    shell.json("import", files, *given, *rate)
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert kept["answers"] == {}
    times_s = [frame.time_s for frame in sf.read_recording(tmp_path / "r").frames]
    step_s = 1.0 if source == "own times" else 0.5
    assert times_s == [step_s * nth for nth in range(len(times_s))]


SCALE = ["--eye", "b", "--bits", 13, "--width-mm", 3, "--depth-mm", 1]


@pytest.mark.parametrize(
    ("given", "times_s"),
    [((), [0.0, 1.5, 2.0]), (("--frames-by", "order", "--rate-hz", 2), [0, 0.5, 1.0])],
)
def test_times_in_names_are_of_the_laboratory_unless_an_option_says_otherwise(
    tmp_path: Path, shell, given: tuple[object, ...], times_s: list[float]
) -> None:
    other = stated(tmp_path / "other")
    (other / "import.json").write_text('{"answers": {"frames_by": "times:s"}}')
    names = ("10.png", "11.5.png", "12.png")
    files = write_frames(tmp_path / "frames", *names)
    like = ["--like", other, *SCALE, "--out", tmp_path / "r"]
    shell.json("import", files, *like, *given)
    frames = sf.read_recording(tmp_path / "r").frames
    assert [frame.time_s - frames[0].time_s for frame in frames] == times_s


@pytest.mark.parametrize(
    ("across", "is_taken"), [(("3.png", "7.png"), True), (("c.png", "d.png"), False)]
)
def test_planes_have_the_usual_order_where_the_files_of_all_allow_it(
    tmp_path: Path, shell, across: tuple[str, str], is_taken: bool
) -> None:
    other = stated(tmp_path / "other")
    (other / "import.json").write_text('{"answers": {"frames_by": "numbers"}}')
    along = ("3.png", "7.png") if is_taken else ("1.png", "2.png")
    sources = [
        "--plane",
        "along:0:0",
        write_frames(tmp_path / "along", *along),
        "--plane",
        "across:0:90",
        write_frames(tmp_path / "across", *across),
    ]
    like = ["--like", other, *SCALE, "--rate-hz", 4, "--out", tmp_path / "r"]
    shell.json("import", *sources, *like)
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert ("frames_by" in kept["answers"]) == is_taken
    times_s = {frame.time_s for frame in sf.read_recording(tmp_path / "r").frames}
    assert times_s == {0.0, 1.0 if is_taken else 0.25}


@pytest.mark.parametrize("source", ["stack", "names"])
def test_an_order_of_frames_that_an_option_states_is_refused_by_its_name(
    tmp_path: Path, shell, source: str
) -> None:
    other = stated(tmp_path / "other")
    files = (
        stack(tmp_path / "a.tif", finterval=0.0)
        if source == "stack"
        else write_frames(tmp_path / "frames", "a.png", "b.png")
    )
    given = ["--like", other, "--eye", "b", "--bits", 13, "--rate-hz", 2]
    given += ["--out", tmp_path / "r", "--frames-by", "numbers"]
    assert "--frames-by numbers takes one number" in shell.refused(
        "import", files, *given
    )


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
