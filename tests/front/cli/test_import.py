"""`import`: recordings from files of other programs, and prompts for missing metadata
on a terminal.
"""

import json
from collections.abc import Callable
from pathlib import Path
from shutil import rmtree

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result
from effects import contents
from foreign_files import (
    COLUMNS,
    COUNT,
    DEPTH_M,
    FRAMES,
    LATERAL_M,
    ROWS,
    options_of,
    stack,
    with_log,
    write_dicom,
    write_frames,
    write_log,
)
from small_recordings import (
    PUSHES_MN,
    looked_at_frames,
    write_pushes,
    write_small_recording,
)

from scleraforce.base.errors import InputError
from scleraforce.front.api.importing import ImportSettings, import_recording
from scleraforce.front.cli import import_command
from scleraforce.front.cli.field_flags import in_flags, json_in_flags
from scleraforce.front.cli.import_command import import_
from scleraforce.front.cli.main import run
from scleraforce.recordings import import_answers
from scleraforce.recordings.forces_under_frames import labels_n
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.scan import Plane
from scleraforce.records.tissue_relaxation import Relaxation


@pytest.fixture
def imported(shell, tmp_path: Path):
    """Import into a new recording, by default `r`; return the object that is printed,
    and the recording.
    """

    def run_import(*arguments: object, out: str = "r") -> tuple[dict, Recording]:
        return shell.json(
            "import", *arguments, "--out", tmp_path / out
        ), read_recording(tmp_path / out)

    return run_import


@pytest.fixture
def refused(shell, tmp_path: Path):
    def refuse(*arguments: object) -> str:
        before = sorted(tmp_path.rglob("*"))
        error = shell.refused("import", *arguments, "--out", tmp_path / "r")
        assert sorted(tmp_path.rglob("*")) == before
        return error

    return refuse


@pytest.fixture
def tiff(tmp_path: Path) -> Path:
    return stack(tmp_path / "a.tif")


def test_frames_and_forces_become_a_recording_with_the_source_of_each_value(
    imported, tiff, tmp_path: Path
) -> None:
    force_n = write_log(tmp_path / "log.csv")
    options = options_of("--bits", 13, "--clock-offset-s", 0.5, "--contact-sign", -1)
    entry, recording = imported(tiff, tmp_path / "log.csv", *options)
    for frame, pixels in zip(recording.frames, FRAMES, strict=True):
        np.testing.assert_array_equal(recording.frame(frame), pixels)

    assert [frame.time_s for frame in recording.frames] == [0.5, 1.5, 2.5, 3.5, 4.5]
    np.testing.assert_allclose(recording.forces.force_n("fz"), force_n, atol=1e-7)
    info = recording.info
    assert (info.scan.width_m, info.scan.depth_m) == pytest.approx(
        (COLUMNS * LATERAL_M, ROWS * DEPTH_M)
    )
    assert (
        info.scan.refractive_index,
        info.scan.bits,
        info.needle.gauge,
        info.eye_name,
    ) == (1.38, 13, 22, "eye-1")
    assert (info.force.axis, info.force.contact_sign) == ("fz", -1)
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
    assert cv2.imread(str(tmp_path / "r" / "preview.png")).shape[1] == pytest.approx(
        170 / 25.4 * 200, abs=2
    )
    imported(tiff, tmp_path / "log.csv", *options, out="s")
    assert contents(tmp_path / "r") == contents(tmp_path / "s")


def test_without_a_terminal_all_missing_metadata_is_named_at_once(
    refused, tmp_path: Path
) -> None:
    for nth in range(2):
        cv2.imwrite(str(tmp_path / f"{nth}.png"), FRAMES[nth])

    write_log(tmp_path / "log.csv")
    error = refused(tmp_path / "0.png", tmp_path / "1.png", tmp_path / "log.csv")
    asked = [
        question
        for name, question in import_answers.QUESTIONS.items()
        if name != "axis"
    ]
    assert [f"({in_flags(question.answered_by)})" in error for question in asked] == [
        not question.optional for question in asked
    ]

    for given, missing in (("--width-mm", "--depth-mm"), ("--depth-mm", "--width-mm")):
        error = refused(tmp_path / "0.png", *options_of("--bits", 16), given, 3)
        assert f"({missing})" in error
        assert f"({given})" not in error


def test_precedence_is_options_then_the_file_then_another_recording(
    imported, tiff, tmp_path: Path
) -> None:
    first, _ = imported(
        tiff, *options_of("--bits", 16), "--width-mm", 9, "--depth-mm", 8
    )
    assert (first["width_mm"], first["values"]["width_mm"]) == (9.0, "option")
    like = ["--like", tmp_path / "r", "--eye", "eye-2"]
    second, _ = imported(tiff, *like, out="s")
    assert second["width_mm"] == pytest.approx(COLUMNS * LATERAL_M * 1e3)
    assert second["values"]["width_mm"] == "ImageJ's unit"
    assert second["values"]["gauge"] == f"like {tmp_path / 'r'}"
    write_dicom(tmp_path / "b.dcm", FRAMES, FrameTime=100.0)
    third, _ = imported(tmp_path / "b.dcm", *like, out="t")
    assert (third["width_mm"], third["values"]["width_mm"]) == (
        9.0,
        f"like {tmp_path / 'r'}",
    )


def test_a_recording_comes_back_from_its_own_files(imported, tmp_path: Path) -> None:
    folder = with_log(write_small_recording(tmp_path / "small", frames=12))
    sources = [
        folder / "frames",
        folder / "forces.csv",
        "--times",
        folder / "frames.csv",
        "--clock-offset-s",
        0,
    ]
    entry, second = imported(*sources, "--like", folder, "--eye", "small")
    first = read_recording(folder)
    assert (second.info, second.frames) == (first.info, first.frames)

    for frame in first.frames:
        np.testing.assert_array_equal(second.frame(frame), first.frame(frame))

    np.testing.assert_allclose(
        second.forces.force_n("fz"), first.forces.force_n("fz"), rtol=1e-6
    )
    assert entry["values"]["times"] == str(folder / "frames.csv")


PLANES = Plane("along", 0.1e-3, 0.0), Plane("across", 0.0, np.pi / 2)
ALONG = ("--plane", "along:0.1:0")
ACROSS = ("--plane=across:0:90",)
NEEDLE = ["--eye", "eye-1", "--gauge", 22, "--refractive-index", 1, "--bits", 13]


@pytest.fixture
def cross(tmp_path: Path) -> list[Path]:
    """A log, and two frames of each of two planes, as folders of pictures whose names
    repeat.
    """
    for folder, first in (("along", 0), ("across", 2)):
        (tmp_path / folder).mkdir()
        for nth in range(2):
            cv2.imwrite(str(tmp_path / folder / f"{nth}.png"), FRAMES[first + nth])
    write_log(tmp_path / "log.csv")
    return [tmp_path / name for name in ("log.csv", "along", "across")]


def test_folders_of_planes_become_one_recording_of_moments(
    imported, cross, tmp_path: Path
) -> None:
    log, along, across = cross
    scale = [
        "--width-mm",
        9,
        "--depth-mm",
        8,
        "--rate-hz",
        0.5,
        "--clock-offset-s",
        0.5,
        "--contact-sign",
        -1,
    ]
    entry, recording = imported(log, *ALONG, along, *ACROSS, across, *NEEDLE, *scale)
    shown = [(frame.time_s, frame.plane) for frame in recording.frames]
    assert shown == [(0.5, "along"), (0.5, "across"), (2.5, "along"), (2.5, "across")]

    for frame, nth in zip(recording.frames, (0, 2, 1, 3), strict=True):
        np.testing.assert_array_equal(recording.frame(frame), FRAMES[nth])

    assert (
        entry["frames"],
        recording.info.scan.planes,
        recording.info.needle.gap_m,
    ) == (4, PLANES, None)
    python = import_recording(
        cross,
        tmp_path / "s",
        eye="eye-1",
        gauge=22,
        bits=13,
        refractive_index=1.0,
        width_m=9e-3,
        depth_m=8e-3,
        rate_hz=0.5,
        clock_offset_s=0.5,
        axis="fz",
        contact_sign=-1,
        settings=ImportSettings(planes=(None, *PLANES)),
    )
    assert (python.info, python.frames) == (recording.info, recording.frames)


def test_times_of_planes_are_shared_and_must_agree(
    imported, refused, tmp_path: Path
) -> None:
    for name, step_s in (("a", 1.0), ("b", 1.1), ("c", 1.5)):
        stack(tmp_path / f"{name}.tif", finterval=step_s)

    _, recording = imported(
        *ALONG, tmp_path / "a.tif", *ACROSS, tmp_path / "b.tif", *NEEDLE, out="t"
    )
    assert [frame.time_s for frame in recording.frames] == np.repeat(
        np.arange(COUNT), 2
    ).tolist()
    apart = [*ALONG, tmp_path / "a.tif", *ACROSS, tmp_path / "c.tif", *NEEDLE]
    assert (
        "frames of one moment differ by 2 s between the planes; give --rate-hz"
        in refused(*apart)
    )
    assert len(imported(*apart, "--rate-hz", 2, out="s")[1].frames) == 2 * COUNT


def test_planes_that_do_not_fit_together_are_refused_in_one_line(
    refused, cross, tmp_path: Path
) -> None:
    log, along, across = cross
    for arguments, words in (
        ((*ALONG, along), "--plane: only one"),
        ((*ALONG, along, *ACROSS, along), "is of two planes"),
        ((*ALONG, *ACROSS, along), "--plane: 'along': no frames follow it"),
        (
            (*ALONG, along, *ACROSS, across, "--plane", "b:1:0", log),
            "'across' has 2, 'b' has 0",
        ),
        (
            (*ALONG, along, "--plane", "along:0:90", across),
            "--plane: name: 'along' is there twice",
        ),
        (
            (along, *ACROSS, across, "--plane", "b:0:0", along),
            f"--plane: missing for {along / '0.png'}",
        ),
        ((*ALONG, along, *ACROSS, across / "0.png"), "'along' has 2, 'across' has 1"),
        (
            (*ALONG, along, *ACROSS, across, "--gap-mm", 0.4),
            "--gap-mm: several planes show their gaps",
        ),
    ):
        assert words in refused(
            *arguments, *NEEDLE, "--width-mm", 9, "--depth-mm", 8, "--rate-hz", 0.5
        )

    for sources, planes, words in (
        ((along, across), PLANES[:1], "^planes: 1 for 2 sources"),
        ((along, along), PLANES[:1] * 2, "^plane: only one"),
        (
            (along, across / "0.png"),
            PLANES,
            "^`planes`: as many frames of each .* 'along' has 2",
        ),
    ):
        with pytest.raises(InputError, match=words):
            import_recording(
                sources, tmp_path / "r", settings=ImportSettings(planes=planes)
            )


def test_moments_that_lack_a_plane_are_written_and_named(
    imported, tmp_path: Path
) -> None:
    along = write_frames(tmp_path / "along", "f1.png", "f2.png", "f4.png")
    across = write_frames(tmp_path / "across", "f1.png", "f3.png", "f4.png")
    sources = [*ALONG, along, *ACROSS, across, *NEEDLE, "--rate-hz", 2]
    entry, recording = imported(
        *sources, "--frames-by", "numbers", "--width-mm", 9, "--depth-mm", 8
    )
    assert [(frame.time_s, frame.plane) for frame in recording.frames] == [
        (0.0, "along"),
        (0.0, "across"),
        (0.5, "along"),
        (1.0, "across"),
        (1.5, "along"),
        (1.5, "across"),
    ]
    for frame, nth in zip(recording.frames, (0, 0, 1, 1, 2, 2), strict=True):
        np.testing.assert_array_equal(recording.frame(frame), FRAMES[nth])

    lacking = [
        f"no 'across' beside {along / 'f2.png'}",
        f"no 'along' beside {across / 'f3.png'}",
    ]
    assert f"2 of 4 moments lack a plane: {', '.join(lacking)}" in entry["notes"]


def test_frames_go_by_the_times_and_numbers_in_their_names(
    imported, refused, tmp_path: Path
) -> None:
    folder = write_frames(tmp_path / "f", "a1.png", "a2.png", "a4.png")
    options = [*options_of("--bits", 16), "--width-mm", 9, "--depth-mm", 8]
    error = refused(small_film(tmp_path), *options, "--frames-by", "order")
    assert "--frames-by: acts on frames in files of their own" in error
    error = refused(folder, *options, "--rate-hz", 2)
    assert error.startswith(f"error: {folder / 'a4.png'}: does not count on")
    assert error.endswith("; give --frames-by\n")
    _, recording = imported(folder, *options, "--rate-hz", 2, "--frames-by", "numbers")
    assert [frame.time_s for frame in recording.frames] == [0.0, 0.5, 1.5]
    entry, recording = imported(folder, *options, "--frames-by", "times:s", out="s")
    assert [frame.time_s for frame in recording.frames] == [1.0, 2.0, 4.0]
    assert entry["values"]["times"] == "the files' names"
    stated = {"eye": "e", "gauge": 22, "gap_m": 6e-4, "bits": 16}
    stated |= {"width_m": 9e-3, "depth_m": 8e-3, "refractive_index": 1.38}
    with pytest.raises(
        InputError, match=r"\(`times`\) settles it, too; give `frames_by`$"
    ):
        import_recording(folder, tmp_path / "t", rate_hz=2.0, **stated)

    python = import_recording(
        folder,
        tmp_path / "t",
        rate_hz=2.0,
        settings=ImportSettings(frames_by="numbers"),
        **stated,
    )
    assert [frame.time_s for frame in python.frames] == [0.0, 0.5, 1.5]


def small_film(tmp_path: Path) -> Path:
    """A film of two frames."""
    path = tmp_path / "a.avi"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5.0, (40, 24))
    for nth in range(2):
        film.write(
            cv2.cvtColor((FRAMES[nth] % 256).astype(np.uint8), cv2.COLOR_GRAY2BGR)
        )

    film.release()
    return path


def test_a_rate_does_not_replace_times_between_which_a_frame_is_lost(
    imported, refused, tmp_path: Path
) -> None:
    folder = tmp_path / "f"
    folder.mkdir()
    for nth, second in enumerate((1, 2, 4, 5)):
        tags = {"ContentTime": f"12000{second}", "PixelSpacing": [0.1, 0.1]}
        write_dicom(folder / f"{nth}.dcm", FRAMES[nth], **tags)

    options = options_of("--bits", 16, "--rate-hz", 2)
    error = refused(folder, *options)
    assert "2.dcm: --rate-hz: it is 2 s after the frame before by DICOM's" in error
    assert "--frames-by order" in error
    _, recording = imported(folder, *options, "--frames-by", "order")
    assert [frame.time_s for frame in recording.frames] == [0.0, 0.5, 1.0, 1.5]
    (folder / "3.dcm").unlink()
    (folder / "0.dcm").unlink()
    assert len(imported(folder, *options, out="s")[1].frames) == 2


def test_damage_is_reported_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    stack(tmp_path / "a.tif")
    write_dicom(tmp_path / "a.dcm", FRAMES)
    (tmp_path / "a.avi").write_bytes(b"RIFF\0\0\0\0AVI LIST" + bytes(500))

    for path in sorted(tmp_path.iterdir()):
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
        assert run(["import", str(path), "--out", str(tmp_path / "r")]) == 2
        error = capfd.readouterr().err  # of the libraries' C code, too
        assert error.startswith(f"error: {path}")
        assert error.count("\n") == 1


def test_the_columns_of_a_log_are_given_once(
    imported, refused, tiff, tmp_path: Path
) -> None:
    lines = [f"{n},{n / 200},{-0.001 * n}" for n in range(400)]
    (tmp_path / "log.csv").write_text("\n".join(["n,when,pull", *lines]) + "\n")
    sources = [tiff, tmp_path / "log.csv", "--clock-offset-s", 0]
    error = refused(*sources, *options_of("--bits", 16))
    assert "There are 'n', 'when', 'pull'; give --column" in error
    columns = [
        "--column",
        "time=when:s",
        "--column",
        "fz=pull:mN",
        "--contact-sign",
        "-1",
    ]

    for out, options in (
        ("r", [*options_of("--bits", 16), *columns]),
        ("s", ["--like", tmp_path / "r", "--eye", "b"]),
    ):
        _, recording = imported(*sources, *options, out=out)
        assert recording.forces.force_n("fz")[100] == pytest.approx(-0.1e-3)


def test_values_that_cannot_be_are_refused(refused, tiff, tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES[0], PixelSpacing=[1.0, 5.0])
    assert "a.dcm: width_m: 0.2 is above the largest allowed value 0.1; " in refused(
        tmp_path / "a.dcm", *options_of()
    )
    assert "--bits says 8" in refused(tiff, *options_of("--bits", 8))

    for option, value in (("--thickness-um", 0.65), ("--iop-mmhg", -1)):
        assert f"Invalid value for '{option}'" in refused(
            tiff, *options_of("--bits", 16, option, value)
        )


@pytest.mark.parametrize(
    ("text", "terms"),
    [("none", ()), ("0.12:1.2,0.15:12", ((0.12, 1.2), (0.15, 12.0)))],
)
def test_the_tissue_is_declared(imported, tiff: Path, text: str, terms: tuple) -> None:
    options = options_of("--bits", 16)
    _, recording = imported(tiff, *options, "--relaxation", text)
    assert recording.info.eye.relaxation == Relaxation.declared(terms)


def test_without_a_declaration_the_tissue_is_unknown(imported, tiff: Path) -> None:
    _, recording = imported(tiff, *options_of("--bits", 16))
    assert recording.info.eye.relaxation is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("elastic", "give none, or SHARE:SECONDS"),
        ("0.1", "give none, or SHARE:SECONDS"),
        ("0.1:2:3", "give none, or SHARE:SECONDS"),
        ("auto", "give none, or SHARE:SECONDS"),
        ("0.6:1,0.5:2", "add up to less than 1"),
        ("0.1:0", "above 0"),
        ("0.1:inf", "not finite"),
        ("nan:1", "add up to less than 1"),
    ],
)
def test_a_relaxation_that_cannot_be_is_refused(
    refused, tiff: Path, text: str, words: str
) -> None:
    options = options_of("--bits", 16)
    assert words in refused(tiff, *options, "--relaxation", text)


def test_a_scale_that_contradicts_the_file_is_noted(imported, tiff) -> None:
    width_mm = COLUMNS * LATERAL_M * 1e3
    same, _ = imported(tiff, *options_of("--bits", 16, "--width-mm", width_mm))
    assert not any("states" in note for note in same["notes"])
    other, _ = imported(
        tiff, *options_of("--bits", 16, "--width-mm", 2 * width_mm), out="s"
    )
    stated = (
        f"width of the frames: {2 * width_mm:g} mm (option), where ImageJ's unit states"
        f" {width_mm:g} mm"
    )
    assert other["notes"][0] == stated


def test_clocks_that_overlap_in_part_are_noted_and_others_are_refused(
    imported, refused, tiff, tmp_path: Path
) -> None:
    write_log(tmp_path / "log.csv")
    sources = (
        tiff,
        tmp_path / "log.csv",
        *options_of("--bits", 16, "--contact-sign", -1),
        "--clock-offset-s",
    )
    error = refused(*sources, 1000)
    assert "the clocks do not overlap: frames at 1000.000 to" in error
    assert "--clock-offset-s brings both to one clock" in error
    entry, _ = imported(*sources, -1.5)
    assert any(
        note.startswith("2 frames were taken before or after the forces")
        for note in entry["notes"]
    )


def test_forces_that_no_needle_gives_are_refused_before_the_recording_exists(
    imported, refused, tiff, tmp_path
) -> None:
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, 8.0, 0.005)
    log = tmp_path / "log.csv"
    options = options_of(
        "--bits", 16, "--clock-offset-s", 2, "--contact-sign", -1, "--column"
    )

    for force_n, noise_n in ((28_780.0, 0.0), (4.0, 0.0), (0.03, 2.0)):
        pushed_n = force_n * np.clip(time_s - 1.0, 0.0, 1.0) + noise_n * rng.normal(
            size=len(time_s)
        )
        np.savetxt(
            log,
            np.column_stack([time_s, -pushed_n]),
            "%.4f",
            ",",
            header="time_s,Fz",
            comments="",
        )
        error = refused(tiff, log, *options, "fz=Fz:N")
        assert f"{log}: fz_n: " in error
        assert "fz=Fz:N" in error
        imported(tiff, log, *options, "fz=Fz:uN", out=f"r-{force_n}")

    write_log(log, rate_hz=10.0)
    error = refused(
        tiff,
        log,
        *options_of("--bits", 16, "--clock-offset-s", 0, "--contact-sign", -1),
    )
    assert f"{log}: time_s: 10 samples a second; at least 20 are needed" in error


def test_an_option_with_nothing_to_act_on_is_refused(
    refused, tiff, tmp_path: Path
) -> None:
    unused = {
        "a force log": (
            "--axis fz",
            "--contact-sign 1",
            "--average-s 1",
            "--clock-offset-s 0",
        ),
        "a force log of text": ("--column fz=a:N",),
        "a ROS bag": ("--image-topic /a", "--force-topic /a", "--by-arrival"),
        "an .npz file": ("--array a",),
    }
    for kind, options in unused.items():
        for option in options:
            error = refused(tiff, *options_of("--bits", 16), *option.split())
            name = option.split()[0]
            assert (
                error
                == f"error: {name}: acts on {kind}, which is not among the sources;"
                " leave it out\n"
            )

    np.save(tmp_path / "a.npy", FRAMES)  # one array, without a name
    options = options_of("--bits", 16, "--axes", "frame,depth,lateral", "--array", "a")
    assert "--array: acts on an .npz file" in refused(tmp_path / "a.npy", *options)


def test_a_bag_gives_frames_and_forces_on_one_clock_that_begins_near_them(
    imported, refused, tmp_path: Path
) -> None:
    from ros_bag import FORCE_TIMES_S, FRAME_TIMES_S, START_NS, write_bag

    bag = write_bag(tmp_path / "bag", "mcap")
    size = [
        "--width-mm",
        10,
        "--depth-mm",
        4,
        "--bits",
        13,
        "--axis",
        "fz",
        "--contact-sign",
        -1,
    ]
    entry, recording = imported(bag, *options_of(*size, "--average-s", 0.1))
    assert entry["clock_origin_s"] == START_NS / 1e9
    np.testing.assert_allclose(
        [frame.time_s for frame in recording.frames], FRAME_TIMES_S, atol=2e-6
    )
    np.testing.assert_allclose(recording.forces.time_s, FORCE_TIMES_S, atol=2e-6)
    assert recording.info.force.average_s == 0.1
    assert any("arrived 80.0 ms" in note for note in entry["notes"])
    # images and forces
    assert sum("messages arrived" in note for note in entry["notes"]) == 2
    assert entry["values"]["times"] == "header.stamp of /oct/image"
    rmtree(tmp_path / "r")
    # the bag has its own times
    error = refused(bag, *options_of(*size, "--rate-hz", 4))
    assert "leave --rate-hz out" in error


def test_a_contradiction_in_a_file_needs_the_options_and_is_noted_then(
    imported, refused, tmp_path: Path
) -> None:
    nominal = {
        "PixelSpacing": [0.004, 0.015],
        "NominalScannedPixelSpacing": [0.01, 0.02],
    }
    write_dicom(tmp_path / "a.dcm", FRAMES, FrameTime=100.0, **nominal)

    for given in ([], ["--width-mm", 6]):
        error = refused(tmp_path / "a.dcm", *given, *options_of("--bits", 13))
        for found in (
            "PixelSpacing",
            "0.004 x 0.015 mm",
            "NominalScannedPixelSpacing",
            "0.01 x 0.02 mm",
            "--width-mm",
        ):
            assert found in error

    entry, _ = imported(
        tmp_path / "a.dcm", *options_of("--bits", 13, "--width-mm", 6, "--depth-mm", 3)
    )
    assert any("NominalScannedPixelSpacing" in note for note in entry["notes"])
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert json_in_flags(kept["notes"]) == entry["notes"]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Import on a terminal, on which these answers are given."""
    monkeypatch.setattr(import_command, "_can_ask", lambda: True)

    def answered(answers: list[str], *arguments: object) -> Result:
        return CliRunner().invoke(
            import_,
            list(map(str, arguments)),
            "".join(f"{answer}\n" for answer in answers),
        )

    return answered


def volume(tmp_path: Path) -> Path:
    np.save(tmp_path / "a.npy", FRAMES)
    return tmp_path / "a.npy"


SCALE = ["--width-mm", 10, "--depth-mm", 4]


def test_an_answer_that_the_source_contradicts_is_asked_for_again(
    asked, tmp_path: Path
) -> None:
    lines = ["when,pull", *(f"{n / 200},{-0.001 * n}" for n in range(400))]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    options = [
        *options_of(
            "--bits", 13, "--rate-hz", 5, "--clock-offset-s", 0, "--contact-sign", -1
        ),
        *SCALE,
    ]
    axes = ["nonsense", "frame,depth", "frame,depth,lateral"]
    columns = ["when:s", "pull:kg", "when:s", "push:N", "when:s", "pull:N"]
    done = asked(
        [*axes, *columns, "-"],
        volume(tmp_path),
        tmp_path / "log.csv",
        "--out",
        tmp_path / "r",
        *options,
    )
    assert done.exit_code == 0, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 4
    assert "'kg'" in errors[2]
    assert "push" in errors[3]
    assert len(read_recording(tmp_path / "r").forces.time_s) == 400


def test_each_answer_is_checked_where_it_is_given(asked, tmp_path: Path) -> None:
    answers = [
        "zwei",
        "-3",
        "10",
        "4",
        "3",
        "1.38",
        "8",
        "13",
        "0",
        "5",
        "",
        "a\teye",
        "eye-1",
        "9",
        "22",
        "0.6",
    ]
    wall = ["0.65", "650"]
    source = [volume(tmp_path), "--axes", "frame,depth,lateral"]
    done = asked([*answers, *wall], *source, "--out", tmp_path / "r")
    assert done.exit_code == 0, done.stderr
    assert done.stderr.count("Error: ") == 8
    info = read_recording(tmp_path / "r").info
    assert (info.eye_name, info.scan.bits, info.needle.gauge) == ("eye-1", 13, 22)
    assert info.eye.thickness_m == pytest.approx(650e-6)
    assert (
        json.loads((tmp_path / "r" / "import.json").read_text())["values"][
            "thickness_um"
        ]
        == "answer"
    )


def test_answers_that_do_not_go_together_are_asked_for_again(
    asked, tmp_path: Path
) -> None:
    write_log(tmp_path / "log.csv")
    source = [
        volume(tmp_path),
        tmp_path / "log.csv",
        "--axes",
        "frame,depth,lateral",
        *SCALE,
    ]
    options = options_of("--bits", 13, "--rate-hz", 5, "--contact-sign", -1)
    done = asked(["1000", "0.5", "-"], *source, "--out", tmp_path / "r", *options)
    assert done.exit_code == 0, done.stderr
    assert "error: " in done.stderr
    assert read_recording(tmp_path / "r").frames[0].time_s == 0.5


@pytest.mark.parametrize(
    "answers", [[], ["10", "4"], ["10", "4", "1", "13", "5", "eye", "22", "0.5"]]
)
def test_one_who_leaves_leaves_nothing_behind(
    asked, tmp_path: Path, answers: list[str]
) -> None:
    source = volume(tmp_path)
    done = asked(
        answers, source, "--axes", "frame,depth,lateral", "--out", tmp_path / "r"
    )
    assert done.exit_code != 0
    assert sorted(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize(
    ("answer", "thickness_um", "stated"),
    [
        ("", 600.0, "measured on the first frames"),
        ("580", 580.0, "answer"),
        ("-", None, None),
    ],
)
def test_the_wall_that_the_frames_show_is_offered(
    asked, tmp_path: Path, answer: str, thickness_um: float | None, stated: str | None
) -> None:
    looked_at_frames(tmp_path / "r", 2)
    source = [
        tmp_path / "r" / "frames",
        "--like",
        tmp_path / "r",
        "--eye",
        "again",
        "--rate-hz",
        1,
    ]
    done = asked([answer], *source, "--out", tmp_path / "s")
    assert done.exit_code == 0, done.stderr
    assert "the first frames show" in done.stderr
    found = read_recording(tmp_path / "s").info.eye.thickness_m
    kept = json.loads((tmp_path / "s" / "import.json").read_text())
    assert kept["values"].get("thickness_um") == stated
    assert (
        (found is None)
        == (thickness_um is None)
        == any("thickness_m" in remark["fields"] for remark in kept["remarks"])
    )

    if thickness_um is not None:
        # drawn along the depth, measured along the normal
        assert found == pytest.approx(thickness_um * 1e-6, rel=0.1)


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual eye with a push for each of twelve frames."""
    return write_pushes(tmp_path_factory.mktemp("pushes") / "eye-a")


def moved_times(folder: Path, table: Path, offset_s: float) -> Path:
    """Write the frames' times on a clock that is behind the log's."""
    frames = read_recording(folder).frames
    lines = ["file,time_s", *(f"{f.file},{f.time_s - offset_s:.4f}" for f in frames)]
    table.write_text("\n".join(lines) + "\n")
    return table


def of_clocks(folder: Path, times: Path, *more: object) -> list[object]:
    sources = [folder / "frames", folder / "forces.csv", "--times", times]
    return [*sources, "--like", folder, "--eye", "eye-a", "--thickness-um", 700, *more]


@pytest.mark.parametrize("offset_s", [3.7, -5.3])
def test_the_offset_of_times_on_another_clock_is_found_and_reported(
    imported, pushed: Path, tmp_path: Path, offset_s: float
) -> None:
    times = moved_times(pushed, tmp_path / "times.csv", offset_s)
    entry, recording = imported(*of_clocks(pushed, times))
    clock = entry["clock"]
    assert clock["sure"]
    assert clock["offset_s"] == pytest.approx(offset_s, abs=1.5)
    assert clock["low_s"] < offset_s < clock["high_s"]
    assert entry["values"]["clock_offset_s"] == "the dents in the frames"
    assert any(note.startswith("clock offset") for note in entry["notes"])
    stated = labels_n(read_recording(pushed))
    np.testing.assert_allclose(labels_n(recording), stated, atol=1e-3)


def test_a_table_on_the_clock_of_the_log_stays_as_it_is(
    imported, pushed: Path, tmp_path: Path
) -> None:
    times = moved_times(pushed, tmp_path / "times.csv", 0.0)
    entry, recording = imported(*of_clocks(pushed, times))
    assert entry["clock"]["offset_s"] == 0.0
    assert recording.frames[0].time_s == read_recording(pushed).frames[0].time_s


def test_a_stated_offset_that_the_dents_contradict_is_kept_with_notes(
    imported, pushed: Path, tmp_path: Path
) -> None:
    times = moved_times(pushed, tmp_path / "times.csv", 5.3)
    entry, _ = imported(*of_clocks(pushed, times, "--clock-offset-s", 0))
    assert entry["values"]["clock_offset_s"] == "option"
    assert any("the dents fit a clock offset of" in note for note in entry["notes"])
    entry, _ = imported(*of_clocks(pushed, times, "--clock-offset-s", 5.3), out="right")
    assert not any("clock offset" in note for note in entry["notes"])


def test_labels_on_a_moving_needle_are_said_to_be_unsure(
    imported, pushed: Path, tmp_path: Path
) -> None:
    times = moved_times(pushed, tmp_path / "times.csv", -3.2)
    entry, _ = imported(*of_clocks(pushed, times, "--clock-offset-s", 0))
    assert any(note.startswith("the labels are sure to") for note in entry["notes"])


def test_a_log_of_another_day_is_refused_and_a_terminal_asks(
    imported, refused, pushed: Path, tmp_path: Path
) -> None:
    other = write_pushes(tmp_path / "other", "other", PUSHES_MN[::-1])
    times = moved_times(pushed, tmp_path / "times.csv", 0.0)
    given = of_clocks(pushed, times)
    given[1] = other / "forces.csv"
    error = refused(*given)
    assert "the dents fit the log at no offset better than chance" in error
    assert "--clock-offset-s 0 that both share one" in error
    imported(*given, "--clock-offset-s", 0)


def test_a_terminal_asks_where_the_dents_leave_the_offset_open(
    asked, pushed: Path, tmp_path: Path
) -> None:
    other = write_pushes(tmp_path / "other", "other", PUSHES_MN[::-1])
    given = of_clocks(pushed, moved_times(pushed, tmp_path / "times.csv", 0.0))
    given[1] = other / "forces.csv"
    done = asked(["auto", "0"], *given, "--out", tmp_path / "asked")
    assert done.exit_code == 0, done.stderr
    assert "0: they share one clock; the dents fit" in done.stderr
    assert "give a number" in done.stderr


def test_a_thickness_that_the_frames_contradict_is_noted(
    imported, pushed: Path, tmp_path: Path
) -> None:
    times = moved_times(pushed, tmp_path / "times.csv", 0.0)
    given = of_clocks(pushed, times, "--thickness-um", 900)
    entry, _ = imported(*given)
    assert any("µm, where 900 µm is stated (option)" in n for n in entry["notes"])
    entry, _ = imported(*of_clocks(pushed, times), out="right")
    assert not any("is stated" in note for note in entry["notes"])


def test_frames_turned_upside_down_and_mirrored_come_back_by_flip(
    imported, pushed: Path, tmp_path: Path
) -> None:
    first = read_recording(pushed)
    for flip, turn in (("rows", np.flipud), ("columns", np.fliplr)):
        folder = tmp_path / flip
        folder.mkdir()
        for frame in first.frames[:3]:
            cv2.imwrite(str(folder / frame.file), turn(first.frame(frame)))
        given = ["--like", pushed, "--eye", "eye-a", "--rate-hz", 1, "--flip", flip]
        entry, second = imported(folder, *given, out=f"r-{flip}")
        assert entry["notes"] is not None
        for frame, before in zip(second.frames, first.frames, strict=False):
            np.testing.assert_array_equal(second.frame(frame), first.frame(before))
