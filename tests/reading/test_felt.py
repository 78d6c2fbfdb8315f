"""The force on the needle from readings of dents: in tissue that remembers, along a
needle that leans; the pressure of an eye that leaks.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from relaxing_eyes import BOUNDS_N, FORCES_N, TISSUE, found_in, pushed, read_as

from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.fit import unknowns
from scleraforce.lab.needle_pushes import NeedlePath
from scleraforce.reading.answer import Answer, Reading, unusable_answer
from scleraforce.reading.tissue_memory import Leak, TissueMemory
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import UNKNOWN, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import Relaxation

MOST_N = 60e-3
DECLARED = Relaxation.declared(TISSUE.terms)
NOTHING = (0.0, 0.0)
RESTED = replace(DECLARED, before_n=NOTHING, before_covariance_n2=(NOTHING, NOTHING))
CORNERS_S = (0.0, 2.0, 3.0, 8.0, 8.5, 14.0, 15.0, 18.0, 19.0, 24.0)
CORNERS_N = (0.0, 0.0, 0.03, 0.03, 0.012, 0.012, 0.0, 0.0, 0.045, 0.045)
HELD = NeedlePath((0.0, 0.5, 60.0), (0.0, 0.03, 0.03), TISSUE)


def memory(
    relaxation: Relaxation | None = DECLARED, *, monitored: bool = False
) -> TissueMemory:
    begin = TissueMemory.monitored if monitored else TissueMemory.unknown
    return begin(Setup(eye=Eye(relaxation=relaxation)), MOST_N)


def follow(
    path: NeedlePath, times_s: np.ndarray, history: TissueMemory
) -> tuple[list[Answer], TissueMemory]:
    """Return the answers to the dents of a path, and the history after them."""
    answers = []
    for time_s, elastic_n in zip(times_s, path.elastic_n(times_s), strict=True):
        answer, history = history.read(
            read_as(float(elastic_n)), BOUNDS_N, float(time_s)
        )
        answers.append(answer)

    return answers, history


def forces_n(answers: Sequence[Answer]) -> np.ndarray:
    return np.array([answer.force_n for answer in answers])


def widths_n(answers: Sequence[Answer]) -> np.ndarray:
    return np.array([np.ptp(answer.interval_n) for answer in answers])


def held_share(answers: Sequence[Answer], felt_n: np.ndarray) -> float:
    """Return the share of the intervals that hold the felt force."""
    low_n, high_n = np.array([answer.interval_n for answer in answers]).T
    return float(np.mean((low_n <= felt_n) & (felt_n <= high_n)))


@pytest.mark.parametrize(
    ("history", "every_s"), [(memory(RESTED), 0.1), (memory(monitored=True), 0.01)]
)
def test_a_dense_sequence_from_rest_gives_the_felt_force(
    history: TissueMemory, every_s: float
):
    path = NeedlePath(CORNERS_S, CORNERS_N, TISSUE)
    times_s = np.arange(0.1, 24.0, every_s)
    answers, _ = follow(path, times_s, history)
    felt_n = path.felt_n(times_s)
    # corners lie between frames
    assert forces_n(answers) == pytest.approx(felt_n, abs=1e-3 * every_s + 0.04e-3)
    elastic_n = [answer.elastic_force_n for answer in answers]
    assert elastic_n == pytest.approx(path.elastic_n(times_s), abs=1e-15)
    lifted = (times_s > 15.5) & (times_s < 17.9)
    assert (forces_n(answers)[lifted] == 0.0).all()
    classes = np.searchsorted(BOUNDS_N, forces_n(answers))
    predicted = np.array([answer.predicted for answer in answers])
    np.testing.assert_array_equal(predicted[felt_n > 0.0], classes[felt_n > 0.0])


def random_paths(count: int) -> Iterator[NeedlePath]:
    """Needles that move as they like, up to 50 mN, and reach 20 mN at 8 s at the
    latest.
    """
    rng = np.random.default_rng(3)
    for _ in range(count):
        corners_s = np.sort(rng.uniform(0.1, 7.8, 8))
        corners_n = rng.choice([0.0, 0.05, 0.02], 8) * rng.uniform(0.5, 1.0, 8)
        yield NeedlePath(
            (0.0, *corners_s, 8.0, 60.0), (0.0, *corners_n, 0.02, 0.02), TISSUE
        )


@pytest.mark.parametrize(
    ("monitored", "paths", "start_s"),
    [(True, random_paths(8), 8.0), (False, [HELD], 0.6)],
)
def test_an_unknown_history_is_held_forgotten_and_its_interval_narrows(
    monitored: bool, paths: Iterator[NeedlePath], start_s: float
):
    times_s = np.arange(start_s, 60.0, 0.1)
    for path in paths:
        answers, _ = follow(path, times_s, memory(monitored=monitored))
        felt_n = path.felt_n(times_s)
        # in the first seconds after rest one in ten may be rarer
        assert held_share(answers, felt_n) >= (1.0 if monitored else 0.9)
        assert forces_n(answers)[-1] == pytest.approx(felt_n[-1], abs=0.1e-3)
        widths = widths_n(answers)
        assert (np.diff(widths[:100]) < 1e-9).all()  # and no bound jumps
        assert widths[-1] < 0.4 * widths[0]


@pytest.mark.parametrize("later_s", [2.0, 2.5])
def test_a_gap_widens_the_interval_and_unusable_frames_are_gaps(later_s: float):
    (*_, before), history = follow(HELD, np.arange(0.5, 30.0, 0.1), memory())
    for time_s in np.arange(30.0, 32.0, 0.1):
        refused, same = history.read(unusable_answer(3, "no wall"), BOUNDS_N, time_s)
        assert refused.force_n is None
        assert same is history

    (after,), _ = follow(HELD, np.array([30.0 + later_s]), history)
    assert np.ptp(after.interval_n) > 1.3 * np.ptp(before.interval_n)


def test_each_gap_of_a_monitor_widens_the_interval_around_all_that_may_have_been():
    after_s = np.arange(8.0, 30.0, 0.1)
    for path in random_paths(8):
        start = memory(monitored=True)
        _, history = follow(path, np.arange(0.0, 0.1, 0.01), start)
        # a monitor never gives a single frame the history of the calibration
        for gap_s in (0.0, 1.0, 2.5):
            late, after = follow(path, after_s + gap_s, history)
            assert held_share(late, path.felt_n(after_s + gap_s)) == 1.0
            history = after if gap_s else history


def test_a_reading_of_nan_does_not_enter_the_history():
    _, history = follow(HELD, np.arange(0.0, 1.0, 0.01), memory(monitored=True))
    answer = replace(read_as(0.01), force_n=float("nan"))
    assert history.read(answer, BOUNDS_N, 1.0) == (answer, history)


@pytest.mark.parametrize("alone", [False, True])
def test_frames_held_as_in_the_calibration_need_no_history(alone: bool):
    pushes, path = pushed(TISSUE, np.random.default_rng(5), FORCES_N[::-1])
    frame_s = np.array([push.frame_s for push in pushes])
    history = memory(found_in(TISSUE, 0).relaxation)
    answers = []
    for time_s, elastic_n in zip(frame_s, path.elastic_n(frame_s), strict=True):
        answer, after = history.read(
            read_as(float(elastic_n)), BOUNDS_N, None if alone else float(time_s)
        )
        history = history if alone else after
        answers.append(answer)

    felt_n = path.felt_n(frame_s)
    # the dents show 3 to 9 mN more
    assert np.mean(np.abs(forces_n(answers) - felt_n)) < 1.0e-3
    assert held_share(answers, felt_n) > 0.7


def test_a_known_hold_gives_the_force_of_a_frame_that_is_not_held_as_in_the_calibration():
    known = found_in(TISSUE, 0).relaxation
    nothing = (0.0,) * len(known.shares)
    rested = memory(
        replace(known, before_n=nothing, before_covariance_n2=(nothing,) * len(nothing))
    )
    holds_s = (0.2, 0.5, 1.0, 20.0)
    told = [rested.read(read_as(0.03), BOUNDS_N, held_s=s)[0] for s in holds_s]
    felt_n = HELD.felt_n(0.25 + np.array(holds_s))
    assert held_share(told[1:], felt_n[1:]) == 1.0
    assert told[0].force_n > told[-1].force_n + 2e-3


@pytest.mark.parametrize(
    "relaxation",
    [None, Relaxation.declared(()), Relaxation.of([0.0], [1.0], np.eye(1), "holds")],
)
def test_elastic_tissue_and_tissue_of_which_nothing_is_known_keep_the_answer(
    relaxation: Relaxation | None,
):
    answer = read_as(0.02)
    assert memory(relaxation).read(answer, BOUNDS_N, 1.0)[0] is answer


def test_the_readings_of_each_method_are_turned_as_the_answer_is():
    answer = read_as(0.03)
    reading = Reading(
        probabilities=(0.0, 1.0, 0.0),
        force_n=0.03,
        interval_n=answer.interval_n,
        contact_m=0.0,
    )
    both = replace(answer, readings=(("fit", reading),))
    turned, _ = memory().read(both, BOUNDS_N)
    ((_, found),) = turned.readings
    assert (found.force_n, found.interval_n) == (turned.force_n, turned.interval_n)
    assert sum(found.probabilities) == pytest.approx(1.0)
    assert found.probabilities[1] == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("monitored", [False, True])
@pytest.mark.parametrize("elastic_mn", [45.0, 52.0, 80.0])
def test_harmless_is_never_likelier_than_considerable_above_both(
    elastic_mn: float, monitored: bool
):
    """Also where the force may have been all that an eye bears."""
    history = memory(monitored=monitored)
    found, _ = history.read(read_as(1e-3 * elastic_mn), BOUNDS_N, 1.0)
    assert found.force_n > BOUNDS_N[1]
    assert sum(found.probabilities) == pytest.approx(1.0)
    assert found.probabilities[0] <= found.probabilities[1] < found.probabilities[2]


OWN = Modulus(mean_pa=0.3e6, sd_pa=3e3, source="own")
OTHERS = replace(OWN, source="population")
DEG = np.pi / 180.0
SIDE = 45 * DEG
LEAN_SD = np.hypot(0.06, 2 * DEG)  # of the force, relative, as docs say


def leaning(
    *lean_rad: float,
    modulus: Modulus | None = None,
    before_rad: float | None = None,
    azimuth_rad: float | None = None,
) -> Setup:
    """Setup of a needle that leans between two angles, of an eye whose calibration
    knew its own needle's.
    """
    needle = Needle(lean_rad=lean_rad or None, lean_azimuth_rad=azimuth_rad)
    return Setup(
        eye=Eye(modulus=modulus, calibrated_lean_rad=before_rad), needle=needle
    )


# what is known; the factors of the force along the needle: least, likeliest, most;
# leans that differ, if any
LEANS = {
    "declared": (
        leaning(0.5, 0.5),
        (np.cos(0.5), 1 / np.cos(0.5), 1 / np.cos(0.5)),
        (0.5,),
    ),
    "not known": (
        leaning(0.0, SIDE),
        (np.sqrt(0.5), 1 / np.cos(SIDE / 2), np.sqrt(2.0)),
        (SIDE / 2,),
    ),
    "as in the calibration": (
        leaning(modulus=OWN, before_rad=0.3),
        (1 / np.cos(0.3),) * 3,
        (),
    ),
    "declared again": (
        leaning(0.33, 0.33, modulus=OWN, before_rad=0.3),
        (1 / np.cos(0.33),) * 3,
        (),
    ),
    "another one": (
        leaning(0.6, 0.6, modulus=OWN, before_rad=0.3),
        (np.cos(0.6) / np.cos(0.3) ** 2, 1 / np.cos(0.6), 1 / np.cos(0.6)),
        (0.3, 0.6),
    ),
    "upright after a lean": (
        leaning(0.0, 0.0, modulus=OWN, before_rad=0.6),
        (1.0, 1.0, 1 / np.cos(0.6) ** 2),
        (0.6,),
    ),
    "nothing is said": (Setup(), (1.0,) * 3, ()),
    "absorbed": (leaning(modulus=OWN), (1.0,) * 3, ()),
    "not in the calibration": (
        leaning(0.0, 0.0, modulus=OTHERS),
        (np.sqrt(0.5), 1.0, np.sqrt(2.0)),
        (SIDE / 2,),
    ),
    "known nowhere": (
        leaning(0.0, SIDE, modulus=OWN),
        (np.sqrt(0.5), 1.0, np.sqrt(2.0)),
        (SIDE / 2, SIDE / 2),
    ),
}


@pytest.mark.parametrize("case", LEANS)
@pytest.mark.parametrize("relaxation", [None, DECLARED])
def test_a_needle_that_leans_feels_the_force_along_it(
    case: str, relaxation: Relaxation | None
):
    known, (least, factor, most), others = LEANS[case]
    known = replace(known, eye=replace(known.eye, relaxation=relaxation))
    elastic = read_as(0.02)
    upright, _ = memory(relaxation).read(elastic, BOUNDS_N)
    found, _ = TissueMemory.unknown(known, MOST_N).read(elastic, BOUNDS_N)
    force_n = upright.force_n
    assert found.force_n == pytest.approx(factor * force_n)

    ends_n = factor * np.array(upright.interval_n)
    if others and relaxation is None:
        sd_n = LEAN_SD * np.sqrt(sum(np.tan(other) ** 2 for other in others)) * force_n
        reach_n = np.hypot(ends_n - factor * force_n, factor * NINETY_PERCENT * sd_n)
        ends_n = np.array([least, most]) * force_n + reach_n * np.array([-1.0, 1.0])
    if relaxation is None or not others:
        assert found.interval_n == pytest.approx(ends_n.clip(min=0.0))

    assert (found.lean_rad is None) == (case in ("nothing is said", "absorbed"))
    is_remarked = case in ("not in the calibration", "known nowhere")
    assert bool(found.warnings) == is_remarked


def with_shaft(known: Setup, angle_rad: float | None) -> Answer:
    """Return the answer to a frame in which the shaft is seen at an angle from the
    normal of a wall that is turned in the picture.
    """
    turned = np.zeros(30)
    turned[unknowns.ROTATION] = TURNED
    seen = None if angle_rad is None else TURNED + angle_rad
    needle = None if seen is None else SimpleNamespace(angle_rad=seen)
    fit = SimpleNamespace(unknown=turned)
    wall = SimpleNamespace(needle=needle)
    elastic = replace(read_as(0.02), fit=fit, segmentation=wall)
    return TissueMemory.unknown(known, MOST_N).read(elastic, BOUNDS_N)[0]


TURNED = 7 * DEG
SEEN = 30 * DEG


@pytest.mark.parametrize("known", [Setup(), leaning(modulus=OWN)])
def test_a_shaft_in_the_picture_gives_the_lean_where_nothing_else_does(
    known: Setup,
):
    assert with_shaft(known, -SEEN).lean_rad == pytest.approx((SEEN, SEEN))
    declared = with_shaft(leaning(SEEN, SEEN), None)
    absorbed = known.eye.modulus is not None
    found = with_shaft(known, -SEEN)
    assert (found.interval_n == declared.interval_n) == (not absorbed)
    assert with_shaft(known, 1.5).lean_rad is None  # no needle leans so


@pytest.mark.parametrize(
    ("known", "contradicts"),
    [
        # it may lean out of the picture, too
        (leaning(SIDE, SIDE), False),
        (leaning(SIDE, SIDE, azimuth_rad=0.0), True),
        (leaning(0.1, 0.1), True),
        (leaning(SIDE, SIDE, azimuth_rad=np.arccos(np.tan(SEEN))), False),
        (leaning(SEEN, SEEN, azimuth_rad=np.pi), True),  # to the other side
        (leaning(0.0, SIDE, azimuth_rad=0.0), False),
    ],
)
def test_a_shaft_in_the_picture_may_contradict_the_declared_lean(
    known: Setup, contradicts: bool
):
    found = with_shaft(known, SEEN)
    assert found.lean_rad == known.needle.lean_rad
    codes = [remark.code for remark in found.remarks]
    assert codes == ["lean-contradicted"] * contradicts


GLOBE = Globe.declared("sealed", 1e8, leak_time_s=20.0)
LAW = GLOBE.pressure_law(GLOBE.mean)
LEAKING = Setup(eye=Eye(iop_pa=300.0, globe=GLOBE))
DENT_M3 = 10e-9
REFUSED = SimpleNamespace(iop_at_dent_pa=None)


def shown(setup: Setup) -> tuple[SimpleNamespace]:
    """Return a reader's answer to a dent that stays."""
    rest_pa = setup.eye.iop_pa
    pressure_pa = float(LAW.pressure(rest_pa, DENT_M3))
    return (SimpleNamespace(rest_pa=rest_pa, iop_at_dent_pa=pressure_pa),)


@pytest.mark.parametrize("every_s", [0.1, 5.0])
def test_a_dent_that_stays_leaks_in_dense_sequences_and_in_sparse_ones_whose_holds_are_known(
    every_s: float,
):
    leak = Leak()
    rests_pa = []
    times_s = np.arange(0.0, 30.0, every_s)
    for time_s in times_s.tolist():
        (answer,), leak = leak.read(shown, LEAKING, time_s, every_s)
        rests_pa.append(answer.rest_pa)

    leaked_m3 = DENT_M3 * (1.0 - np.exp(-times_s / 20.0))
    assert rests_pa == pytest.approx(LAW.pressure(300.0, -leaked_m3), rel=2e-3)


def test_frames_that_are_refused_leave_the_leak_as_it_was():
    leak = Leak()
    for time_s in (0.0, 0.2, 10.0, 20.0):
        (low,), leak = leak.read(shown, LEAKING, time_s, 10.0)

    assert low.rest_pa < 0.9 * 300.0
    _, after = leak.read(lambda _: (REFUSED,), LEAKING, 20.2, None)
    assert after == leak
    # a minute without the needle, as far as anything shows it
    (late,), _ = leak.read(shown, LEAKING, 140.0, 1.0)
    assert low.rest_pa < late.rest_pa < 300.0


def test_a_pressure_that_is_stated_takes_the_place_of_the_leak():
    at_250 = shown(replace(LEAKING, eye=replace(LEAKING.eye, iop_pa=250.0)))
    leak = Leak().at_pressure(250.0, LEAKING.eye, at_250, 10.0)
    (answer,), _ = leak.read(shown, LEAKING, 10.0, None)
    assert answer.rest_pa == pytest.approx(250.0)
    assert leak.at_pressure(280.0, LEAKING.eye, (REFUSED,), 11.0) == leak


@pytest.mark.parametrize(
    "globe",
    [
        replace(GLOBE, leak_time_s=None),
        Globe.declared("open"),
        replace(UNKNOWN, leak_time_s=9.0),  # of an eye of unknown pressure
    ],
)
def test_an_eye_that_does_not_leak_keeps_its_pressure(globe: Globe):
    iop_pa = None if globe.kind == "unknown" else 300.0
    known = Setup(eye=Eye(iop_pa=iop_pa, globe=globe))
    assert Leak().read(lambda now: now, known, 5.0, None) == (known, Leak())
