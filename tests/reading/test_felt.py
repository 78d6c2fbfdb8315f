"""The force on the needle from readings of dents, in tissue that remembers; the
pressure of an eye that leaks.
"""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from relaxing_eyes import BOUNDS_N, FORCES_N, TISSUE, found_in, pushed, read_as

from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.base.units import to_si
from scleraforce.lab.needle_pushes import NeedlePath
from scleraforce.reading.answer import Reading, unusable_answer
from scleraforce.reading.needle_lean import LEAN_SD, NeedleLean
from scleraforce.reading.tissue_memory import DENSE_S, FeltForce, Leak, TissueMemory
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import UNKNOWN, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import Relaxation

MOST_N = 60e-3
DECLARED = Relaxation.declared(TISSUE.terms)
TISSUE_KNOWN = Setup(eye=Eye(relaxation=DECLARED))
CORNERS_S = (0.0, 2.0, 3.0, 8.0, 8.5, 14.0, 15.0, 18.0, 19.0, 24.0)
CORNERS_N = (0.0, 0.0, 0.03, 0.03, 0.012, 0.012, 0.0, 0.0, 0.045, 0.045)


def calibrated(seed: int = 0) -> Relaxation:
    rng = np.random.default_rng(seed)
    pushes, path = pushed(TISSUE, rng)
    return found_in(path, np.array([push.frame_s for push in pushes]), rng)[1]


def follow(known: Relaxation, path: NeedlePath, times_s: np.ndarray):
    history = TissueMemory.unknown(Setup(eye=Eye(relaxation=known)), MOST_N)
    answers = []

    for time_s, elastic_n in zip(times_s, path.elastic_n(times_s), strict=True):
        answer, history = history.read(
            read_as(float(elastic_n)), BOUNDS_N, float(time_s)
        )
        answers.append(answer)

    return answers


def test_a_dense_sequence_from_rest_with_known_shares_gives_the_felt_force() -> None:
    path = NeedlePath(CORNERS_S, CORNERS_N, TISSUE)
    times_s = np.arange(0.1, 24.0, 0.1)
    rest = replace(
        DECLARED, before_n=(0.0, 0.0), before_covariance_n2=((0.0, 0.0), (0.0, 0.0))
    )
    answers = follow(rest, path, times_s)
    read_n = np.array([answer.force_n for answer in answers])
    # corners lie between frames
    assert read_n == pytest.approx(path.felt_n(times_s), abs=0.1e-3)
    assert [answer.elastic_force_n for answer in answers] == pytest.approx(
        path.elastic_n(times_s), abs=1e-15
    )
    dense = path.felt_n(times_s) > 0.0
    predicted = np.array([answer.predicted for answer in answers])
    np.testing.assert_array_equal(
        predicted[dense], np.searchsorted(BOUNDS_N, read_n)[dense]
    )


def test_an_unknown_history_is_forgotten_and_its_interval_narrows() -> None:
    path = NeedlePath((0.0, 0.5, 60.0), (0.0, 0.03, 0.03), TISSUE)
    times_s = np.arange(0.6, 60.0, 0.1)
    answers = follow(DECLARED, path, times_s)
    widths = np.array(
        [answer.interval_n[1] - answer.interval_n[0] for answer in answers]
    )
    assert (np.diff(widths[:100]) < 0.0).all()
    assert widths[-1] < 0.4 * widths[0]
    assert answers[-1].force_n == pytest.approx(
        float(path.felt_n(times_s[-1:])[0]), abs=0.1e-3
    )
    inside = [
        low <= true <= high
        for (low, high), true in zip(
            (answer.interval_n for answer in answers), path.felt_n(times_s), strict=True
        )
    ]
    # the first seconds after rest are rarer than one in ten
    assert np.mean(inside) > 0.9


def test_a_gap_widens_the_interval_and_unusable_frames_are_gaps() -> None:
    history = TissueMemory.unknown(TISSUE_KNOWN, MOST_N)
    for time_s in np.arange(0.0, 30.0, 0.1):
        before, history = history.read(read_as(0.03), BOUNDS_N, float(time_s))

    for time_s in np.arange(30.0, 32.0, 0.1):
        refused, history = history.read(
            unusable_answer(3, "no wall"), BOUNDS_N, float(time_s)
        )
        assert refused.force_n is None

    after, history = history.read(read_as(0.03), BOUNDS_N, 32.0)
    assert after.interval_n[1] - after.interval_n[0] > 1.3 * (
        before.interval_n[1] - before.interval_n[0]
    )
    later, _ = history.read(read_as(0.03), BOUNDS_N, 32.0 + DENSE_S / 2)
    assert later.interval_n[1] - later.interval_n[0] > 1.2 * (
        before.interval_n[1] - before.interval_n[0]
    )


def test_frames_held_as_in_the_calibration_need_no_history() -> None:
    rng = np.random.default_rng(5)
    pushes, path = pushed(TISSUE, rng, FORCES_N[::-1])
    frame_s = np.array([push.frame_s for push in pushes])
    known = calibrated()
    errors = []
    inside = []

    for alone in (False, True):
        history = TissueMemory.unknown(Setup(eye=Eye(relaxation=known)), MOST_N)
        for time_s, elastic_n, true_n in zip(
            frame_s, path.elastic_n(frame_s), path.felt_n(frame_s), strict=True
        ):
            answer, after = history.read(
                read_as(float(elastic_n)), BOUNDS_N, None if alone else float(time_s)
            )
            history = history if alone else after
            errors.append(abs(answer.force_n - true_n))
            inside.append(answer.interval_n[0] <= true_n <= answer.interval_n[1])

    assert np.mean(errors) < 1.0e-3  # the dents show 3 to 9 mN more
    assert np.mean(inside) > 0.8


def test_a_known_hold_gives_the_force_of_a_frame_that_is_not_held_as_in_the_calibration():
    path = NeedlePath((0.0, 0.5, 60.0), (0.0, 0.03, 0.03), TISSUE)
    known = calibrated()
    nothing = (0.0,) * len(known.shares)
    rest = replace(
        known, before_n=nothing, before_covariance_n2=(nothing,) * len(nothing)
    )
    history = TissueMemory.unknown(Setup(eye=Eye(relaxation=rest)), MOST_N)

    for held_s in (0.5, 1.0, 20.0):
        told, _ = history.read(read_as(0.03), BOUNDS_N, held_s=held_s)
        true_n = float(path.felt_n(np.array([0.25 + held_s]))[0])
        assert told.interval_n[0] <= true_n <= told.interval_n[1]

    soon, late = (
        history.read(read_as(0.03), BOUNDS_N, held_s=held_s)[0]
        for held_s in (0.2, 20.0)
    )
    assert soon.force_n > late.force_n + 2e-3


def test_elastic_tissue_and_tissue_of_which_nothing_is_known_keep_the_answer() -> None:
    for known in (
        None,
        Relaxation.declared(()),
        Relaxation.of([0.0], [1.0], np.eye(1), "holds"),
    ):
        answer = read_as(0.02)
        assert (
            TissueMemory.unknown(Setup(eye=Eye(relaxation=known)), MOST_N).read(
                answer, BOUNDS_N, 1.0
            )[0]
            is answer
        )


def test_the_readings_of_each_method_are_turned_as_the_answer_is() -> None:
    answer = read_as(0.03)
    reading = Reading(
        probabilities=(0.0, 1.0, 0.0),
        force_n=0.03,
        interval_n=answer.interval_n,
        contact_m=0.0,
    )
    turned, _ = TissueMemory.unknown(TISSUE_KNOWN, MOST_N).read(
        replace(answer, readings=(("fit", reading),)), BOUNDS_N
    )
    ((_, found),) = turned.readings
    assert (found.force_n, found.interval_n) == (turned.force_n, turned.interval_n)
    assert sum(found.probabilities) == pytest.approx(1.0)
    assert found.probabilities[1] == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("less_mn", [0.0, 5.0, 60.0])
@pytest.mark.parametrize("force_mn", [31, 38, 58])
def test_harmless_is_never_likelier_than_considerable_above_both(
    force_mn: float, less_mn: float
) -> None:
    """Also after a gap, in which the force may have fallen by all that an eye bears."""
    felt = FeltForce(1.0, 0.0, 2e-3, less_n=to_si(less_mn, "mn"))
    found = felt.of(read_as(to_si(force_mn, "mn")), BOUNDS_N)
    assert sum(found.probabilities) == pytest.approx(1.0)
    assert found.probabilities[0] <= found.probabilities[1] < found.probabilities[2]


def test_a_needle_that_has_let_go_feels_nothing() -> None:
    path = NeedlePath(CORNERS_S, CORNERS_N, TISSUE)
    times_s = np.arange(0.1, 24.0, 0.1)
    off = (times_s > 15.5) & (times_s < 17.9)
    forces_n = np.array(
        [answer.force_n for answer in follow(calibrated(), path, times_s)]
    )
    assert (forces_n[off] == 0.0).all()


def watched(times_s: np.ndarray, path: NeedlePath, history: TissueMemory):
    """Answers of a monitor to the frames of a path, and the history after them."""
    answers = []
    for time_s, elastic_n in zip(times_s, path.elastic_n(times_s), strict=True):
        answer, history = history.read(
            read_as(float(elastic_n)), BOUNDS_N, float(time_s)
        )
        answers.append(answer)

    return answers, history


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


def inside(answers, felt_n: np.ndarray) -> bool:
    return all(
        answer.interval_n[0] <= true_n <= answer.interval_n[1]
        for answer, true_n in zip(answers, felt_n, strict=True)
    )


def test_a_monitor_that_starts_late_holds_every_history_and_forgets_it() -> None:
    times_s = np.arange(8.0, 60.0, 0.1)
    for path in random_paths(20):
        answers, _ = watched(
            times_s, path, TissueMemory.monitored(TISSUE_KNOWN, MOST_N)
        )
        assert inside(answers, path.felt_n(times_s))
        widths = np.array(
            [answer.interval_n[1] - answer.interval_n[0] for answer in answers]
        )
        assert (np.diff(widths) < 1e-9).all()  # and no bound jumps
        assert widths[-1] < 0.35 * widths[0]


def test_each_gap_of_a_monitor_widens_the_interval_around_all_that_may_have_been():
    before_s = np.arange(0.0, 0.1, 0.01)
    after_s = np.arange(8.0, 30.0, 0.1)

    for path in random_paths(20):
        _, history = watched(
            before_s, path, TissueMemory.monitored(TISSUE_KNOWN, MOST_N)
        )
        for gap_s in (
            0.0,
            1.0,
            2.5,
        ):
            # a monitor never gives a single frame the history of the calibration
            late, after = watched(after_s + gap_s, path, history)
            assert inside(late, path.felt_n(after_s + gap_s))
            history = after if gap_s else history

        refused, unchanged = history.read(unusable_answer(3, "no wall"), BOUNDS_N, 40.0)
        assert (refused.force_n, unchanged) == (None, history)


def test_the_median_of_a_monitor_that_starts_at_rest_is_the_felt_force() -> None:
    path = NeedlePath(CORNERS_S, CORNERS_N, TISSUE)
    times_s = np.arange(0.1, 24.0, 0.01)
    answers, _ = watched(times_s, path, TissueMemory.monitored(TISSUE_KNOWN, MOST_N))
    assert [answer.force_n for answer in answers] == pytest.approx(
        path.felt_n(times_s), abs=0.05e-3
    )


def test_a_reading_of_nan_does_not_enter_the_history() -> None:
    _, history = watched(
        np.arange(0.0, 1.0, 0.01),
        NeedlePath(CORNERS_S, CORNERS_N, TISSUE),
        TissueMemory.monitored(TISSUE_KNOWN, MOST_N),
    )
    answer = replace(read_as(0.01), force_n=float("nan"))
    assert history.read(answer, BOUNDS_N, 1.0) == (answer, history)


OWN = Modulus(mean_pa=0.3e6, sd_pa=3e3, source="own")
OTHERS = replace(OWN, source="population")
DEG = np.pi / 180.0
# Setup inputs of an eye; the factors of its force along the needle: least, likeliest,
# most; leans that differ, if any.
LEANS = {
    "nothing is said": (Setup(), (1.0, 1.0, 1.0), ()),
    "declared": (
        Setup(needle=Needle(lean_rad=(0.5, 0.5))),
        (np.cos(0.5), 1 / np.cos(0.5), 1 / np.cos(0.5)),
        (0.5,),
    ),
    "not known": (
        Setup(needle=Needle(lean_rad=(0.0, 45 * DEG))),
        (np.sqrt(0.5), 1 / np.cos(22.5 * DEG), np.sqrt(2.0)),
        (22.5 * DEG,),
    ),
    "as in the calibration": (
        Setup(eye=Eye(modulus=OWN, calibrated_lean_rad=0.3)),
        (1 / np.cos(0.3),) * 3,
        (),
    ),
    "declared again": (
        Setup(
            eye=Eye(modulus=OWN, calibrated_lean_rad=0.3),
            needle=Needle(lean_rad=(0.33, 0.33)),
        ),
        (1 / np.cos(0.33),) * 3,
        (),
    ),
    "of others, who leaned so": (
        Setup(eye=Eye(modulus=OTHERS, calibrated_lean_rad=0.3)),
        (1 / np.cos(0.3),) * 3,
        (),
    ),
    "another one": (
        Setup(
            eye=Eye(modulus=OWN, calibrated_lean_rad=0.3),
            needle=Needle(lean_rad=(0.6, 0.6)),
        ),
        (np.cos(0.6) / np.cos(0.3) ** 2, 1 / np.cos(0.6), 1 / np.cos(0.6)),
        (0.3, 0.6),
    ),
    "upright after a lean": (
        Setup(
            eye=Eye(modulus=OWN, calibrated_lean_rad=0.6),
            needle=Needle(lean_rad=(0.0, 0.0)),
        ),
        (1.0, 1.0, 1 / np.cos(0.6) ** 2),
        (0.6,),
    ),
    "absorbed": (Setup(eye=Eye(modulus=OWN)), (1.0, 1.0, 1.0), ()),
    "not in the calibration": (
        Setup(eye=Eye(modulus=OTHERS), needle=Needle(lean_rad=(0.0, 0.0))),
        (np.sqrt(0.5), 1.0, np.sqrt(2.0)),
        (22.5 * DEG,),
    ),
    "known nowhere": (
        Setup(eye=Eye(modulus=OWN), needle=Needle(lean_rad=(0.0, 45 * DEG))),
        (np.sqrt(0.5), 1.0, np.sqrt(2.0)),
        (22.5 * DEG, 22.5 * DEG),
    ),
}


@pytest.mark.parametrize("case", LEANS)
@pytest.mark.parametrize("relaxation", [None, DECLARED])
def test_a_needle_that_leans_feels_the_force_along_it(
    case: str, relaxation: Relaxation | None
) -> None:
    known, (least, factor, most), others = LEANS[case]
    elastic = read_as(0.02)
    upright, _ = TissueMemory.unknown(
        Setup(eye=Eye(relaxation=relaxation)), MOST_N
    ).read(elastic, BOUNDS_N)
    leaning, _ = TissueMemory.unknown(
        replace(known, eye=replace(known.eye, relaxation=relaxation)), MOST_N
    ).read(elastic, BOUNDS_N)
    low_n, high_n = upright.interval_n
    force_n = upright.force_n
    assert leaning.force_n == pytest.approx(factor * force_n)

    if not others:
        assert leaning.interval_n == pytest.approx((factor * low_n, factor * high_n))
    elif relaxation is None:
        sd_n = LEAN_SD * np.sqrt(sum(np.tan(other) ** 2 for other in others)) * force_n
        low_n, high_n = (
            factor * np.hypot(end_n - force_n, NINETY_PERCENT * sd_n)
            for end_n in (low_n, high_n)
        )
        assert leaning.interval_n == pytest.approx(
            (max(least * force_n - low_n, 0.0), most * force_n + high_n)
        )

    assert (leaning.lean_rad is None) == (case in ("nothing is said", "absorbed"))
    assert bool(leaning.warnings) == (
        case in ("not in the calibration", "known nowhere")
    )


def test_a_shaft_in_the_picture_gives_the_lean_where_nothing_else_does_and_may_contradict_it():
    seen = 30 * DEG
    assert NeedleLean.of(Setup(), -seen) == NeedleLean.of(
        Setup(needle=Needle(lean_rad=(seen, seen))), None
    )
    assert NeedleLean.of(Setup(eye=Eye(modulus=OWN)), seen) == NeedleLean((seen, seen))
    # it may lean out of the picture, too
    steeper = replace(
        Setup(), needle=replace(Setup().needle, lean_rad=(45 * DEG, 45 * DEG))
    )

    for known, contradicts in (
        (steeper, False),
        (replace(steeper, needle=replace(steeper.needle, lean_azimuth_rad=0.0)), True),
        (Setup(needle=Needle(lean_rad=(0.1, 0.1))), True),
        (
            replace(
                steeper,
                needle=replace(
                    steeper.needle, lean_azimuth_rad=np.arccos(np.tan(seen))
                ),
            ),
            False,
        ),
        (
            Setup(needle=Needle(lean_rad=(seen, seen), lean_azimuth_rad=np.pi)),
            True,
        ),  # to the other side
        (Setup(needle=Needle(lean_rad=(0.0, 45 * DEG), lean_azimuth_rad=0.0)), False),
    ):
        found = NeedleLean.of(known, seen)
        assert found.ends_rad == known.needle.lean_rad
        codes = [remark.code for remark in found.remarks]
        assert codes == ["lean-contradicted"] * contradicts


GLOBE = Globe.declared("sealed", 1e8, leak_time_s=20.0)
LAW = GLOBE.pressure_law(GLOBE.mean)
LEAKING = Setup(eye=Eye(iop_pa=300.0, globe=GLOBE))
DENT_M3 = 10e-9


@pytest.mark.parametrize("every_s", [0.1, 5.0])
def test_a_dent_that_stays_leaks_in_dense_sequences_and_in_sparse_ones_whose_holds_are_known(
    every_s: float,
) -> None:
    leak = Leak()
    rests_pa = []
    times_s = np.arange(0.0, 30.0, every_s).tolist()
    for time_s in times_s:
        (answer,), leak = leak.read(
            lambda now: (shown(now.eye.iop_pa),), LEAKING, time_s, every_s
        )
        rests_pa.append(answer.rest_pa)

    expected_pa = LAW.pressure(
        300.0, -DENT_M3 * (1.0 - np.exp(-np.array(times_s) / 20.0))
    )
    assert rests_pa == pytest.approx(expected_pa, rel=2e-3)


def test_frames_that_are_refused_leave_the_leak_as_it_was() -> None:
    leak = Leak()
    for time_s in (0.0, 0.2, 10.0, 20.0):
        (low,), leak = leak.read(
            lambda now: (shown(now.eye.iop_pa),), LEAKING, time_s, 10.0
        )

    assert low.rest_pa < 0.9 * 300.0
    after = leak
    for time_s in np.arange(20.2, 140.0, 0.2).tolist():
        _, after = after.read(
            lambda _: (SimpleNamespace(iop_at_dent_pa=None),), LEAKING, time_s, None
        )

    assert after == leak
    # a minute without the needle, as far as anything shows it
    (late,), _ = leak.read(lambda now: (shown(now.eye.iop_pa),), LEAKING, 140.0, 1.0)
    assert low.rest_pa < late.rest_pa < 300.0


def test_a_pressure_that_is_stated_takes_the_place_of_the_leak() -> None:
    answers = (shown(250.0),)
    leak = Leak().at_pressure(250.0, LEAKING.eye, answers, 10.0)
    (answer,), _ = leak.read(lambda now: (shown(now.eye.iop_pa),), LEAKING, 10.0, None)
    assert answer.rest_pa == pytest.approx(250.0)
    refused = (SimpleNamespace(iop_at_dent_pa=None),)
    assert leak.at_pressure(280.0, LEAKING.eye, refused, 11.0) == leak


def test_an_eye_that_does_not_leak_keeps_its_pressure() -> None:
    for known in (
        replace(
            LEAKING, eye=replace(LEAKING.eye, globe=replace(GLOBE, leak_time_s=None))
        ),
        replace(LEAKING, eye=replace(LEAKING.eye, globe=Globe.declared("open"))),
        Setup(eye=Eye(globe=replace(UNKNOWN, leak_time_s=9.0))),
    ):
        leak = Leak()
        assert leak.read(lambda now: now, known, 5.0, None) == (known, leak)


def shown(rest_pa: float) -> SimpleNamespace:
    return SimpleNamespace(
        rest_pa=rest_pa, iop_at_dent_pa=float(LAW.pressure(rest_pa, DENT_M3))
    )
