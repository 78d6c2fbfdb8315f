"""Frames of known force: E, k, level and growth from them, and the stiffening that
explains them best.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import log, log1p
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from analytic_frames import LATERAL_M, LIBRARY, moving
from analytic_library import (
    EXACT_EYES,
    STIFFENINGS,
    made_up_library,
    solved_library,
    without_rests,
)
from scipy.optimize import minimize
from small_recordings import calibration_of_a_sealed_eye

from scleraforce.calibration.calibrate import (
    calibrate_recordings,
    calibration_passes,
)
from scleraforce.calibration.start_of_an_eye import (
    ForceFrame,
    StartedEye,
    first_fit,
    start_eye,
)
from scleraforce.calibration.stiffness_from_forces import (
    KnownForce,
    RereadEye,
    TissueTrial,
    eye_of_forces,
    reread_eye,
    search_stiffening,
)
from scleraforce.fit import unknowns
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.lab.training import interval_measurement
from scleraforce.library import Library
from scleraforce.library.plane_cut import cut_surfaces
from scleraforce.recordings.force_errors import LABEL_SD_N
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, REFERENCE_RIGIDITY, SEALED, UNKNOWN, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import (
    LibraryStudy,
    Range,
    Study,
    TissueStudy,
)
from scleraforce.wall.wall_in_metres import Boundaries

MODULUS_PA = 0.3e6
STARTED = replace(
    SEALED,
    mean=REFERENCE_RIGIDITY,
    sd=0.05 * REFERENCE_RIGIDITY,
    correlation=-0.5,
    calibrated=True,
)
OF_START = np.array([[0.02**2, -0.5 * 0.02 * 0.05], [-0.5 * 0.02 * 0.05, 0.05**2]])
STUDY = replace(
    Study(), calibration=replace(Study().calibration, surface_smoothing_m=0.0)
)


def known_of(
    relative_sd: float, globe: Globe = OPEN, modulus_pa: float = MODULUS_PA
) -> Setup:
    """An eye after the start."""
    modulus = Modulus(mean_pa=modulus_pa, sd_pa=relative_sd * modulus_pa, source="own")
    return Setup(
        eye=Eye(modulus=modulus, iop_pa=270.0, thickness_m=0.65e-3, globe=globe),
        needle=Needle(gap_m=0.6e-3, polar_rad=0.0),
    )


def slopes_of(frame: KnownForce) -> np.ndarray:
    """Of the logarithm of a force, by ln E, k over the reference's, level and
    growth.
    """
    return np.array(
        [frame.by_modulus, frame.by_rigidity, 1.0, frame.library_n / 60e-3 - 0.5]
    )


def off_by(off: Sequence[float], forces_n: Sequence[float]) -> list[KnownForce]:
    """Frames of a sealed eye whose ln E, k, level and growth are off: the deeper a
    dent, the less its force says of E and the more of k.
    """
    found = []
    for force_n in forces_n:
        frame = KnownForce(
            force_n=force_n,
            library_n=force_n,
            sd_n=0.015 * force_n,
            modulus_pa=MODULUS_PA,
            rigidity=REFERENCE_RIGIDITY,
            by_modulus=1.0 - 4.0 * force_n,
            by_rigidity=0.2 + 8.0 * force_n,
        )
        ratio = float(np.exp(slopes_of(frame) @ off))
        found.append(replace(frame, force_n=ratio * force_n))

    return found


def squares(read: Sequence[KnownForce], off: np.ndarray) -> float:
    """Sum of the squares of residuals in standard deviations."""
    return sum(
        (np.log(frame.force_n / frame.library_n) - slopes_of(frame) @ off) ** 2
        / ((frame.sd_n / frame.library_n) ** 2 + (LABEL_SD_N / frame.force_n) ** 2)
        for frame in read
    )


def estimate(read: Sequence[KnownForce]) -> tuple[np.ndarray, RereadEye]:
    """By how much ln E, k, level and growth are off by frames that were read before."""
    after = reread_eye(known_of(0.02, STARTED), (), read, LIBRARY, STUDY)
    eye = after.setup.eye
    off = [
        log(eye.modulus_pa / MODULUS_PA),
        eye.globe.mean / REFERENCE_RIGIDITY - 1.0,
        eye.discrepancy.level,
        eye.discrepancy.growth,
    ]
    return np.array(off), after


def test_the_mean_is_where_the_loss_is_least():
    """Against a minimum that is searched for without derivatives, of the loss written
    down once more.
    """
    read = off_by((0.1, -0.2, 0.05, 0.3), (12e-3, 25e-3, 41e-3, 55e-3))
    scale = np.linalg.inv(OF_START)

    def loss(off: np.ndarray) -> float:
        total = 4.0 * np.log1p(off[:2] @ scale @ off[:2] / 4.0)
        total += 4.0 * np.log1p((off[2:] / (0.02, 0.035)) ** 2 / 4.0).sum()
        return float(total + squares(read, off))

    found, after = estimate(read)
    near = minimize(
        loss,
        found,
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-10, "maxiter": 8000},
    )
    np.testing.assert_allclose(found, near.x, atol=1e-4)
    assert after.loss == pytest.approx(loss(found), rel=1e-6)


def test_frames_that_agree_promise_nothing_and_others_scatter():
    """The scatter is the part that the four do not explain, over the expected one of
    each frame.
    """
    agreeing = off_by((0.0, 0.0, 0.0, 0.0), (18e-3, 38e-3, 57e-3))
    for read in ([], agreeing):
        assert estimate(read)[1].setup.eye.discrepancy.scatter == 1.0

    shifts = zip(agreeing, (0.05, -0.05, 0.04), strict=True)
    scattered = [
        replace(frame, force_n=frame.force_n * np.exp(shift)) for frame, shift in shifts
    ]
    off, after = estimate(scattered)
    expected = np.sqrt((5.0 + squares(scattered, off) / 0.17) / 8.0)
    found = after.setup.eye.discrepancy
    assert found.scatter == pytest.approx(expected)
    assert expected > 2.0


KNOWN = known_of(0.05)
KNOWN_N = np.array([0.014, 0.024, 0.03])


def read_frames(factor: float = 1.0) -> list[ForceFrame]:
    """Frames of an eye, their forces the library's times a factor."""
    ones = np.ones(len(KNOWN_N))
    walls = LIBRARY.curves(
        0.65e-3 * ones, 270.0 / MODULUS_PA * ones, KNOWN_N / MODULUS_PA
    )
    sections = [cut_surfaces(wall, 0.6e-3) for wall in walls.curves_sbnc]
    made = moving(sections, np.random.default_rng(4), 3e-6, STUDY)
    return [
        ForceFrame(wall=wall, force_n=force_n)
        for wall, force_n in zip(made, (factor * KNOWN_N).tolist(), strict=True)
    ]


def started(
    frames: Sequence[ForceFrame], known: Setup, sought: dict[str, float] | None = None
) -> StartedEye:
    """Start an eye from the usual prior."""
    fits = [first_fit(frame.shown, known, LIBRARY, STUDY) for frame in frames]
    assert all(fit is not None for fit in fits)
    found = [fit for fit in fits if fit is not None]
    return start_eye(known, frames, found, LIBRARY, STUDY, sought or {})


def with_prior(globe: Globe = OPEN) -> Setup:
    modulus = Modulus(mean_pa=0.49e6, sd_pa=0.34e6, source="population")
    return replace(KNOWN, eye=replace(KNOWN.eye, modulus=modulus, globe=globe))


def test_the_start_finds_the_modulus_from_the_usual_prior():
    found = started(read_frames(), with_prior()).setup.eye
    assert found.modulus is not None
    assert 0.005 < found.modulus.relative_sd < 0.02
    off = abs(found.modulus_pa / MODULUS_PA - 1.0)
    assert off < 2.0 * found.modulus.relative_sd


def test_the_start_finds_open_frames_of_an_eye_that_may_be_sealed():
    """The rigidity of an open globe is 0: it is found within two standard deviations
    from the middle of the range of closed eyes.
    """
    found = started(read_frames(), with_prior(UNKNOWN)).setup.eye
    assert found.globe is not None
    assert found.globe.mean < 0.15 * REFERENCE_RIGIDITY
    assert found.modulus_pa == pytest.approx(MODULUS_PA, rel=0.1)


def test_trials_of_other_tissue_begin_where_the_one_before_began():
    """The next trial gets what the last one began with, a start of the same frames; and
    one eye is compared with the tissue that explains the frames alone the best.
    """
    begun = started(read_frames(), with_prior())
    asked = list[StartedEye | None]()

    def calibrate(walls: Library, before: StartedEye | None) -> TissueTrial[float]:
        asked.append(before)
        return TissueTrial(
            found=walls.stiffening,
            refused=0,
            frames=TRIAL_FRAMES,
            of_boundaries=EVEN,
            of_forces=bowl(40.0, 1.6)(log1p(walls.stiffening)),
            started=begun,
        )

    search_stiffening(MADE_UP, calibrate)
    assert asked[0] is None
    assert len(asked) > 1
    assert all(before is begun for before in asked[1:])
    better = replace(begun, alone=0.5 * begun.alone)
    fits = [first_fit(frame.shown, KNOWN, LIBRARY, STUDY) for frame in read_frames()]
    found = [fit for fit in fits if fit is not None]
    again = start_eye(with_prior(), read_frames(), found, LIBRARY, STUDY, {}, better)
    assert again.alone == better.alone


def test_a_thickness_that_is_sought_is_found_from_a_wrong_one():
    stated = with_prior()
    wrong = replace(stated, eye=replace(stated.eye, thickness_m=0.70e-3))
    found = started(read_frames(), wrong, {"thickness": 0.1e-3})
    mean_m, sd_m = found.fit.moments(unknowns.THICKNESS)
    assert mean_m == pytest.approx(0.65e-3, abs=2.5 * sd_m)
    assert sd_m < 0.02e-3
    assert found.setup.eye.thickness_m == mean_m
    # and the modulus with it, which is wrong where the thickness is taken as stated
    assert found.setup.eye.modulus_pa == pytest.approx(MODULUS_PA, rel=0.05)
    alone = started(read_frames(), wrong).setup.eye
    assert alone.modulus_pa < 0.95 * MODULUS_PA


UNKNOWN_MODULUS = replace(KNOWN, eye=replace(KNOWN.eye, modulus=None))


def no_form(across_m: np.ndarray) -> np.ndarray:
    return np.zeros_like(across_m)


def cornea(across_m: np.ndarray) -> np.ndarray:
    """A surface that is steeper and more bent beyond the limbus."""
    beyond_m = np.maximum(across_m - 3.2e-3, 0.0)
    return 0.5 * 45.0 * beyond_m**2 - 0.3 * beyond_m


def waves(across_m: np.ndarray) -> np.ndarray:
    """A surface that no wall of the library has."""
    return 0.3e-3 * np.sin(across_m / 0.4e-3)


def formed(frame: ForceFrame, form: Callable[[np.ndarray], np.ndarray]) -> ForceFrame:
    """A frame of an eye with another form at rest."""
    wall = frame.wall
    added_m = form(wall.lateral_m - 0.3e-3)
    return replace(frame, wall=replace(wall, depth_m=wall.depth_m + added_m))


@pytest.mark.parametrize("form", [no_form, cornea])
def test_the_form_of_an_eye_does_not_move_its_modulus(
    form: Callable[[np.ndarray], np.ndarray],
):
    seen = [formed(frame, form) for frame in read_frames()[::2]]
    trial = eye_of_forces(UNKNOWN_MODULUS, seen, LIBRARY, STUDY)
    assert trial is not None
    assert trial.refused == 0
    assert trial.found[0].eye.modulus_pa == pytest.approx(MODULUS_PA, rel=0.04)


def test_a_frame_of_no_wall_of_the_library_is_refused_and_moves_nothing():
    frame, other, _ = read_frames()
    alone = eye_of_forces(UNKNOWN_MODULUS, [frame], LIBRARY, STUDY)
    both = eye_of_forces(UNKNOWN_MODULUS, [frame, formed(other, waves)], LIBRARY, STUDY)
    assert alone is not None
    assert both is not None
    assert (alone.refused, both.refused) == (0, 1)
    assert both.found == alone.found


BLIND = ForceFrame(
    wall=Boundaries(LATERAL_M, np.full((2, len(LATERAL_M)), np.nan), 1e-4), force_n=0.02
)


def test_frames_are_read_again_at_their_own_resting_pressures():
    frame, *_ = read_frames()
    soft = replace(KNOWN, eye=replace(KNOWN.eye, iop_pa=135.0))
    of_leak = replace(frame, iop_pa=135.0)
    leaked = reread_eye(KNOWN, [of_leak], (), LIBRARY, STUDY).again
    assert leaked == reread_eye(soft, [frame], (), LIBRARY, STUDY).again
    assert leaked != reread_eye(KNOWN, [frame], (), LIBRARY, STUDY).again


def test_slopes_are_quotients_of_forces_that_are_read_with_another_modulus():
    sure = (known_of(1e-4, modulus_pa=factor * MODULUS_PA) for factor in (1.0, 1.05))
    for here, there in zip(
        *(reread_eye(eye, read_frames(), (), LIBRARY, STUDY).again for eye in sure),
        strict=True,
    ):
        assert there.modulus_pa > 1.02 * here.modulus_pa
        assert log(there.library_n / here.library_n) == pytest.approx(
            here.by_modulus * log(there.modulus_pa / here.modulus_pa), abs=0.005
        )
        assert here.by_rigidity == 0.0


@pytest.mark.parametrize("wrong", [0.6, 1.5])
def test_a_modulus_that_the_start_missed_is_found(wrong: float):
    known = known_of(0.05, modulus_pa=wrong * MODULUS_PA)
    after = reread_eye(known, read_frames(), (), LIBRARY, STUDY)
    eye = after.setup.eye
    assert eye.modulus_pa == pytest.approx(MODULUS_PA, rel=0.05)
    read_n, known_n = (
        np.array([getattr(frame, name) for frame in after.again])
        for name in ("library_n", "force_n")
    )
    assert eye.discrepancy.corrected_n(read_n) == pytest.approx(known_n, rel=0.03)


def test_forces_are_surer_than_the_modulus_that_they_show():
    """An eye whose forces all lie 4 % off is read right, and its intervals are a
    frame's, not E's.
    """
    seen = read_frames(1.04)
    now = reread_eye(KNOWN, seen, (), LIBRARY, STUDY).setup
    assert now.eye.modulus.relative_sd > 0.015
    assert now.eye.discrepancy is not None
    apart = replace(now.eye.discrepancy, level_by=(0.0, 0.0), growth_by=(0.0, 0.0))

    for frame in seen[1:]:
        widths = []
        for each in (now, replace(now, eye=replace(now.eye, discrepancy=apart))):
            fit = fit_boundaries(
                LIBRARY,
                frame.wall.lateral_m,
                frame.wall.depth_m,
                prior_of(each, STUDY.reader),
            )
            assert fit is not None
            assert fit.force_n == pytest.approx(frame.force_n, rel=0.03)
            widths.append(float(np.diff(np.log(fit.interval_n))[0]))

        assert widths[0] < 0.9 * widths[1]


def test_frames_that_were_read_before_count_like_the_others():
    seen = read_frames(1.1)
    at_once = reread_eye(KNOWN, seen, (), LIBRARY, STUDY)
    earlier = at_once.again
    parts = reread_eye(KNOWN, seen[2:], earlier[:2], LIBRARY, STUDY)
    assert parts.setup.eye.modulus_pa == pytest.approx(
        at_once.setup.eye.modulus_pa, rel=0.01
    )
    largest_n = seen[-1].force_n  # of the frames that could be read
    unseen = replace(BLIND, force_n=2.0 * largest_n)

    for now, before in (([*seen, unseen], []), (seen[:1], earlier)):
        after = reread_eye(KNOWN, now, before, LIBRARY, STUDY)
        assert after.setup.eye.discrepancy.largest_n == largest_n


def test_without_a_frame_that_can_be_read_the_start_s_modulus_stays():
    after = reread_eye(KNOWN, [BLIND], (), LIBRARY, STUDY)
    assert after.again == (None,)
    assert after.setup.eye.modulus_pa == pytest.approx(MODULUS_PA, rel=1e-9)
    found = after.setup.eye.discrepancy
    assert (found.level, found.growth, found.largest_n) == (0.0, 0.0, None)


def test_the_loss_of_a_stiffening_is_the_loss_of_the_frames_that_were_read():
    """A frame that cannot be read counts as refused."""
    after = reread_eye(KNOWN, [*read_frames(), BLIND], (), LIBRARY, STUDY)
    trial = after.trial("an eye", 2)
    lost = [frame.loss for frame in after.again if frame is not None]
    assert (trial.found, trial.refused, trial.frames) == ("an eye", 3, 3)
    assert trial.of_boundaries == pytest.approx(sum(lost))
    assert min(lost) > 0.0
    assert trial.loss == pytest.approx(trial.of_boundaries + after.loss)


MADE_UP = made_up_library()
# of the library's stiffenings: 0, 0.41, 1.18, 2.24 and 3.43
PLACES = np.log1p(STIFFENINGS)
# frames of an even wall, and the loss of their boundaries
TRIAL_FRAMES = 3
EVEN = 15.0
Lost = Callable[[float], float]


def bowl(weight: float, least: float) -> Lost:
    return lambda place: weight * (place - least) ** 2


NOTHING = bowl(0.0, 0.0)


def sought(
    forces: Lost = NOTHING,
    boundaries: Lost = lambda _: EVEN,
    refused: Lost = NOTHING,
) -> tuple[float, list[float]]:
    """Return ln(1 + b) that is found for an eye whose losses are functions of it, and
    the stiffenings that were tried.
    """
    tried = list[float]()

    def calibrate(walls: Library, _: StartedEye | None) -> TissueTrial[float]:
        tried.append(walls.stiffening)
        place = log1p(walls.stiffening)
        return TissueTrial(
            found=walls.stiffening,
            frames=TRIAL_FRAMES,
            of_boundaries=boundaries(place),
            of_forces=forces(place),
            refused=int(refused(place)),
        )

    stiffening, found = search_stiffening(MADE_UP, calibrate)
    assert stiffening == found in tried
    assert len(tried) == len(set(tried)) <= len(STIFFENINGS) + 3
    return log1p(found), tried


def prior(place: float) -> float:
    """Cauchy's density of ln(1 + b), of scale 0.5, at two scales half as sure."""
    return 4.0 * log(1.0 + place**2)


@pytest.mark.parametrize("lopsided", [0.0, 0.15])
@pytest.mark.parametrize("least", [0.9, 1.6, 2.0, 2.7, 3.1])
def test_the_least_loss_between_the_library_s_stiffenings_is_found(
    least: float, lopsided: float
):
    """Within 0.1 of ln(1 + b), and no worse by more than half of a square of a standard
    deviation.
    """

    def whole(place: float) -> float:
        bent = 1.0 + lopsided * (place - least)
        return bowl(40.0, least)(place) * bent + prior(place)

    best = min(np.linspace(0.0, PLACES[-1], 3001).tolist(), key=whole)
    found, _ = sought(lambda place: whole(place) - prior(place))
    assert found == pytest.approx(best, abs=0.1)
    assert whole(found) < whole(best) + 0.5


def levelling_off(least: float) -> Lost:
    near = bowl(1.0 / 0.8**2, least)
    return lambda place: EVEN + 270.0 * (1.0 - np.exp(-near(place)))


def of_thick_walls(place: float) -> float:
    """An eye of b = 20, whose best walls lie between alike ones."""
    places = np.log1p([0.0, 0.5, 2.26, 8.42, 15.3, 30.0])
    return float(np.interp(place, places, [188.9, 182.7, 163.1, 110.0, 71.3, 109.2]))


def of_a_lost_filter(place: float) -> float:
    """Far from the eye's tissue a filter may end anywhere: that the second loses more
    than the first says nothing.
    """
    lost = np.array([300.0, 900.0, 60.0, EVEN, 80.0])
    return float(lost[np.abs(PLACES - place).argmin()]) + place


@pytest.mark.parametrize(
    ("losses", "least"),
    [
        *(({"forces": bowl(60.0, least)}, least) for least in (0.35, 0.45, 0.6)),
        *(({"boundaries": levelling_off(least)}, least) for least in (2.9, 3.04)),
        ({"boundaries": of_thick_walls}, log1p(15.3)),
        ({"boundaries": of_a_lost_filter}, PLACES[3]),
        # all refuse frames, and the fewest count
        (
            {"forces": bowl(30.0, 2.3), "refused": lambda place: 1 + (place < 1.5)},
            2.27,
        ),
        # ruled out on one side: the next lies halfway to the other neighbour
        ({"forces": bowl(20.0, 1.6), "refused": lambda place: place < 0.5}, 1.55),
        ({"forces": bowl(30.0, 1.9), "refused": lambda place: place > 3.0}, 1.85),
    ],
)
def test_a_stiffening_beside_neighbours_that_lose_much_or_refuse_frames_is_found(
    losses: dict[str, Lost], least: float
):
    assert sought(**losses)[0] == pytest.approx(least, abs=0.2)


@pytest.mark.parametrize(
    ("more_of_forces", "level", "more_of_boundaries", "stiffens"),
    [
        # 3.0 is less than the prior of any node
        (3.0, 1.0, 0.0, False),
        (3.6, 1.0, 0.0, True),
        # the loss that all walls share says how much a difference counts
        (0.0, 0.1, 9.0, True),
        (0.0, 1.0, 9.0, True),
        (0.0, 10.0, 9.0, False),
        (0.0, 1.0, 3.0, False),
    ],
)
def test_tissue_does_not_stiffen_unless_its_frames_say_so(
    more_of_forces: float, level: float, more_of_boundaries: float, stiffens: bool
):
    found, _ = sought(
        lambda place: more_of_forces * (place < 0.5),
        lambda place: level * EVEN + more_of_boundaries * (place < 0.5),
    )
    assert bool(found) == stiffens


@pytest.mark.parametrize("best", PLACES)
def test_a_stiffening_that_refuses_frames_that_others_take_never_wins(
    best: float,
):
    found, _ = sought(
        lambda place: 50.0 * (abs(place - best) > 0.3),
        refused=lambda place: abs(place - best) < 0.3,
    )
    assert abs(found - best) > 0.3


def test_any_stiffening_is_better_than_one_that_diverged():
    poor = TissueTrial(
        found="poor", refused=11, frames=1, of_boundaries=500.0, of_forces=500.0
    )
    lost = TissueTrial.diverged("diverged", 0)
    found = search_stiffening(
        MADE_UP,
        lambda library, _: poor if library.stiffening == STIFFENINGS[2] else lost,
    )
    assert found == (STIFFENINGS[2], "poor")


# Whole calibrations: the trials, the result, and the counted steps.


@dataclass
class Calibrating:
    """Replaces the calibration with one tissue: its loss is a function of ln(1 + b)."""

    tried: list[tuple[float, bool]] = field(default_factory=list)
    frames: list[int | None] = field(default_factory=list)

    def __call__(
        self, recording: Any, way: Any, _frames: Any, earlier: Any, before: Any = None
    ) -> Any:
        assert before is None  # no trial here says where it began
        self.frames.append(way.frames)
        stiffening = way.library.stiffening
        self.tried.append((stiffening, earlier is not None))
        way.count(len(recording.frames))
        eye = calibration_of_a_sealed_eye().eyes["mine"]
        return TissueTrial(
            found=replace(eye, stiffening=stiffening),
            refused=0,
            frames=TRIAL_FRAMES,
            of_boundaries=EVEN,
            of_forces=bowl(40.0, 1.6)(log1p(stiffening)),
        )


@pytest.fixture
def calibrating(monkeypatch: pytest.MonkeyPatch) -> Calibrating:
    made = Calibrating()
    monkeypatch.setattr("scleraforce.calibration.calibrate.calibrate_eye", made)
    return made


def stiffening_of(
    study: Study | None = None, in_recording: int = 8, **given: Any
) -> float:
    """The stiffening that a calibration finds with as much of a recording as it
    needs.
    """
    eye = Eye("mine")
    recording = SimpleNamespace(
        info=SimpleNamespace(eye=eye, eye_name=eye.name, scan=Scan()),
        frames=range(in_recording),
        moments=(),
        path=Path("r"),
    )
    found = calibrate_recordings([recording], study or Study(), "", MADE_UP, **given)
    return found.eyes["mine"].stiffening


@pytest.mark.parametrize("wanted", [None, 3, 6, 40])
def test_it_is_sought_on_a_few_frames_and_then_all_that_are_wanted_are_calibrated_on(
    calibrating, wanted: int | None
):
    steps: list[int] = []
    found = stiffening_of(frames=wanted, progress=steps.append)
    assert log1p(found) == pytest.approx(1.55, abs=0.1)
    assert sum(steps) == 8 * calibration_passes(MADE_UP, None)
    few = wanted in (3, 6)
    tried = calibrating.frames if few else calibrating.frames[:-1]
    assert len(tried) >= 4
    assert set(tried) == {wanted if few else 6}
    assert calibrating.frames[-1] == wanted
    assert few or calibrating.tried[-1] == (found, False)


def test_a_short_recording_is_calibrated_on_once_with_each_tissue(
    calibrating,
):
    stiffening_of(in_recording=3)
    assert set(calibrating.frames) == {None}
    assert len(calibrating.tried) == len(set(calibrating.tried))


@pytest.mark.parametrize("stiffening", [0.0, 5.0])
def test_a_stiffening_that_is_not_sought_is_the_study_s(calibrating, stiffening: float):
    study = replace(Study(), tissue=TissueStudy(stiffening=stiffening))
    steps: list[int] = []
    found = stiffening_of(study, parameters=("e", "iop"), progress=steps.append)
    assert found == stiffening
    assert calibrating.tried == [(stiffening, False)]
    assert sum(steps) == 8 * calibration_passes(MADE_UP, ("e",)) == 8


# Eyes of a library's own walls, seen without errors.

GRID = LibraryStudy(
    thickness_m=Range(min=0.45e-3, max=0.8e-3),
    thicknesses=4,
    tension=Range(min=4e-3, max=0.12),
    tensions=5,
    max_tip_m=5e-3,
    tips=20,
    elements=32,
)
EXACT = Study(
    reader=replace(
        EXACT_EYES,
        stiffening_share=0.0,
        interval_boundary_errors=0.0,
        youngs_modulus_pa=Range(min=0.2e6, max=0.4e6),
    )
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stiffening", "seed"), [(0.0, 1), (3.0, 1), (9.0, 2), (20.0, 1)]
)
def test_the_stiffening_of_an_eye_is_found_from_three_frames_and_the_others_are_read_right(
    stiffening: float, seed: int, monkeypatch
):
    """An open eye of even form, whose boundaries and forces are known without
    errors.
    """
    monkeypatch.setattr(
        interval_measurement, "label_forces", partial(without_rests, sd_n=0.0)
    )
    library = solved_library(GRID)
    rng = np.random.default_rng(seed)
    eye = interval_measurement.draw_eye(
        EXACT, library.for_stiffening(stiffening), 0, rng
    )
    assert eye.model.library.stiffening == stiffening
    frames = interval_measurement.draw_frames(eye, EXACT, 8, rng)
    known, left = interval_measurement.calibrated(eye, frames, EXACT, library, rng)
    assert known.eye.modulus is not None
    assert known.eye.stiffening is not None
    assert log1p(known.eye.stiffening) == pytest.approx(log1p(stiffening), abs=0.3)
    assert known.eye.modulus.mean_pa == pytest.approx(
        eye.wall.youngs_modulus_pa, rel=0.05
    )
    near = library.for_stiffening(known.eye.stiffening).for_contact(eye.wall.polar_rad)
    prior = prior_of(known, EXACT.reader)
    smoothing_m = EXACT.calibration.surface_smoothing_m
    assert len(left) == 5

    for frame in left:
        fit = fit_boundaries(
            near,
            frame.boundaries.lateral_m,
            frame.boundaries.depth_m,
            prior,
            smoothing_m,
        )
        assert fit is not None
        assert fit.force_n == pytest.approx(frame.force_n, rel=0.02)
