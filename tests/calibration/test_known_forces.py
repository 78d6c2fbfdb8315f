"""Frames of known force: E, k, level and growth from them, and the stiffening that
explains them best.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from math import log, log1p
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from analytic_frames import BOTH, LATERAL_M, LIBRARY, noisy_boundaries
from analytic_library import STIFFENINGS, made_up_library, solved_library, without_rests
from scipy.optimize import minimize
from small_recordings import calibration_of_a_sealed_eye

from predicted_walls import Walls, force_n as wall_force_n, predict_wall
from scleraforce.base.errors import CalibrationError, InputError
from scleraforce.calibration.calibrate import (
    SOUGHT_ON,
    calibrate_recordings,
    calibration_passes,
)
from scleraforce.calibration.calibration import Calibration
from scleraforce.calibration.stiffness_from_forces import (
    KnownForce,
    RereadEye,
    TissueTrial,
    most_trials,
    own_modulus_and_globe,
    place_of,
    read_again,
    regression,
    reread_eye,
    search_stiffening,
)
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import SHINE_MEAN_M, prior_of
from scleraforce.fit.unknowns import (
    DEPTH,
    GAP,
    IOP,
    LATERAL,
    MODULUS,
    NAMES,
    SHINE,
    THICKNESS,
    TIP,
)
from scleraforce.lab.training import interval_measurement
from scleraforce.library import Library
from scleraforce.library.library_plan import stiffening_place
from scleraforce.recordings.force_errors import LABEL_SD_N
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, REFERENCE_RIGIDITY, SEALED, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import (
    LibraryStudy,
    Range,
    ReaderStudy,
    Study,
    TissueStudy,
)
from scleraforce.wall.wall_in_metres import Boundaries

FILTERED = replace(
    SEALED,
    mean=REFERENCE_RIGIDITY,
    sd=0.05 * REFERENCE_RIGIDITY,
    correlation=-0.5,
    calibrated=True,
)


def filtered(globe: Globe = FILTERED, relative_sd: float = 0.02) -> Setup:
    """An eye after the filter."""
    return Setup(
        eye=Eye(
            modulus=Modulus(mean_pa=0.3e6, sd_pa=relative_sd * 0.3e6, source="own"),
            globe=globe,
        )
    )


def frames(
    library_n: Sequence[float],
    off: Sequence[float],
    setup: Setup,
    relative_sd: float = 0.015,
) -> list[KnownForce]:
    """Frames of an eye whose ln E, k over the reference's, level and growth are off by
    the given amounts.

    The deeper a dent, the less its force says of E and the more of k.
    """
    modulus, globe = own_modulus_and_globe(setup)
    found = []

    for force_n in library_n:
        by = 1.0 - 4.0 * force_n, 0.2 + 8.0 * force_n if globe.can_be_sealed else 0.0
        slopes = np.array([*by, 1.0, force_n / 60e-3 - 0.5])
        found.append(
            KnownForce(
                force_n=force_n * float(np.exp(slopes @ off)),
                library_n=force_n,
                sd_n=relative_sd * force_n,
                modulus_pa=modulus.mean_pa,
                rigidity=globe.mean,
                by_modulus=by[0],
                by_rigidity=by[1],
            )
        )

    return found


def slopes_of(frame: KnownForce) -> np.ndarray:
    return np.array(
        [frame.by_modulus, frame.by_rigidity, 1.0, frame.library_n / 60e-3 - 0.5]
    )


def squares(read: Sequence[KnownForce], off: np.ndarray) -> float:
    """Sum of the squares of residuals in standard deviations."""
    return sum(
        (np.log(frame.force_n / frame.library_n) - slopes_of(frame) @ off) ** 2
        / ((frame.sd_n / frame.library_n) ** 2 + (LABEL_SD_N / frame.force_n) ** 2)
        for frame in read
    )


def found_off(
    read: Sequence[KnownForce], setup: Setup
) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate of the regression, off the filter's, and its covariance."""
    found = regression(read, setup, place_of(setup))
    return found.mean - [*place_of(setup), 0.0, 0.0], found.covariance


OF_FILTER = np.array([[0.02**2, -0.5 * 0.02 * 0.05], [-0.5 * 0.02 * 0.05, 0.05**2]])


def test_the_mean_is_where_the_loss_is_least() -> None:
    """Against a minimum that is searched for without derivatives, of the loss written
    down once more.
    """
    known = filtered()
    read = frames((12e-3, 25e-3, 41e-3, 55e-3), (0.1, -0.2, 0.05, 0.3), known)
    scale = np.linalg.inv(OF_FILTER)

    def loss(off: np.ndarray) -> float:
        total = 4.0 * np.log1p(off[:2] @ scale @ off[:2] / 4.0)
        total += 4.0 * np.log1p((off[2] / 0.02) ** 2 / 4.0) + 4.0 * np.log1p(
            (off[3] / 0.035) ** 2 / 4.0
        )
        return float(total + squares(read, off))

    found, _ = found_off(read, known)
    near = minimize(
        loss,
        found,
        method="Nelder-Mead",
        options={"xatol": 1e-7, "fatol": 1e-10, "maxiter": 8000},
    )
    np.testing.assert_allclose(found, near.x, atol=1e-4)
    assert regression(read, known, found[:2] + place_of(known)).loss == pytest.approx(
        loss(found), rel=1e-6
    )
    assert regression(read, known, place_of(known)).loss > loss(found)


def test_frames_that_agree_promise_nothing_and_others_scatter() -> None:
    """The scatter is the part that the four do not explain, over the expected one of
    each frame.
    """
    known = filtered(OPEN)
    agreeing = frames((18e-3, 38e-3, 57e-3), (0.0, 0.0, 0.0, 0.0), known)
    for read in ([], agreeing):
        assert regression(read, known, place_of(known)).scatter == 1.0

    shifts = zip(agreeing, (0.05, -0.05, 0.04), strict=True)
    scattered = [
        replace(frame, force_n=frame.force_n * np.exp(shift)) for frame, shift in shifts
    ]
    expected = np.sqrt(
        (5.0 + squares(scattered, found_off(scattered, known)[0]) / 0.17) / 8.0
    )
    assert regression(scattered, known, place_of(known)).scatter == pytest.approx(
        expected
    )
    assert expected > 2.0


STUDY = replace(
    Study(), calibration=replace(Study().calibration, surface_smoothing_m=0.0)
)
TIPS_M = (0.5e-3, 1.1e-3, 1.7e-3)
MODULUS_PA = 0.3e6


def known_of(modulus_pa: float, relative_sd: float = 0.05) -> Setup:
    modulus = Modulus(mean_pa=modulus_pa, sd_pa=relative_sd * modulus_pa, source="own")
    return Setup(
        eye=Eye(modulus=modulus, iop_pa=270.0, thickness_m=0.65e-3, globe=OPEN),
        needle=Needle(gap_m=0.6e-3, polar_rad=0.0),
    )


def read_frames(factor: float = 1.0) -> list[tuple[Boundaries, float]]:
    """Boundaries of an eye at three dents, and their forces: the library's times a
    factor.
    """
    rng = np.random.default_rng(4)
    walls = Walls(LIBRARY)
    found = []

    for tip_m in TIPS_M:
        unknown = np.zeros(len(NAMES))
        unknown[[TIP, LATERAL, DEPTH]] = tip_m, 0.3e-3, 0.5e-3
        unknown[[GAP, THICKNESS, MODULUS, IOP, SHINE]] = (
            0.6e-3,
            0.65e-3,
            log(MODULUS_PA),
            log(270.0),
            SHINE_MEAN_M,
        )
        depth = noisy_boundaries(predict_wall(walls, unknown, BOTH), 3e-6, rng)
        known_n = factor * float(wall_force_n(walls, unknown[None])[0])
        found.append(
            (Boundaries(LATERAL_M, depth, float(np.diff(LATERAL_M)[0])), known_n)
        )

    return found


BLIND = Boundaries(LATERAL_M, np.full((2, len(LATERAL_M)), np.nan), 1e-4)


def corrected(after: RereadEye) -> list[float]:
    """Forces read in the frames, corrected by the discrepancy, over the known ones."""
    discrepancy = after.setup.eye.discrepancy
    assert discrepancy is not None
    return [
        float(discrepancy.corrected_n(np.array([one.library_n]))[0]) / one.force_n
        for one in after.again
        if one
    ]


def test_frames_are_read_again_at_their_own_resting_pressures() -> None:
    frame, *_ = read_frames()
    known = known_of(MODULUS_PA)
    leaked = [
        read_again(
            [frame],
            replace(known, eye=replace(known.eye, iop_pa=iop_pa)),
            LIBRARY,
            STUDY,
        )[0]
        for iop_pa in (270.0, 135.0)
    ]
    assert read_again([frame, frame], known, LIBRARY, STUDY, [270.0, 135.0]) == leaked
    assert leaked[0] != leaked[1]


def test_slopes_are_quotients_of_forces_that_are_read_with_another_modulus() -> None:
    moduli = (known_of(MODULUS_PA), known_of(1.05 * MODULUS_PA))
    for here, there in zip(
        *(read_again(read_frames(), each, LIBRARY, STUDY) for each in moduli),
        strict=True,
    ):
        assert here is not None
        assert there is not None
        assert log(there.library_n / here.library_n) == pytest.approx(
            here.by_modulus * log(1.05), abs=0.005
        )
        assert here.by_rigidity == 0.0


def test_a_modulus_that_the_filter_missed_is_found() -> None:
    for wrong in (0.6, 1.5):
        after = reread_eye(
            known_of(wrong * MODULUS_PA), read_frames(), (), LIBRARY, STUDY
        )
        assert own_modulus_and_globe(after.setup)[0].mean_pa == pytest.approx(
            MODULUS_PA, rel=0.05
        )
        assert corrected(after) == pytest.approx([1.0] * 3, rel=0.03)


def test_forces_are_surer_than_the_modulus_that_they_show() -> None:
    """An eye whose forces all lie 4 % off is read right, and its intervals are a
    frame's, not E's.
    """
    seen = read_frames(1.04)
    now = reread_eye(known_of(MODULUS_PA), seen, (), LIBRARY, STUDY).setup
    assert own_modulus_and_globe(now)[0].relative_sd > 0.015
    assert now.eye.discrepancy is not None
    apart = replace(now.eye.discrepancy, level_by=(0.0, 0.0), growth_by=(0.0, 0.0))

    for boundaries, known_n in seen[1:]:
        widths = []
        for each in (now, replace(now, eye=replace(now.eye, discrepancy=apart))):
            fit = fit_boundaries(
                LIBRARY,
                boundaries.lateral_m,
                boundaries.depth_m,
                prior_of(each, STUDY.reader),
            )
            assert fit is not None
            assert fit.force_n == pytest.approx(known_n, rel=0.03)
            widths.append(float(np.diff(np.log(fit.interval_n))[0]))

        assert widths[0] < 0.9 * widths[1]


def test_frames_that_were_read_before_count_like_the_others() -> None:
    seen = read_frames(1.1)
    known = known_of(MODULUS_PA)
    earlier = [
        frame for frame in read_again(seen, known, LIBRARY, STUDY) if frame is not None
    ]
    at_once = reread_eye(known, seen, (), LIBRARY, STUDY).setup
    parts = reread_eye(known, seen[2:], earlier[:2], LIBRARY, STUDY).setup
    assert own_modulus_and_globe(parts)[0].mean_pa == pytest.approx(
        own_modulus_and_globe(at_once)[0].mean_pa, rel=0.01
    )

    for now, before in (([*seen, (BLIND, 2.0 * seen[-1][1])], []), (seen[:1], earlier)):
        found = reread_eye(known, now, before, LIBRARY, STUDY).setup.eye.discrepancy
        assert found is not None
        assert found.largest_n == seen[-1][1]  # of the frames that could be read


def test_without_a_frame_that_can_be_read_the_filter_s_stays() -> None:
    after = reread_eye(known_of(MODULUS_PA), [(BLIND, 0.02)], (), LIBRARY, STUDY)
    assert after.again == (None,)
    assert own_modulus_and_globe(after.setup)[0].mean_pa == pytest.approx(
        MODULUS_PA, rel=1e-9
    )
    found = after.setup.eye.discrepancy
    assert found is not None
    assert (found.level, found.growth, found.largest_n) == (0.0, 0.0, None)


def test_the_loss_of_a_stiffening_is_the_loss_of_the_frames_that_were_read() -> None:
    """Rougher boundaries lose more, and forces that E cannot explain; a frame that
    cannot be read counts as refused.
    """
    known = known_of(MODULUS_PA)
    after = reread_eye(known, [*read_frames(), (BLIND, 0.02)], (), LIBRARY, STUDY)
    trial = after.trial("an eye", 2)
    lost = [frame.loss for frame in after.again if frame is not None]
    assert (trial.found, trial.refused, trial.frames) == ("an eye", 3, 3)
    assert trial.of_boundaries == pytest.approx(sum(lost))
    assert min(lost) > 0.0
    assert trial.of_forces == after.loss
    assert trial.loss == pytest.approx(trial.of_boundaries + trial.of_forces)
    rng = np.random.default_rng(1)
    rough = [
        (
            replace(
                seen,
                depth_m=seen.depth_m
                + 20e-6 * np.sin(LATERAL_M / 0.4e-3 + rng.uniform(0.0, 6.0)),
            ),
            force_n,
        )
        for seen, force_n in read_frames()
    ]
    assert (
        reread_eye(known, rough, (), LIBRARY, STUDY).trial("", 0).of_boundaries
        > 3.0 * trial.of_boundaries
    )
    bent = [
        (seen, force_n * factor)
        for (seen, force_n), factor in zip(read_frames(), (0.8, 1.0, 1.25), strict=True)
    ]
    assert reread_eye(known, bent, (), LIBRARY, STUDY).loss > after.loss + 5.0


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
    able: Callable[[float], bool] = lambda _: True,
    library: Library = MADE_UP,
) -> tuple[float | None, list[float]]:
    """Return the stiffening that is found for an eye whose losses are functions of ln(1
    + b), and the tried ones.
    """
    tried = list[float]()

    def calibrate(walls: Library) -> TissueTrial[float] | None:
        tried.append(walls.stiffening)
        place = log1p(walls.stiffening)
        lost = {
            "of_boundaries": boundaries(place),
            "of_forces": forces(place),
            "refused": int(refused(place)),
        }

        return (
            TissueTrial(found=walls.stiffening, frames=TRIAL_FRAMES, **lost)
            if able(place)
            else None
        )

    found = search_stiffening(library, calibrate)
    assert len(tried) == len(set(tried)) <= most_trials(library)
    assert found is None or found[0] == found[1] in tried
    return found and log1p(found[0]), tried


def prior(place: float) -> float:
    """Cauchy's density of ln(1 + b), of scale 0.5, at two scales half as sure."""
    return 4.0 * log(1.0 + place**2)


def test_the_least_loss_between_the_library_s_stiffenings_is_found() -> None:
    """Within 0.1 of ln(1 + b), and no worse by more than half of a square of a standard
    deviation.
    """
    for least, lopsided in product((0.9, 1.6, 2.0, 2.7, 3.1), (0.0, 0.15)):

        def whole(
            place: float, least: float = least, lopsided: float = lopsided
        ) -> float:
            return bowl(40.0, least)(place) * (
                1.0 + lopsided * (place - least)
            ) + prior(place)

        best = min(np.linspace(0.0, PLACES[-1], 3001).tolist(), key=whole)
        found, _ = sought(lambda place, whole=whole: whole(place) - prior(place))
        assert found == pytest.approx(best, abs=0.1)
        assert whole(found) < whole(best) + 0.5


def test_a_stiffening_beside_neighbours_that_lose_much_is_found() -> None:
    """Between none and the first; and before the last one, where losses level off, as
    of a thick wall of b = 20.
    """
    for least in (0.35, 0.45, 0.6):
        assert sought(bowl(60.0, least))[0] == pytest.approx(least, abs=0.15)

    for least in (2.9, 3.04):
        near = bowl(1.0 / 0.8**2, least)
        found, _ = sought(
            boundaries=lambda place, near=near: (
                EVEN + 270.0 * (1.0 - np.exp(-near(place)))
            )
        )
        assert found == pytest.approx(least, abs=0.15)


def test_tissue_does_not_stiffen_unless_its_frames_say_so() -> None:
    for forces, stiffens in (
        (0.0, False),
        (3.0, False),
        (3.6, True),
    ):
        # 3.0 is less than the prior of any node
        found, _ = sought(lambda place, forces=forces: forces * (place < 0.5))
        assert bool(found) == stiffens

    for level, boundaries, stiffens in (
        (0.1, 9.0, True),
        (1.0, 9.0, True),
        (10.0, 9.0, False),
        (1.0, 3.0, False),
    ):
        # The loss that all walls share says how much a difference counts.
        found, _ = sought(
            boundaries=lambda place, level=level, more=boundaries: (
                level * EVEN + more * (place < 0.5)
            )
        )
        assert bool(found) == stiffens


def test_a_stiffening_that_refuses_frames_that_others_take_never_wins() -> None:
    for best in PLACES:
        found, _ = sought(
            lambda place, best=best: 50.0 * (abs(place - best) > 0.3),
            refused=lambda place, best=best: abs(place - best) < 0.3,
        )
        assert abs(found - best) > 0.3

    found, _ = sought(bowl(30.0, 2.3), refused=lambda place: 2 if place < 1.5 else 1)
    # all refuse frames, and the fewest count
    assert found == pytest.approx(2.27, abs=0.1)
    found, _ = sought(
        boundaries=lambda place: 25.0 - 10.0 * (place > 1.0),
        refused=lambda place: 0.1 < place < 0.8,
    )
    assert found > 1.0  # the search does not end at walls that refuse a frame
    poor = TissueTrial(
        found="poor", refused=11, frames=1, of_boundaries=500.0, of_forces=500.0
    )
    lost = TissueTrial.diverged("diverged", 0)
    result = search_stiffening(
        MADE_UP, lambda library: poor if library.stiffening == STIFFENINGS[2] else lost
    )
    assert result is not None
    assert result[1] == "poor"  # better than any that diverged


def test_stiffenings_beyond_large_losses_are_not_tried() -> None:
    found, tried = sought(lambda place: 6.0 * place)
    assert (found, tried[:3], max(tried)) == (
        0.0,
        STIFFENINGS[:3].tolist(),
        STIFFENINGS[2],
    )
    # with the prior 4.7 at most: less than enough
    found, tried = sought(lambda place: -0.5 * place**2)
    assert found == 0.0
    assert set(STIFFENINGS.tolist()) <= set(tried)
    # Walls that no stiffening explains: two that do worse and worse are enough.
    _, tried = sought(boundaries=lambda place: 20.0 * EVEN * (1.0 + place))
    assert max(tried) == STIFFENINGS[2]
    found, tried = sought(lambda place: 0.5 * (place - 0.5) ** 2)
    # what is left to gain is less than the forces show
    assert len(tried) <= len(STIFFENINGS) + 1
    # A parabola through walls far apart says little: an eye of b = 20, whose best walls
    # lie between alike ones.
    places = np.log1p([0.0, 0.5, 2.26, 8.42, 15.3, 30.0])
    uneven = [188.9, 182.7, 163.1, 110.0, 71.3, 109.2]
    found, _ = sought(boundaries=lambda place: float(np.interp(place, places, uneven)))
    assert found == pytest.approx(places[4], abs=0.1)
    # Far from the eye's tissue a filter may end anywhere: that the second loses more
    # than the first says nothing.
    lost = np.array([300.0, 900.0, 60.0, EVEN, 80.0])
    found, _ = sought(
        boundaries=lambda place: float(lost[np.abs(PLACES - place).argmin()]) + place
    )
    assert found == pytest.approx(PLACES[3], abs=0.3)


def test_beside_a_stiffening_that_is_ruled_out_the_next_one_is_halfway_to_the_other_neighbour():
    """The least loss lies between the third and the fourth; the first two or the last
    one refuse a frame.
    """
    halfway = 0.5 * float(stiffening_place(STIFFENINGS[2:4]).sum())
    for forces, refused, least in (
        (bowl(20.0, 1.6), lambda place: place < 0.5, 1.55),
        (bowl(30.0, 1.9), lambda place: place > 3.0, 1.85),
    ):
        found, tried = sought(forces, refused=refused)
        assert found == pytest.approx(least, abs=0.2)
        first = next(each for each in tried if each not in STIFFENINGS)
        assert stiffening_place(np.array(first)) == pytest.approx(halfway)


# Whole calibrations: the trials, the result, and the counted steps.


@dataclass
class Calibrating:
    """Replaces the calibration with one tissue: its loss is a function of ln(1 + b), or
    it has a fault.
    """

    loss: Callable[[float], float] = lambda place: 40.0 * (place - 1.6) ** 2
    fault: str | None = None
    tried: list[tuple[float, bool]] = field(default_factory=list)
    frames: list[int | None] = field(default_factory=list)

    def __call__(self, recording: Any, way: Any, _frames: Any, earlier: Any) -> Any:
        self.frames.append(way.frames)
        self.tried.append((way.library.stiffening, earlier is not None))
        way.count(len(recording.frames))
        if self.fault is not None:
            raise CalibrationError(f"{self.fault} {len(self.tried)}")

        loss = self.loss(log1p(way.library.stiffening))
        eye = replace(
            calibration_of_a_sealed_eye().eyes["mine"],
            stiffening=way.library.stiffening,
        )

        return TissueTrial(
            found=eye,
            refused=0,
            frames=TRIAL_FRAMES,
            of_boundaries=EVEN,
            of_forces=loss,
        )


@pytest.fixture
def calibrating(monkeypatch: pytest.MonkeyPatch) -> Calibrating:
    made = Calibrating()
    monkeypatch.setattr("scleraforce.calibration.calibrate.calibrate_eye", made)
    return made


def recorded(frames: int = 8) -> Any:
    """As much of a recording as `calibrate_recordings` needs."""
    eye = Eye("mine")
    scan = Scan()
    return SimpleNamespace(
        info=SimpleNamespace(eye=eye, eye_name=eye.name, scan=scan),
        frames=range(frames),
        moments=(),
        path=Path("r"),
    )


def calibration_of(study: Study | None = None, **given: Any) -> Calibration:
    return calibrate_recordings(
        [recorded()], study or Study(), "hash", MADE_UP, **given
    )


def test_the_stiffening_is_sought_unless_it_is_left_out(
    calibrating: Calibrating,
) -> None:
    steps: list[int] = []
    eye = calibration_of(progress=steps.append).eyes["mine"]
    assert log1p(eye.stiffening) == pytest.approx(1.55, abs=0.1)
    assert len(calibrating.tried) >= 4
    assert (
        sum(steps)
        == 8 * calibration_passes(MADE_UP, None)
        == 8 * (most_trials(MADE_UP) + 1)
    )
    assert calibration_passes(MADE_UP, ("e",)) == calibration_passes(None, None) == 1


def test_it_is_sought_on_a_few_frames_and_then_all_that_are_wanted_are_calibrated_on(
    calibrating: Calibrating,
) -> None:
    for wanted in (None, 3, 6, 40):
        calibrating.frames.clear()
        eye = calibration_of(frames=wanted).eyes["mine"]
        few = wanted in (3, 6)
        tried = calibrating.frames if few else calibrating.frames[:-1]
        assert set(tried) == {wanted if few else SOUGHT_ON}
        assert calibrating.frames[-1] == wanted
        assert few or calibrating.tried[-1] == (eye.stiffening, False)

    calibrating.frames.clear()
    calibrating.tried.clear()
    calibrate_recordings([recorded(3)], Study(), "hash", MADE_UP)
    # of a short recording once with each tissue
    assert set(calibrating.frames) == {None}
    assert len(calibrating.tried) == len(set(calibrating.tried))


def test_a_stiffening_that_is_not_sought_is_the_study_s(
    calibrating: Calibrating,
) -> None:
    def found(study: Study | None = None, **given: Any) -> tuple[float, int]:
        steps = list[int]()
        return calibration_of(study, progress=steps.append, **given).eyes[
            "mine"
        ].stiffening, sum(steps)

    for stiffening in (0.0, 5.0):
        study = replace(Study(), tissue=TissueStudy(stiffening=stiffening))
        assert found(study, parameters=("e", "iop")) == (stiffening, 8)
        assert calibrating.tried.pop() == (stiffening, False)

    with pytest.raises(
        InputError, match="stiffening: 50 is outside the library's range, 0 to 30"
    ):
        found(replace(Study(), tissue=TissueStudy(stiffening=50.0)), parameters=("e",))

    assert not calibrating.tried


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
    reader=ReaderStudy(
        uneven_share=0.0,
        iop_noise_fraction=0.0,
        thickness_noise_fraction=0.0,
        gap_noise_fraction=0.0,
        stiffening_share=0.0,
        interval_boundary_errors=0.0,
        youngs_modulus_pa=Range(min=0.2e6, max=0.4e6),
        thickness_m=Range(min=500e-6, max=700e-6),
        iop_pa=Range(min=200.0, max=400.0),
    )
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stiffening", "seed"), [(0.0, 1), (3.0, 1), (9.0, 2), (20.0, 1)]
)
def test_the_stiffening_of_an_eye_is_found_from_three_frames_and_the_others_are_read_right(
    stiffening: float, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
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
