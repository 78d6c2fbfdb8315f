"""`import`: recordings from files of other programs, and prompts for missing metadata
on a terminal.
"""

import json
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from effects import contents
from foreign_files import (
    COLUMNS,
    COUNT,
    DEPTH_M,
    FRAMES,
    LATERAL_M,
    ROWS,
    stack,
    with_log,
    write_dicom,
    write_log,
    write_table,
)
from small_recordings import (
    PUSHES_MN,
    looked_at_frames,
    write_pushes,
    write_small_recording,
)

import scleraforce as sf
from scleraforce.front.cli.main import run
from scleraforce.recordings.forces_under_frames import labels_n
from scleraforce.recordings.recording_folder import Recording

# what no file states
STATED = "--eye eye-1 --gauge 22 --gap-mm 0.6 --refractive-index 1.38 --bits 13"
SIZE = "--width-mm 9 --depth-mm 8"


@pytest.fixture
def drawn(shell, tmp_path: Path):
    """Import into a new recording, by default `r`, with its picture; return the object
    that is printed, and the recording.
    """

    def run_import(*words: object, out: str = "r") -> tuple[dict, Recording]:
        printed = shell.json("import", *words, "--out", tmp_path / out)
        return printed, sf.read_recording(tmp_path / out)

    return run_import


@pytest.fixture
def imported(drawn, undrawn):  # noqa: ARG001 - takes the picture away
    return drawn


@pytest.fixture
def refused(shell, tmp_path: Path):
    def refuse(*words: object) -> str:
        before = sorted(tmp_path.rglob("*"))
        error = shell.refused("import", *words, "--out", tmp_path / "r")
        assert sorted(tmp_path.rglob("*")) == before
        return error

    return refuse


@pytest.fixture
def tiff(tmp_path: Path) -> Path:
    return stack(tmp_path / "a.tif")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    write_log(tmp_path / "log.csv")
    return tmp_path / "log.csv"


def times_s(recording: Recording) -> list[float]:
    return [frame.time_s for frame in recording.frames]


def shows(recording: Recording, frames) -> None:
    """Assert that a recording has these frames, pixel by pixel."""
    for frame, pixels in zip(recording.frames, frames, strict=True):
        np.testing.assert_array_equal(recording.frame(frame), pixels)


def test_frames_and_forces_become_a_recording_with_the_source_of_each_value(
    drawn, tiff, tmp_path: Path
) -> None:
    force_n = write_log(tmp_path / "log.csv")
    options = f"{STATED} --clock-offset-s 0.5 --contact-sign -1 --range-n 0.5"
    options += " --relaxation none"
    entry, recording = drawn(tiff, tmp_path / "log.csv", options)
    shows(recording, FRAMES)
    assert times_s(recording) == [0.5, 1.5, 2.5, 3.5, 4.5]
    np.testing.assert_allclose(recording.forces.force_n("fz"), force_n, atol=1e-7)
    scan = recording.info.scan
    size_m = (COLUMNS * LATERAL_M, ROWS * DEPTH_M)
    assert (scan.width_m, scan.depth_m) == pytest.approx(size_m)
    assert (scan.refractive_index, scan.bits) == (1.38, 13)
    assert (recording.info.needle.gauge, recording.info.eye_name) == (22, "eye-1")
    assert recording.info.eye.relaxation == sf.Relaxation.declared(())
    force = recording.info.force
    assert (force.axis, force.contact_sign, force.range_n) == ("fz", -1, 0.5)
    assert entry["values"] == {
        "width_mm": "ImageJ's unit",
        "depth_mm": "ImageJ's unit",
        "refractive_index": "option",
        "bits": "option",
        "clock_offset_s": "option",
        "axis": "the only force of the log",
        "contact_sign": "option",
        "eye": "option",
        "gauge": "option",
        "gap_mm": "option",
        "times": "ImageJ's finterval",
    }
    assert (entry["frames"], entry["force_samples"]) == (COUNT, len(force_n))
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert [file["kind"] for file in kept["files"]] == ["tiff", "log"]
    assert kept["answers"] == {"columns": ["time=Time (ms):ms", "fz=Force_Z [mN]:mN"]}
    assert cv2.imread(str(tmp_path / "r" / "preview.png")) is not None
    drawn(tiff, tmp_path / "log.csv", options, out="s")
    assert contents(tmp_path / "r") == contents(tmp_path / "s")


def test_precedence_is_options_then_the_file_then_another_recording(
    imported, tiff, tmp_path: Path
) -> None:
    like = f"like {tmp_path / 'r'}"
    other = f"--like {tmp_path / 'r'} --eye eye-2"
    write_dicom(tmp_path / "b.dcm", FRAMES, FrameTime=100.0)
    own_mm = COLUMNS * LATERAL_M * 1e3
    for out, given, width_mm, source in (
        ("r", (tiff, STATED, SIZE), 9.0, "option"),
        ("s", (tiff, other), own_mm, "ImageJ's unit"),
        ("t", (tmp_path / "b.dcm", other), 9.0, like),
    ):
        entry, _ = imported(*given, out=out)
        assert entry["width_mm"] == pytest.approx(width_mm)
        assert entry["values"]["width_mm"] == source
        contradicts = f"9 mm (option), where ImageJ's unit states {own_mm:g} mm"
        assert any(contradicts in note for note in entry["notes"]) == (out == "r")
    assert entry["values"]["gauge"] == like


def test_a_recording_comes_back_from_its_own_files(imported, tmp_path: Path) -> None:
    folder = with_log(write_small_recording(tmp_path / "small", frames=12))
    files = f"frames {folder}/forces.csv --times {folder}/frames.csv"
    like = f"--clock-offset-s 0 --like {folder} --eye small"
    entry, second = imported(f"{folder}/{files}", like)
    first = sf.read_recording(folder)
    assert (second.info, second.frames) == (first.info, first.frames)
    shows(second, map(first.frame, first.frames))
    np.testing.assert_allclose(
        second.forces.force_n("fz"), first.forces.force_n("fz"), rtol=1e-6
    )
    assert entry["values"]["times"] == str(folder / "frames.csv")


PLANES = sf.Plane("along", 0.1e-3, 0.0), sf.Plane("across", 0.0, np.pi / 2)
ALONG = "--plane along:0.1:0"
ACROSS = "--plane=across:0:90"
SEEN = "--eye eye-1 --gauge 22 --refractive-index 1 --bits 13"


@pytest.fixture
def cross(tmp_path: Path) -> tuple[Path, Path]:
    """Two frames of each of two planes, as folders of pictures whose names repeat."""
    for folder, first in (("along", 0), ("across", 2)):
        (tmp_path / folder).mkdir()
        for nth in range(2):
            cv2.imwrite(str(tmp_path / folder / f"{nth}.png"), FRAMES[first + nth])
    return tmp_path / "along", tmp_path / "across"


def test_folders_of_planes_become_one_recording_of_moments(
    drawn, log, cross, tmp_path: Path
) -> None:
    along, across = cross
    clock = "--rate-hz 0.5 --clock-offset-s 0.5 --contact-sign -1"
    entry, recording = drawn(log, ALONG, along, ACROSS, across, SEEN, SIZE, clock)
    shown = [(frame.time_s, frame.plane) for frame in recording.frames]
    assert shown == [(0.5, "along"), (0.5, "across"), (2.5, "along"), (2.5, "across")]
    shows(recording, FRAMES[[0, 2, 1, 3]])
    assert (entry["frames"], recording.info.scan.planes) == (4, PLANES)
    assert recording.info.needle.gap_m is None
    settings = sf.ImportSettings(planes=PLANES)
    given = {"like": recording.path, "eye": "eye-2", "rate_hz": 0.5}
    again = sf.import_recording(cross, tmp_path / "s", **given, settings=settings)
    assert [frame.plane for frame in again.frames] == ["along", "across"] * 2
    shows(again, FRAMES[[0, 2, 1, 3]])


def test_times_of_planes_are_shared_and_must_agree(
    imported, refused, tmp_path: Path
) -> None:
    for name, step_s in (("a", 1.0), ("b", 1.1), ("c", 1.5)):
        stack(tmp_path / f"{name}.tif", finterval=step_s)

    first = (ALONG, tmp_path / "a.tif", ACROSS)
    _, recording = imported(*first, tmp_path / "b.tif", SEEN, out="t")
    assert times_s(recording) == np.repeat(np.arange(COUNT), 2).tolist()
    apart = (*first, tmp_path / "c.tif", SEEN)
    error = refused(*apart)
    assert "frames of one moment differ by 2 s between the planes" in error
    assert "give --rate-hz" in error
    assert len(imported(*apart, "--rate-hz 2", out="s")[1].frames) == 2 * COUNT


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (f"{ALONG} ALL {ACROSS}", "--plane: 'across': no frames follow it"),
        (
            f"ALL {ACROSS} OTHERS --plane b:0:0 ALL",
            "--plane: missing for ALL/0.png",
        ),
        (f"{ALONG} ALL {ACROSS} OTHERS --gap-mm 0.4", "--gap-mm: several planes"),
    ],
)
def test_options_of_planes_that_do_not_fit_are_refused(
    refused, cross, words: str, fault: str
) -> None:
    along, across = map(str, cross)
    words = words.replace("ALL", along).replace("OTHERS", across)
    error = refused(words, SEEN, SIZE, "--rate-hz 0.5")
    assert fault.replace("ALL", along) in error


@pytest.mark.usefixtures("cross")
@pytest.mark.parametrize(
    ("names", "planes", "fault"),
    [
        (["along", "across"], PLANES[:1], "^planes: 1 for 2 sources"),
        (["along"], PLANES[:1], "^plane: only one"),
        (["along", "along"], PLANES, "is of two planes"),
        (["along", "across"], [PLANES[0]] * 2, "^plane: "),
        (["along", "across/0.png"], PLANES, "^`planes`: as many .* 'along' has 2"),
    ],
)
def test_planes_that_do_not_fit_together_are_refused(
    tmp_path: Path, names: list[str], planes, fault: str
) -> None:
    settings = sf.ImportSettings(planes=tuple(planes))
    sources = [tmp_path / name for name in names]
    with pytest.raises(sf.InputError, match=fault):
        sf.import_recording(sources, tmp_path / "r", settings=settings)


def test_a_rate_does_not_replace_times_between_which_a_frame_is_lost(
    imported, refused, tmp_path: Path
) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    for nth, second in enumerate((1, 2, 4, 5)):
        tags = {"ContentTime": f"12000{second}", "PixelSpacing": [0.1, 0.1]}
        write_dicom(folder / f"{nth}.dcm", FRAMES[nth], **tags)

    given = (folder, STATED, "--rate-hz 2")
    error = refused(*given)
    assert "2.dcm: --rate-hz: it is 2 s after the frame before by DICOM's" in error
    assert "--frames-by order" in error
    _, recording = imported(*given, "--frames-by order")
    assert times_s(recording) == [0.0, 0.5, 1.0, 1.5]
    (folder / "3.dcm").unlink()
    (folder / "0.dcm").unlink()
    assert len(imported(*given, out="s")[1].frames) == 2


@pytest.mark.parametrize("name", ["a.tif", "a.dcm", "a.avi"])
def test_damage_is_reported_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    path = tmp_path / name
    if name == "a.tif":
        stack(path)
    elif name == "a.dcm":
        write_dicom(path, FRAMES)
    else:
        path.write_bytes(b"RIFF\0\0\0\0AVI LIST" + bytes(500))

    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert run(["import", str(path), "--out", str(tmp_path / "r")]) == 2
    error = capfd.readouterr().err  # of the libraries' C code, too
    assert error.startswith(f"error: {path}")
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("option", "fault"),
    [
        ("--bits 8", "--bits says 8"),
        ("--thickness-um 0.65", "'--thickness-um'"),
        ("--iop-mmhg -1", "'--iop-mmhg'"),
        ("--relaxation elastic", "give none, or SHARE:SECONDS"),
        ("--relaxation 0.6:1,0.5:2", "add up to less than 1"),
        ("--relaxation 0.1:inf", "not finite"),
        ("--axis fz", "--axis: acts on a force log"),
        ("--clock-offset-s 0", "--clock-offset-s: acts on a force log"),
        ("--column fz=a:N", "--column: acts on a force log of text"),
        ("--image-topic /a", "--image-topic: acts on a ROS bag"),
        ("--by-arrival", "--by-arrival: acts on a ROS bag"),
        ("--array a", "--array: acts on an .npz file"),
    ],
)
def test_an_option_that_cannot_be_or_has_nothing_to_act_on_is_refused(
    refused, tiff, option: str, fault: str
) -> None:
    assert fault in refused(tiff, STATED, option)


def test_a_size_of_a_file_that_cannot_be_is_refused(refused, tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES[0], PixelSpacing=[1.0, 5.0])
    error = refused(tmp_path / "a.dcm", STATED)
    assert "a.dcm: width_m: 0.2 is above the largest allowed value 0.1; " in error


def test_clocks_that_overlap_in_part_are_noted_and_others_are_refused(
    imported, refused, tiff, log
) -> None:
    sources = (tiff, log, STATED, "--contact-sign -1 --clock-offset-s")
    error = refused(*sources, 1000)
    assert "the clocks do not overlap: frames at 1000.000 to" in error
    assert "--clock-offset-s brings both to one clock" in error
    notes = imported(*sources, -1.5)[0]["notes"]
    assert any(note.startswith("2 frames were taken before or after") for note in notes)


def test_forces_that_no_needle_gives_are_refused_before_the_recording_exists(
    imported, refused, tiff, tmp_path
) -> None:
    time_s = np.arange(0.0, 8.0, 0.005)
    pushed_n = 4.0 * np.clip(time_s - 1.0, 0.0, 1.0)
    rows = np.column_stack([time_s, -pushed_n])
    log = write_table(tmp_path / "log.csv", "time_s,Fz", *rows)
    given = (tiff, log, STATED, "--clock-offset-s 2 --contact-sign -1 --column")
    error = refused(*given, "fz=Fz:N")
    assert f"{log}: fz_n: " in error
    assert "fz=Fz:N" in error
    imported(*given, "fz=Fz:uN", out="s")
    write_log(log, rate_hz=10.0)
    error = refused(tiff, log, STATED, "--clock-offset-s 0 --contact-sign -1")
    assert f"{log}: time_s: 10 samples a second; at least 20 are needed" in error


def test_a_bag_gives_frames_and_forces_on_one_clock_that_begins_near_them(
    imported, refused, tmp_path: Path
) -> None:
    from ros_bag import FORCE_TIMES_S, FRAME_TIMES_S, START_NS, write_bag

    bag = write_bag(tmp_path / "bag", "mcap")
    given = (bag, STATED, SIZE, "--axis fz --contact-sign -1")
    error = refused(*given, "--rate-hz 4")  # the bag has its own times
    assert "leave --rate-hz out" in error
    entry, recording = imported(*given, "--average-s 0.1")
    assert entry["clock_origin_s"] == START_NS / 1e9
    np.testing.assert_allclose(times_s(recording), FRAME_TIMES_S, atol=2e-6)
    np.testing.assert_allclose(recording.forces.time_s, FORCE_TIMES_S, atol=2e-6)
    assert recording.info.force.average_s == 0.1
    # images and forces
    assert sum("messages arrived" in note for note in entry["notes"]) == 2
    assert entry["values"]["times"] == "header.stamp of /oct/image"


def test_a_contradiction_in_a_file_needs_the_options_and_is_noted_then(
    imported, refused, tmp_path: Path
) -> None:
    spacings = {
        "PixelSpacing": [0.004, 0.015],
        "NominalScannedPixelSpacing": [0.01, 0.02],
    }
    path = tmp_path / "a.dcm"
    write_dicom(path, FRAMES, FrameTime=100.0, **spacings)
    error = refused(path, STATED, "--width-mm 6")
    assert "NominalScannedPixelSpacing" in error
    assert "--width-mm" in error
    entry, _ = imported(path, STATED, "--width-mm 6 --depth-mm 3")
    assert any("NominalScannedPixelSpacing" in note for note in entry["notes"])


@pytest.fixture
def asked(
    monkeypatch: pytest.MonkeyPatch,
    shell,
    undrawn,  # noqa: ARG001 - takes the picture away
    tmp_path: Path,
) -> Callable[..., str]:
    """Import into `r` on a terminal, on which these answers are given; return what it
    shows.
    """

    def answered(answers: list[str], *words: object, code: int = 0) -> str:
        typed = StringIO("".join(f"{answer}\n" for answer in answers))
        for stream in (typed, sys.stderr):
            monkeypatch.setattr(stream, "isatty", lambda: True)
        monkeypatch.setattr(sys, "stdin", typed)
        _, err = shell.run("import", *words, "--out", tmp_path / "r", code=code)
        return err

    return answered


@pytest.fixture
def volume(tmp_path: Path) -> Path:
    np.save(tmp_path / "a.npy", FRAMES)
    return tmp_path / "a.npy"


AXES = "--axes frame,depth,lateral"


def test_an_answer_that_the_source_contradicts_is_asked_for_again(
    asked, volume, tmp_path: Path
) -> None:
    rows = [(n / 200, -0.001 * n) for n in range(400)]
    log = write_table(tmp_path / "log.csv", "when,pull", *rows)
    axes = ["nonsense", "frame,depth", "frame,depth,lateral"]
    columns = ["when:s", "pull:kg", "when:s", "push:N", "when:s", "pull:N"]
    clock = "--rate-hz 5 --clock-offset-s 0 --contact-sign -1"
    said = asked([*axes, *columns, "-"], volume, log, STATED, SIZE, clock)
    errors = [line for line in said.splitlines() if line.startswith("error: ")]
    assert len(errors) == 4
    assert "'kg'" in errors[2]
    assert "push" in errors[3]
    assert len(sf.read_recording(tmp_path / "r").forces.time_s) == 400


def test_each_answer_is_checked_where_it_is_given(
    asked, volume, tmp_path: Path
) -> None:
    size = ["zwei", "-3", "10", "4", "3", "1.38", "8", "13", "0", "5"]
    eye = ["", "a\teye", "eye-1", "9", "22", "0.6", "0.65", "650"]
    assert asked([*size, *eye], volume, AXES).count("Error: ") == 8
    info = sf.read_recording(tmp_path / "r").info
    assert (info.eye_name, info.scan.bits, info.needle.gauge) == ("eye-1", 13, 22)
    assert info.eye.thickness_m == pytest.approx(650e-6)
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert kept["values"]["thickness_um"] == "answer"


def test_answers_that_do_not_go_together_are_asked_for_again(
    asked, volume, log, tmp_path: Path
) -> None:
    options = f"{AXES} {SIZE} {STATED} --rate-hz 5 --contact-sign -1"
    assert "error: " in asked(["1000", "0.5", "-"], volume, log, options)
    assert times_s(sf.read_recording(tmp_path / "r"))[0] == 0.5


@pytest.mark.parametrize(
    "answers", [[], ["10", "4"], ["10", "4", "1", "13", "5", "eye", "22", "0.5"]]
)
def test_one_who_leaves_leaves_nothing_behind(
    asked, volume, tmp_path: Path, answers: list[str]
) -> None:
    asked(answers, volume, AXES, code=(1, 2, 130))
    assert sorted(tmp_path.iterdir()) == [volume]


@pytest.mark.parametrize(
    ("answer", "thickness_um", "source"),
    [
        ("", 600.0, "measured on the first frames"),
        ("580", 580.0, "answer"),
        ("-", None, None),
    ],
)
def test_the_wall_that_the_frames_show_is_offered(
    asked, tmp_path: Path, answer: str, thickness_um: float | None, source: str | None
) -> None:
    looked_at_frames(tmp_path / "s", 2)
    like = f"--like {tmp_path / 's'} --eye again --rate-hz 1"
    said = asked([answer], tmp_path / "s" / "frames", like)
    assert "the first frames show" in said
    found = sf.read_recording(tmp_path / "r").info.eye.thickness_m
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert kept["values"].get("thickness_um") == source
    missing = any("thickness_m" in remark["fields"] for remark in kept["remarks"])
    assert (found is None) == (thickness_um is None) == missing
    if thickness_um is not None:
        # drawn along the depth, measured along the normal
        assert found == pytest.approx(thickness_um * 1e-6, rel=0.1)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual eye with a push for each of twelve frames."""
    return write_pushes(tmp_path_factory.mktemp("pushes") / "eye-a")


@pytest.fixture(scope="module")
def other_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of other pushes."""
    folder = tmp_path_factory.mktemp("other") / "other"
    return write_pushes(folder, "other", PUSHES_MN[::-1]) / "forces.csv"


@pytest.fixture
def on_two_clocks(pushed: Path, tmp_path: Path):
    """Sources and options of the virtual eye, with times of the frames on a clock that
    is behind the log's.
    """

    def sources(behind_s: float, log: Path | None = None) -> list[object]:
        frames = sf.read_recording(pushed).frames
        rows = [f"{frame.file},{frame.time_s - behind_s:.4f}" for frame in frames]
        times = write_table(tmp_path / "times.csv", "file,time_s", *rows)
        like = f"--like {pushed} --eye eye-a --thickness-um 700 --times {times}"
        return [pushed / "frames", log or pushed / "forces.csv", like]

    return sources


@pytest.mark.parametrize(
    ("offset_s", "stated_um"),
    [pytest.param(-5.3, 700, marks=pytest.mark.slow), (0.0, 900)],
)
def test_the_offset_of_times_on_another_clock_is_found_and_reported(
    imported, pushed: Path, on_two_clocks, offset_s: float, stated_um: int
) -> None:
    entry, recording = imported(*on_two_clocks(offset_s), f"--thickness-um {stated_um}")
    clock = entry["clock"]
    assert clock["sure"]
    assert clock["offset_s"] == pytest.approx(offset_s, abs=1.5 if offset_s else 0.0)
    assert clock["low_s"] < offset_s < clock["high_s"]
    assert entry["values"]["clock_offset_s"] == "the dents in the frames"
    assert any(note.startswith("clock offset") for note in entry["notes"])
    contradicts = "µm, where 900 µm is stated (option)"
    notes = [note for note in entry["notes"] if "is stated (option)" in note]
    assert [contradicts in note for note in notes] == [True] * (stated_um == 900)
    stated = labels_n(sf.read_recording(pushed))
    np.testing.assert_allclose(labels_n(recording), stated, atol=1e-3)


@pytest.mark.parametrize("given_s", [0.0, 5.3])
def test_an_offset_that_the_frames_contradict_is_kept_with_a_note(
    imported, on_two_clocks, given_s: float
) -> None:
    entry, _ = imported(*on_two_clocks(5.3), f"--clock-offset-s {given_s}")
    for words in ("the dents fit a clock offset of", "the labels are sure to"):
        assert any(words in note for note in entry["notes"]) == (given_s != 5.3)
    assert entry["values"]["clock_offset_s"] == "option"


def test_a_log_of_another_day_is_refused_and_a_terminal_asks(
    asked, refused, on_two_clocks, other_log: Path
) -> None:
    given = on_two_clocks(0.0, other_log)
    error = refused(*given)
    assert "the dents fit the log at no offset better than chance" in error
    assert "--clock-offset-s 0 that both share one" in error
    said = asked(["auto", "0"], *given)
    assert "0: they share one clock; the dents fit" in said
    assert "give a number" in said


@pytest.mark.parametrize(
    ("flip", "turn"), [("rows", np.flipud), ("columns", np.fliplr)]
)
def test_frames_turned_upside_down_and_mirrored_come_back_by_flip(
    imported, tmp_path: Path, flip: str, turn
) -> None:
    (tmp_path / "f").mkdir()
    for number, frame in enumerate(FRAMES):
        cv2.imwrite(str(tmp_path / "f" / f"{number}.png"), turn(frame))
    _, recording = imported(tmp_path / "f", STATED, SIZE, f"--rate-hz 1 --flip {flip}")
    shows(recording, FRAMES)
