"""The search of an eye's stiffening, on losses that are made up, and in whole calibrations."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from math import log, log1p
from typing import Any

import numpy as np
import pytest
from analytic_library import STIFFENINGS, analytic_library, made_up_library, solved_library, without_rests
from small_recordings import calibration_of_a_sealed_eye

from scleraforce.calibration.calibrate import SOUGHT_ON, calibrate_recordings, calibration_passes
from scleraforce.calibration.known_forces import TissueTrial, most_trials, search
from scleraforce.calibration.result import Calibration, EyeCalibration
from scleraforce.errors import CalibrationError, InputError
from scleraforce.learning import virtual_eyes
from scleraforce.library import Library
from scleraforce.library.fit import fit_boundaries
from scleraforce.library.plan import stiffening_place
from scleraforce.library.prior import prior_of
from scleraforce.study import LibraryStudy, Range, ReaderStudy, Study, TissueStudy

LIBRARY = made_up_library()
PLACES = np.log1p(STIFFENINGS)  # of the library's stiffenings: 0, 0.41, 1.18, 2.24 and 3.43
FRAMES, EVEN = 3, 15.0  # what the boundaries of three frames of an even wall lose


@dataclass
class Eye:
    """An eye whose trials lose what functions of ln(1 + b) say; `tried` are the stiffenings asked for."""

    forces: Callable[[float], float] = lambda _: 0.0
    boundaries: Callable[[float], float] = lambda _: EVEN
    refused: Callable[[float], int] = lambda _: 0
    able: Callable[[float], bool] = lambda _: True
    tried: list[float] = field(default_factory=list)

    def __call__(self, library: Library) -> TissueTrial[str] | None:
        self.tried.append(library.stiffening)
        place = log1p(library.stiffening)
        if not self.able(place):
            return None
        return TissueTrial(
            found=f"with {library.stiffening:g}",
            refused=self.refused(place),
            frames=FRAMES,
            of_boundaries=self.boundaries(place),
            of_forces=self.forces(place),
        )


def found_of(eye: Eye, library: Library = LIBRARY) -> float:
    """What is found, as ln(1 + b); it goes with what was calibrated with it, and is among what was tried."""
    result = search(library, eye)
    assert result is not None
    stiffening, found = result
    assert found == f"with {stiffening:g}"
    assert stiffening in eye.tried
    assert len(eye.tried) == len(set(eye.tried)) <= most_trials(library)
    return log1p(stiffening)


def prior(place: float) -> float:
    """What a stiffening loses by being one: Cauchy's density of ln(1 + b), of scale 0.5, at two scales half as sure."""
    return 4.0 * log(1.0 + place**2)


@pytest.mark.parametrize("least", [0.9, 1.6, 2.0, 2.7, 3.1])
@pytest.mark.parametrize("lopsided", [0.0, 0.15])
def test_the_least_loss_between_the_library_s_stiffenings_is_found(least: float, lopsided: float) -> None:
    """Within 0.1 of ln(1 + b), and no worse by more than half of a square of a standard deviation."""

    def forces(place: float) -> float:
        return 40.0 * (place - least) ** 2 * (1.0 + lopsided * (place - least))

    def whole(place: float) -> float:
        return forces(place) + prior(place)

    places = np.linspace(0.0, PLACES[-1], 3001)
    best = min(places.tolist(), key=whole)
    found = found_of(Eye(forces))
    assert found == pytest.approx(best, abs=0.1)
    assert whole(found) < whole(best) + 0.5


@pytest.mark.parametrize("least", [0.35, 0.45, 0.6])
def test_a_stiffening_between_none_and_the_first_that_loses_too_much_is_found(least: float) -> None:
    """Frames that are sure of it: both neighbours lose more than is enough to try no farther ones."""
    found = found_of(Eye(forces=lambda place: 60.0 * (place - least) ** 2))
    assert found == pytest.approx(least, abs=0.15)


@pytest.mark.parametrize("least", [2.9, 3.04])
def test_a_least_loss_before_the_last_stiffening_is_found_where_losses_level_off(least: float) -> None:
    """As boundaries of a thick wall of b = 20 lose: 289, 254, 140 and 68 at the library's, 13 at 20."""
    found = found_of(Eye(boundaries=lambda place: EVEN + 270.0 * (1.0 - np.exp(-(((place - least) / 0.8) ** 2)))))
    assert found == pytest.approx(least, abs=0.15)


def test_tissue_counts_as_none_that_stiffens_where_its_frames_do_not_say_so() -> None:
    assert found_of(Eye()) == 0.0
    assert found_of(Eye(forces=lambda place: 3.0 * (place < 0.5))) == 0.0  # less than the prior of any node
    assert found_of(Eye(forces=lambda place: 3.6 * (place < 0.5))) > 0.0


@pytest.mark.parametrize("kind", ["forces", "boundaries"])
def test_both_losses_count(kind: str) -> None:
    eye = Eye(**{kind: lambda place: EVEN + 30.0 * (place - 1.6) ** 2})
    assert found_of(eye) == pytest.approx(1.55, abs=0.1)


@pytest.mark.parametrize("best", [0, 1, 2, 3, 4])
def test_a_stiffening_that_refuses_frames_that_others_take_never_wins(best: int) -> None:
    eye = Eye(
        forces=lambda place: 0.0 if abs(place - PLACES[best]) < 0.3 else 50.0,
        refused=lambda place: int(abs(place - PLACES[best]) < 0.3),
    )
    assert abs(found_of(eye) - PLACES[best]) > 0.3


def test_where_all_refuse_frames_the_fewest_count() -> None:
    eye = Eye(forces=lambda place: 30.0 * (place - 2.3) ** 2, refused=lambda place: 2 if place < 1.5 else 1)
    assert found_of(eye) == pytest.approx(2.27, abs=0.1)


def test_stiffenings_beyond_those_that_lose_too_much_are_not_tried() -> None:
    steep = Eye(forces=lambda place: 20.0 * place)
    assert found_of(steep) == 0.0
    assert steep.tried[:3] == STIFFENINGS[:3].tolist()
    assert max(steep.tried) == STIFFENINGS[2]
    flat = Eye(forces=lambda place: 0.4 * place)  # with the prior 11.6 at most: less than what is enough
    assert found_of(flat) == 0.0
    assert set(STIFFENINGS.tolist()) <= set(flat.tried)


def test_it_does_not_end_at_walls_that_explain_nothing_themselves() -> None:
    """Far from the eye's tissue a filter may end anywhere: that the second loses more than the first says nothing."""
    lost = dict(zip(STIFFENINGS.tolist(), (300.0, 900.0, 60.0, EVEN, 80.0), strict=True))
    eye = Eye(boundaries=lambda place: lost.get(min(STIFFENINGS, key=lambda b: abs(log1p(b) - place)), 0.0) + place)
    assert found_of(eye) == pytest.approx(PLACES[3], abs=0.3)


def test_it_does_not_end_at_walls_that_refuse_a_frame() -> None:
    eye = Eye(boundaries=lambda place: 25.0 - 10.0 * (place > 1.0), refused=lambda place: int(0.1 < place < 0.8))
    assert found_of(eye) > 1.0


def test_one_that_diverged_counts_for_less_than_one_that_refuses_most_frames() -> None:
    def calibrate(library: Library) -> TissueTrial[str]:
        if library.stiffening == STIFFENINGS[2]:
            return TissueTrial(found="poor", refused=11, frames=1, of_boundaries=500.0, of_forces=500.0)
        return TissueTrial.diverged("diverged", 0)

    result = search(LIBRARY, calibrate)
    assert result is not None
    assert result[1] == "poor"


def test_where_no_stiffening_has_such_an_eye_there_is_none() -> None:
    eye = Eye(able=lambda _: False)
    assert search(LIBRARY, eye) is None
    assert eye.tried == STIFFENINGS.tolist()


@pytest.mark.parametrize("lost", [0, 1, 2, 3, 4])
def test_one_stiffening_without_the_eye_does_not_end_the_search(lost: int) -> None:
    kept = 2 if lost != 2 else 1
    eye = Eye(
        forces=lambda place: 40.0 * (place - PLACES[kept]) ** 2,
        able=lambda place: abs(place - PLACES[lost]) > 1e-9,
    )
    assert found_of(eye) == pytest.approx(PLACES[kept], abs=0.15)


def test_beside_one_out_of_the_question_it_goes_on_halfway_to_the_other_neighbour() -> None:
    """The least loss lies between the third and the fourth; the first two or the last one refuse a frame."""
    halfway = 0.5 * float(stiffening_place(STIFFENINGS[2:4]).sum())
    eye = Eye(forces=lambda place: 20.0 * (place - 1.6) ** 2, refused=lambda place: int(place < 0.5))
    assert found_of(eye) == pytest.approx(1.55, abs=0.2)
    assert stiffening_place(np.array(eye.tried[5])) == pytest.approx(halfway)
    beyond = Eye(forces=lambda place: 30.0 * (place - 1.9) ** 2, refused=lambda place: int(place > 3.0))
    assert found_of(beyond) == pytest.approx(1.85, abs=0.2)
    assert stiffening_place(np.array(beyond.tried[5])) == pytest.approx(halfway)


@pytest.mark.parametrize(("level", "stiffens"), [(0.1, True), (1.0, True), (10.0, False)])
def test_walls_that_are_none_of_the_library_s_say_less_of_their_tissue(level: float, stiffens: bool) -> None:
    """The same difference between the stiffenings; what all of them lose alike says how much it counts."""
    eye = Eye(boundaries=lambda place: level * EVEN + (0.0 if place > 0.5 else 9.0))
    assert (found_of(eye) > 0.0) == stiffens
    assert found_of(Eye(boundaries=lambda place: level * EVEN + 3.0 * (place < 0.5))) == 0.0


def test_a_library_of_one_stiffening_is_tried_once_with_it() -> None:
    alone, eye = analytic_library(thicknesses=4, ratios=4, tips=5, nodes=9), Eye()
    assert found_of(eye, alone) == 0.0
    assert (eye.tried, most_trials(alone)) == ([0.0], 1)


# Whole calibrations: what is tried, what comes of it, and what is counted.


def trial_of(library: Library, loss: float) -> TissueTrial[EyeCalibration]:
    """What a calibration with walls of one tissue returns."""
    eye = replace(calibration_of_a_sealed_eye().eyes["mine"], stiffening=library.stiffening)
    return TissueTrial(found=eye, refused=0, frames=FRAMES, of_boundaries=EVEN, of_forces=loss)


@dataclass
class Calibrating:
    """Stands for the calibration with one tissue: it loses what a function of ln(1 + b) says, or cannot."""

    loss: Callable[[float], float] = lambda place: 40.0 * (place - 1.6) ** 2
    fault: str | None = None
    tried: list[tuple[float, bool]] = field(default_factory=list)
    frames: list[int | None] = field(default_factory=list)

    def __call__(self, recording: Any, way: Any, _frames: Any, earlier: Any, count: Callable[[int], None]) -> Any:
        self.frames.append(way.frames)
        self.tried.append((way.library.stiffening, earlier is not None))
        count(len(recording.frames))
        if self.fault is not None:
            raise CalibrationError(f"{self.fault} {len(self.tried)}")
        return trial_of(way.library, self.loss(log1p(way.library.stiffening)))


@pytest.fixture
def calibrating(monkeypatch: pytest.MonkeyPatch) -> Calibrating:
    made = Calibrating()
    monkeypatch.setattr("scleraforce.calibration.calibrate.calibrate_eye", made)
    return made


@dataclass(frozen=True)
class Recorded:
    """As much of a recording as `calibrate_recordings` asks for."""

    @dataclass(frozen=True)
    class Named:
        id: str = "mine"
        globe: str | None = None

    @dataclass(frozen=True)
    class Info:
        eye: Any

    info: Any = Info(Named())
    frames: tuple[int, ...] = tuple(range(8))


def calibration_of(study: Study | None = None, **given: Any) -> Calibration:
    return calibrate_recordings([Recorded()], study or Study(), "hash", LIBRARY, **given)  # type: ignore[list-item]


def test_the_stiffening_is_sought_unless_it_is_left_out(calibrating: Calibrating) -> None:
    steps: list[int] = []
    eye = calibration_of(progress=steps.append).eyes["mine"]
    assert log1p(eye.stiffening) == pytest.approx(1.55, abs=0.1)
    assert len(calibrating.tried) >= 4
    assert sum(steps) == 8 * calibration_passes(LIBRARY, None) == 8 * (most_trials(LIBRARY) + 1)
    assert calibration_passes(LIBRARY, ("e",)) == calibration_passes(None, None) == 1


@pytest.mark.parametrize("wanted", [None, 3, 6, 40])
def test_it_is_sought_on_a_few_frames_and_then_all_that_are_wanted_are_calibrated_on(
    calibrating: Calibrating, wanted: int | None
) -> None:
    eye = calibration_of(frames=wanted).eyes["mine"]
    few = wanted in (3, 6)
    tried = calibrating.frames if few else calibrating.frames[:-1]
    assert set(tried) == {wanted if few else SOUGHT_ON}
    assert calibrating.frames[-1] == wanted
    assert few or calibrating.tried[-1] == (eye.stiffening, False)


def test_a_short_recording_is_calibrated_on_once_with_each_tissue(calibrating: Calibrating) -> None:
    calibrate_recordings([Recorded(frames=(1, 2, 3))], Study(), "hash", LIBRARY)  # type: ignore[list-item]
    assert set(calibrating.frames) == {None}
    assert len(calibrating.tried) == len(set(calibrating.tried))


def test_nobody_is_warned_of_a_filter_with_walls_that_are_far_off(calibrating: Calibrating) -> None:
    calibrating.loss = lambda place: float(np.nan_to_num(np.sqrt(np.array(-place)))) + (place - 1.6) ** 2
    assert calibration_of().eyes["mine"].stiffening > 0.0


@pytest.mark.parametrize("stiffening", [0.0, 5.0])
def test_where_it_is_not_sought_it_is_the_study_s(calibrating: Calibrating, stiffening: float) -> None:
    study, steps = replace(Study(), tissue=TissueStudy(stiffening=stiffening)), list[int]()
    eye = calibration_of(study, parameters=("e", "iop"), progress=steps.append).eyes["mine"]
    assert calibrating.tried == [(stiffening, False)]
    assert (eye.stiffening, sum(steps)) == (stiffening, 8)


def test_a_stiffening_that_the_library_does_not_hold_is_refused(calibrating: Calibrating) -> None:
    study = replace(Study(), tissue=TissueStudy(stiffening=50.0))
    with pytest.raises(InputError, match="stiffening: 50 is outside the library's range, 0 to 30"):
        calibration_of(study, parameters=("e",))
    assert not calibrating.tried


def test_an_earlier_calibration_goes_on_with_its_stiffening(calibrating: Calibrating) -> None:
    begun = calibration_of_a_sealed_eye()
    earlier = replace(begun, eyes={"mine": replace(begun.eyes["mine"], stiffening=7.0)})
    steps: list[int] = []
    eye = calibration_of(earlier=earlier, progress=steps.append).eyes["mine"]
    assert calibrating.tried == [(7.0, True)]
    assert eye.stiffening == 7.0
    assert sum(steps) == 8 * calibration_passes(LIBRARY, None)


def test_where_no_tissue_will_do_the_first_fault_is_said(calibrating: Calibrating) -> None:
    calibrating.fault = "no frame"
    with pytest.raises(CalibrationError, match=r"^no frame 1$"):
        calibration_of()


def test_the_population_s_stiffening_is_a_mean_of_its_logarithm() -> None:
    one = calibration_of_a_sealed_eye().eyes["mine"]
    eyes = {str(b): replace(one, id=str(b), stiffening=b) for b in (0.0, 3.0, 31.0)}
    assert Calibration(eyes, "", (5e-3, 30e-3), "finite-strain").population_stiffening == pytest.approx(
        128 ** (1 / 3) - 1
    )


# Eyes of a library's own walls, seen without errors.

GRID = LibraryStudy(thickness_m=Range(min=0.45e-3, max=0.8e-3), thicknesses=4, tension=Range(min=4e-3, max=0.12),
                    tensions=5, max_tip_m=5e-3, tips=20, elements=32)  # fmt: skip
EXACT = Study(
    reader=ReaderStudy(
        uneven_share=0.0, iop_noise_fraction=0.0, thickness_noise_fraction=0.0, gap_noise_fraction=0.0,
        stiffening_share=0.0, interval_boundary_errors=0.0, youngs_modulus_pa=Range(min=0.2e6, max=0.4e6),
        thickness_m=Range(min=500e-6, max=700e-6), iop_pa=Range(min=200.0, max=400.0),
    )
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("stiffening", "seed"), [(0.0, 1), (3.0, 1), (9.0, 2), (20.0, 1)])
def test_the_stiffening_of_an_eye_is_found_from_three_frames_and_the_others_are_read_right(
    stiffening: float, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An open eye of even form, whose boundaries and forces are known without errors."""
    monkeypatch.setattr(virtual_eyes, "label_forces", partial(without_rests, sd_n=0.0))
    library, rng = solved_library(GRID), np.random.default_rng(seed)
    eye = virtual_eyes.draw_eye(EXACT, library.for_stiffening(stiffening), 0, rng)
    assert eye.stiffening == stiffening
    frames = virtual_eyes.draw_frames(eye, EXACT, 8, rng)
    known, left = virtual_eyes.calibrated(eye, frames, EXACT, library, rng)
    assert known.modulus is not None
    assert known.stiffening is not None
    assert log1p(known.stiffening) == pytest.approx(log1p(stiffening), abs=0.3)
    assert known.modulus.mean_pa == pytest.approx(eye.wall.youngs_modulus_pa, rel=0.05)
    near = library.for_stiffening(known.stiffening).for_contact(eye.wall.polar_rad)
    prior, smoothing_m = prior_of(known, EXACT.reader), EXACT.calibration.surface_smoothing_m
    assert len(left) == 5
    for frame in left:
        fit = fit_boundaries(near, frame.boundaries.lateral_m, frame.boundaries.depth_m, prior, smoothing_m)
        assert fit is not None
        assert fit.force_n == pytest.approx(frame.force_n, rel=0.02)
