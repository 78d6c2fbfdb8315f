"""The reader of an eye: its memory, its remarks, the pressure of a moment."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import KNOWN, SCALE, image, tip_of, wall_section
from small_models import FIVE_MN, force_reader

from scleraforce.reading.answer import Answer
from scleraforce.reading.eye_reader import EyeReader, Memory, MomentFrame, OpenedMoment
from scleraforce.records.globe import REFERENCE_RIGIDITY, Globe
from scleraforce.records.tissue_relaxation import Relaxation

RELAXING = replace(
    KNOWN, eye=replace(KNOWN.eye, relaxation=Relaxation.declared([[0.2, 1.0]]))
)
LEAKING = replace(
    KNOWN,
    eye=replace(
        KNOWN.eye, globe=Globe.declared("sealed", REFERENCE_RIGIDITY, leak_time_s=20.0)
    ),
)


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    return image(wall_section(tip_of(0.015)))


@pytest.fixture(scope="module")
def noise(frame: np.ndarray) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 4096, frame.shape, np.uint16)


def read(
    reader: EyeReader, pixels: np.ndarray, memory: Memory | None = None, **stated: float
) -> tuple[Answer, Memory]:
    moment = OpenedMoment((MomentFrame(pixels),), SCALE, **stated)
    (answer,), after = reader.read(moment, memory or reader.start())
    return answer, after


@pytest.mark.parametrize(
    "setup", [KNOWN, RELAXING, LEAKING], ids=["", "tissue", "leak"]
)
@pytest.mark.parametrize("monitored", [False, True])
def test_a_frame_that_cannot_be_judged_leaves_the_memory_as_it_was(
    frame: np.ndarray, noise: np.ndarray, setup, monitored: bool
) -> None:
    reader = EyeReader(force_reader(), setup)
    memory = reader.start(monitored=monitored)
    _, memory = read(reader, frame, memory, time_s=1.0)
    answer, after = read(reader, noise, memory, time_s=1.1)
    assert not answer.usable
    assert vars(after) == vars(memory)


def test_a_moment_before_the_last_one_begins_a_new_sequence(frame: np.ndarray) -> None:
    reader = EyeReader(force_reader(), RELAXING)
    first, memory = read(reader, frame, time_s=5.0)
    later, memory = read(reader, frame, memory, time_s=5.1)
    assert later.force_n != first.force_n
    again, _ = read(reader, frame, memory, time_s=5.0)
    assert again.verdict == first.verdict


def test_a_single_frame_says_what_it_does_not_know_of_the_time_before(
    noise: np.ndarray,
) -> None:
    # a dent so shallow that an open and a sealed globe are nearly the same
    shallow = image(wall_section(tip_of(0.004)))

    def fields(setup, pixels: np.ndarray = shallow, **stated: float) -> list[str]:
        answer, _ = read(EyeReader(force_reader(), setup), pixels, **stated)
        return [field for one in answer.remarks for field in one.fields]

    assert fields(KNOWN) == []
    assert fields(RELAXING) == ["relaxation"]
    assert fields(LEAKING) == ["leak_time_s"]
    assert fields(LEAKING, noise) == []
    assert fields(LEAKING, iop_pa=250.0) == []  # which the leak has left
    assert fields(RELAXING, held_s=2.0) == []
    assert fields(RELAXING, time_s=1.0) == fields(LEAKING, time_s=1.0) == []


def test_a_moment_is_read_at_its_pressure_as_if_the_eye_had_it(
    frame: np.ndarray,
) -> None:
    reader = EyeReader(force_reader(), KNOWN)
    iop_pa = 1.3 * KNOWN.eye.iop_pa
    other = replace(KNOWN, eye=replace(KNOWN.eye, iop_pa=iop_pa))
    expected, _ = read(EyeReader(force_reader(), other), frame)
    answer, _ = read(reader, frame, iop_pa=iop_pa)
    usual, _ = read(reader, frame)
    assert answer.verdict == expected.verdict != usual.verdict


def test_a_puncture_is_remarked_unless_somebody_says_that_there_was_none(
    frame: np.ndarray,
) -> None:
    shallow = image(wall_section(tip_of(0.004)))
    for pierced, expected in ((None, ["pierced"]), (False, [])):
        reader = EyeReader(force_reader(FIVE_MN), KNOWN)
        memory = reader.start()
        found = list[str]()
        for number, pixels in enumerate((frame,) * 6 + (shallow,) * 3):
            moment = OpenedMoment(
                (MomentFrame(pixels),), SCALE, 0.01 * number, pierced=pierced
            )
            (answer,), memory = reader.read(moment, memory)
            found += (remark.code for remark in answer.remarks)

        assert [code for code in dict.fromkeys(found) if code == "pierced"] == expected
        assert bool(memory.punctures_s) == bool(expected)
