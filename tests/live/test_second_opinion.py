"""The second opinion's process: it reads frames from the ring with all that a model
has, and learns the eye's E.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import KNOWN, LIBRARY, STUDY, image, tip_of, wall_section
from opinion_process import OpinionProcess
from scanned_planes import CROSS, cut_wall
from small_models import write_fixed_reader
from waiting import FUSE_S

from scleraforce.base.errors import InputError
from scleraforce.live.companions import process_messages
from scleraforce.live.companions.eye_learning import LEARNED_FILE, resumed_eye
from scleraforce.records.eye import Modulus
from scleraforce.records.tissue_relaxation import Relaxation

pytest.importorskip("torch")

BINS = 64  # what the network says always
BIN = 20  # the fit is the one that answers
RELAXING = replace(
    KNOWN, eye=replace(KNOWN.eye, relaxation=Relaxation.declared([[0.2, 1.0]]))
)
assert KNOWN.eye.modulus is not None
PRIOR = Modulus(
    mean_pa=1.15 * KNOWN.eye.modulus.mean_pa,
    sd_pa=0.25 * KNOWN.eye.modulus.mean_pa,
    source="population",
)
EYE = replace(KNOWN, eye=replace(KNOWN.eye, modulus=PRIOR))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("opinion") / "reader"
    write_fixed_reader(
        folder, LIBRARY, [float(number == BIN) for number in range(BINS)]
    )
    return folder


@pytest.fixture(scope="module")
def reader(model: Path) -> Iterator[OpinionProcess]:
    reader = OpinionProcess(model, RELAXING)
    # it has read a frame of its own, and is ready
    assert reader.hear(process_messages.Alive) == [process_messages.Alive(faults=())]
    yield reader
    assert reader.child.end(FUSE_S) == 0


def test_a_wall_is_read_with_its_force_by_the_fit(reader):
    reader.ring.put(1, image(wall_section(tip_of(0.015))))
    reader.ask(1, 71)
    opinion = reader.opinion()
    assert (opinion.order, opinion.verdict.usable, opinion.verdict.predicted) == (
        71,
        True,
        1,
    )
    assert opinion.verdict.force_n == pytest.approx(0.015, abs=1.2e-3)
    assert opinion.verdict.interval_n
    assert opinion.verdict.probabilities
    assert opinion.verdict.interval_n[0] < 0.015 < opinion.verdict.interval_n[1]
    assert sum(opinion.verdict.probabilities) == pytest.approx(1.0)


def test_of_frames_that_wait_the_newest_is_read_and_one_that_is_gone_is_left_out(
    reader,
):
    for number, force_n in ((3, 0.003), (4, 0.012), (5, 0.020)):
        reader.ring.put(number, image(wall_section(tip_of(force_n))))
    reader.ask(1, 80)  # gone: frame 5 took its place
    reader.ask(5, 85)
    assert reader.opinion().order == 85


def test_it_keeps_a_history_of_its_own_by_the_times_of_the_frames(
    reader,
):
    verdicts = []
    for turn in range(12):  # a hold of three seconds, after an unknown time
        reader.ring.put(10 + turn, image(wall_section(tip_of(0.015)), turn))
        reader.ask(10 + turn, 100 + turn, 100.0 + 0.25 * turn)
        verdicts.append(reader.opinion().verdict)

    assert [verdict.elastic_force_n for verdict in verdicts] == pytest.approx(
        [0.015] * 12, abs=1.2e-3
    )
    assert verdicts[-1].force_n / verdicts[-1].elastic_force_n == pytest.approx(
        0.805, abs=0.01
    )
    assert verdicts[0].force_n - verdicts[0].interval_n[0] > 4 * (
        verdicts[-1].force_n - verdicts[-1].interval_n[0]
    )


def test_frames_of_several_planes_are_read_together_and_one_that_is_left_out_is_not_judged(
    model,
):
    cross = OpinionProcess(model, KNOWN, planes=CROSS)
    assert cross.hear(process_messages.Alive) == [process_messages.Alive(faults=())]
    contact_m = (0.15e-3, -0.5e-3, 0.5e-3)

    for number, plane in enumerate(CROSS, 1):
        cross.ring.put(number, image(cut_wall(plane, tip_of(0.015), contact_m), number))

    cross.ring.put(3, np.zeros((STUDY.oct.rows, STUDY.oct.columns), np.uint16))
    asked = [("across", 2, 72), ("along", 1, 71)]  # as they came
    cross.ask(2, 72, planes=tuple(asked))
    first = cross.opinion()
    second = cross.opinion()
    assert [(one.plane, one.order, one.verdict.usable) for one in (first, second)] == [
        ("along", 71, True),
        ("across", 72, True),
    ]
    assert first.verdict == second.verdict
    assert first.verdict.force_n == pytest.approx(0.015, abs=1.2e-3)
    assert first.contact_m is not None
    assert first.contact_m[:2] == pytest.approx(contact_m[:2], abs=0.1e-3)
    cross.ask(3, 73, planes=(("along", 1, 71), ("across", 3, 73)))
    seen = cross.opinion()
    dark = cross.opinion()
    assert (seen.verdict.usable, dark.verdict.usable, dark.contact_m) == (
        True,
        False,
        None,
    )
    assert dark.verdict.reason
    assert dark.verdict.reason.startswith("left out: plane across: ")
    assert cross.child.end(FUSE_S) == 0


@pytest.mark.slow
def test_frames_that_teach_move_e_a_puncture_takes_it_back_and_a_session_can_be_resumed(
    model, tmp_path
):
    learning = OpinionProcess(model, EYE, tmp_path)
    learning.hear(process_messages.Alive)
    learning.show(0.025, teaches=False)
    taught_n = (0.005, 0.010, 0.015, 0.020)
    for force_n in taught_n:
        learning.show(force_n)

    found = learning.learned()
    while found.frames < len(taught_n):
        found = learning.learned()

    assert found.fault == ""
    assert found.frames == len(taught_n)
    modulus = found.setup.eye.modulus
    assert modulus is not None
    assert modulus.source == "shape"
    # models read it beside the eye before
    assert found.setup.eye.unlearned == EYE.eye
    # one shallow dent tells little
    assert modulus.relative_sd == pytest.approx(PRIOR.relative_sd, rel=0.05)
    again = resumed_eye(EYE, tmp_path / LEARNED_FILE, "eye-a")
    assert again.eye.modulus is not None
    assert again.eye.modulus.source == "population"
    assert again.eye.unlearned == EYE.eye
    assert again.eye.modulus.sd_pa == pytest.approx(PRIOR.sd_pa, rel=0.1)

    for eye, name, words in (
        (EYE.eye, "eye-b", "not of eye-b"),
        (replace(EYE.eye, iop_pa=2000.0), "eye-a", r"learned at 2\.0 mmHg"),
        (
            replace(EYE.eye, stiffening=10.0),
            "eye-a",
            "stiffening: 0; that of this eye is 10",
        ),
    ):
        with pytest.raises(InputError, match=words):
            resumed_eye(replace(EYE, eye=eye), tmp_path / LEARNED_FILE, name)

    learning.show(0.020, teaches=False, pierced=True)
    forgotten = learning.learned(teaches=False)
    assert forgotten.frames == 0
    assert forgotten.setup == EYE
    assert learning.child.end(FUSE_S) == 0
