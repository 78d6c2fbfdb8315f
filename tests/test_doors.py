"""One question, asked at every door: the same recordings give the same answers, to the
last bit, and the same remarks, whoever reads them.

`evaluate` is the reference. A recording whose frames have a history (tissue that
relaxes, a leak) has to be read in its order; single frames of it are another question,
which no two doors answer differently either.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from analytic_frames import image, recording_toml, tip_of, wall_section
from commands import said
from opinion_process import OpinionProcess
from scanned_planes import write_moments
from waiting import FUSE_S

import scleraforce as sf
from scleraforce.calibration.evaluation import Evaluation
from scleraforce.front.app.recording_views import ReadBy, RecordingViews
from scleraforce.live.companions import process_messages
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor_session import MonitorSession
from scleraforce.live.network.scanner_frame import ScannerFrame
from scleraforce.reading.answer import Answer
from scleraforce.reading.eye_reader import EyeReader
from scleraforce.records.model_folder import SHIPPED_READER

FORCES_N = (0.012, 0.026, 0.015)
KEYS = (
    "predicted",
    "probabilities",
    "predicted_force_mn",
    "interval_mn",
    "elastic_force_mn",
    "lean_deg",
    "pressure_pa",
    "contact_mm",
    "contact_xyz_mm",
    "time_to_bound_ms",
    "wall",
    "usable",
    "reason",
    "remarks",
)
# remarks of a single answer; the others are on the eye
OF_ANSWERS = (
    "methods-disagree",
    "fit-unchecked",
    "surface-alone",
    "plane-left-out",
    "no-history",
    "pierced",
    "population-modulus",
)
Entry = Mapping[str, Any]
Entries = dict[str, Entry]  # by the names of files; of planes the first file's


def write_pushes(
    folder: Path,
    eye: str = "",
    every_s: float = 8.0,
    column: str = "",
    values: Sequence[float] = (),
) -> Path:
    """Write a recording of pushes, and a frame of noise; `eye`: keys of [eye],
    `column`: of frames.csv, with its values.
    """
    (folder / "frames").mkdir(parents=True)
    globe = "" if "globe" in eye else 'globe = "open"\n'
    (folder / "recording.toml").write_text(recording_toml("eye", globe=globe + eye))
    frames = [
        image(wall_section(tip_of(force_n)), seed)
        for seed, force_n in enumerate(FORCES_N)
    ]
    noise = np.random.default_rng(0).integers(0, 4096, frames[0].shape, np.uint16)
    frames.insert(2, noise)
    rows = ["file,time_s" + f",{column}" * bool(column)]
    for number, frame in enumerate(frames):
        assert cv2.imwrite(str(folder / "frames" / f"{number}.png"), frame)
        stated = f",{values[number]}" if column else ""
        rows.append(f"{number}.png,{every_s * (number + 1)}{stated}")

    (folder / "frames.csv").write_text("\n".join([*rows, ""]))
    return folder


def with_a_drawn_wall(folder: Path) -> Path:
    write_pushes(folder)
    wall = sf.segment(folder / "frames" / "1.png")
    drawn = np.where(wall.mask == 255, 255, 0).astype(np.uint8)
    sf.save_wall(folder, "1.png", np.roll(drawn, 2, axis=0), author="tests")
    return folder


RELAXES = "relaxation = [[0.2, 1.0]]\n"
LEAKS = 'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.03\nleak_time_s = 20.0\n'
RECORDINGS: Mapping[str, Callable[[Path], Path]] = {
    "single frames": write_pushes,
    "dense frames": lambda folder: write_pushes(folder, RELAXES, every_s=0.1),
    "leak": lambda folder: write_pushes(folder, LEAKS),
    "pressures": lambda folder: write_pushes(
        folder, column="iop_pa", values=(260.0, 300.0, 300.0, 400.0)
    ),
    "holds": lambda folder: write_pushes(
        folder, RELAXES, 2.0, column="held_s", values=(0.2, 1.0, 1.0, 1.5)
    ),
    "holds of elastic tissue": lambda folder: write_pushes(
        folder, column="held_s", values=(0.2, 1.0, 1.0, 3.0)
    ),
    "masks": with_a_drawn_wall,
    "planes": lambda folder: write_moments(folder, FORCES_N[:2]),
}
WITH_HISTORY = ("dense frames", "leak")
# only the first of a session may be the first push on relaxing tissue
FIRST_OF_ALL = ("holds", "0.png")


BY_DEFAULT = ("single frames", "dense frames", "leak", "planes")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=[] if name in BY_DEFAULT else [pytest.mark.slow])
        for name in RECORDINGS
    ],
)
def recording(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("doors") / "recording"
    return request.param, RECORDINGS[request.param](folder)


def kept(entry: Entry) -> Entry:
    return json.loads(json.dumps({key: entry[key] for key in KEYS}))


def first_files(folder: Path) -> list[str]:
    return [moment[0].file for moment in sf.read_recording(folder).moments]


def by_file(frames: Sequence[Entry], folder: Path) -> Entries:
    """Return the entries of a command; a moment of several planes has one."""
    first = first_files(folder)
    return {
        name: kept(frame)
        for frame in frames
        if (name := Path(frame["file"]).name) in first
    }


def of_answers(answers: Sequence[Answer], folder: Path) -> Entries:
    return {
        file: kept(answer.to_dict())
        for file, answer in zip(first_files(folder), answers, strict=True)
    }


@pytest.fixture(scope="module")
def evaluation(recording: tuple[str, Path]) -> Evaluation:
    return sf.evaluate("default", recording[1])


@pytest.fixture(scope="module")
def expected(recording: tuple[str, Path], evaluation: Evaluation) -> Entries:
    """The entries of `evaluate`."""
    return by_file([frame.to_dict() for frame in evaluation.frames], recording[1])


def moments(folder: Path) -> list[sf.Moment]:
    """Return the moments of a recording as a caller gives them."""
    opened = sf.read_recording(folder)
    return [
        sf.Moment(tuple(sf.Frame(opened.frame_path(entry)) for entry in entries))
        for entries in opened.moments
    ]


def without_notes(answer: Answer) -> Answer:
    """Return an answer without the remarks on its eye, which `evaluate` lists once."""
    own = [remark for remark in answer.remarks if remark.code in OF_ANSWERS]
    return replace(answer, remarks=tuple(own))


def by_command(capsys: pytest.CaptureFixture[str], *words: object) -> list[Entry]:
    return json.loads(said(capsys, *words, "--json"))["frames"]


def test_evaluate_and_read_answer_alike(
    recording: tuple[str, Path], expected: Entries, capsys: pytest.CaptureFixture[str]
) -> None:
    _, folder = recording
    frames = sorted((folder / "frames").iterdir(), reverse=True)
    answers = sf.read("default", moments(folder))
    turned = sf.read("default", moments(folder)[::-1])[::-1]
    command = by_command(capsys, "evaluate", "default", folder)
    read = by_command(capsys, "read", "default", *frames)
    assert by_file(command, folder) == expected
    assert by_file(read, folder) == expected
    assert of_answers(list(map(without_notes, answers)), folder) == expected
    assert of_answers(list(map(without_notes, turned)), folder) == expected


def test_a_frame_by_itself_is_read_alike_and_as_in_its_recording_unless_it_has_a_history(
    recording: tuple[str, Path], expected: Entries, capsys: pytest.CaptureFixture[str]
) -> None:
    name, folder = recording
    views = RecordingViews()
    alone: dict[str, list[Entry]] = {}

    for moment in moments(folder):
        paths = [Path(str(frame.pixels)) for frame in moment.frames]
        answer = without_notes(sf.read("default", moment))
        command = by_command(capsys, "read", "default", *paths)[0]
        looked = views.read_frame(folder, paths[0].name, ReadBy("default"))["answer"]
        alone[paths[0].name] = [kept(answer.to_dict()), kept(command)]
        own = [one for one in looked["remarks"] if one["code"] in OF_ANSWERS]
        alone[paths[0].name].append(kept({**looked, "remarks": own}))

    for file, entries in alone.items():
        assert entries == [entries[0]] * len(entries), file
        has_history = name in WITH_HISTORY or (name, file) == FIRST_OF_ALL
        differs = has_history and entries[0]["usable"]
        assert (entries[0] == expected[file]) == (not differs), file


def test_the_second_opinion_reads_as_a_monitored_eye_reader_does(
    recording: tuple[str, Path], evaluation: Evaluation
) -> None:
    name, folder = recording
    if name in ("masks", "pressures", "holds", "single frames"):
        pytest.skip("a recording states them, no scanner; a leak has single frames too")

    opened = sf.read_recording(folder)
    setup = opened.info.setup
    scale = opened.info.scan.scale
    process = OpinionProcess(
        SHIPPED_READER, setup, planes=opened.info.scan.planes, scale=scale
    )
    process.hear(process_messages.Alive)
    told = []

    for number, entries in enumerate(opened.moments):
        orders = []
        for place, entry in enumerate(entries, 2 * number + 1):
            process.ring.put(place, opened.frame(entry))
            orders.append((entry.plane or "", place, place))
        planes = tuple(orders) if entries[0].plane else ()
        process.ask(orders[-1][1], orders[-1][1], entries[0].time_s, planes=planes)
        opinions = []
        while len(opinions) < len(entries):
            opinions += [process.opinion()]
        told.append(opinions[0].verdict)

    assert process.child.end(FUSE_S) == 0
    answers = [frame.answer for frame in evaluation.frames if not frame.repeats]
    if name == "dense frames":  # before its start a monitor knows nothing
        assert [one.elastic_force_n for one in told] == [
            answer.elastic_force_n for answer in answers
        ]
    else:
        assert told == [answer.verdict for answer in answers]


def test_the_control_loop_reads_what_the_network_reads(
    recording: tuple[str, Path],
) -> None:
    name, folder = recording
    if name != "single frames":
        pytest.skip("the loop reads no planes together, and has no fit")

    opened = sf.read_recording(folder)
    scan = opened.info.scan
    model = sf.load_model("default", wall_finder=None)
    limits = MonitorLimits(
        size=scan.shape, scale_m=(scan.scale.lateral_m, scan.scale.depth_m)
    )
    session = MonitorSession(
        EyeReader(model, opened.info.setup, by="network"), limits, lambda: 0.0
    )
    for number, entry in enumerate(opened.frames, 1):
        pixels = opened.frame(entry)
        shown = ScannerFrame(
            pixels, lateral_m=scan.scale.lateral_m, depth_m=scan.scale.depth_m
        )
        session.take_frame(session.frame(shown, number, 1, entry.time_s))
        expected = sf.read(model, opened.frame_path(entry))
        assert session.answer is not None
        assert session.answer.usable == expected.usable
        if expected.usable:
            network = dict(expected.readings)["network"]
            assert session.answer.force_n == network.force_n
            assert session.answer.interval_n == network.interval_n
