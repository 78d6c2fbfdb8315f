"""What an eye's frames of known force say once they are read as a reader would (`known.discrepancy`).

The filter weighs the frames one after the other, each linearised where it stood then, and takes the library's walls for
the eye's. In the end the frames are read once more, all with the same E and k; their known forces over those that are
read tell how far E, k and the forces' level and growth are off (`known_forces`). What the frames tell of the four
together is far surer than what they tell of each: the discrepancy is known given E and k (`ForceDiscrepancy`), and the
force at a dent like those of the frames is known best.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, log
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.known_forces import (
    OF_MODULUS,
    OF_RIGIDITY,
    Found,
    KnownForce,
    globe_of,
    place_of,
    regression,
)
from scleraforce.calibration.stiffening import TissueTrial
from scleraforce.fitting.library_fit import NO_WALL_M, BoundaryFit, fit_boundaries, fit_from
from scleraforce.fitting.prior import prior_of
from scleraforce.known.correlation import correlation_of, within_bounds
from scleraforce.known.discrepancy import ForceDiscrepancy
from scleraforce.known.eye import Known, Modulus
from scleraforce.known.globe import NINETY_PERCENT, REFERENCE_RIGIDITY
from scleraforce.library import Library
from scleraforce.segmentation.observations import Boundaries
from scleraforce.study import Study

Array = NDArray[np.float64]
Taken = TypeVar("Taken")

MODULUS_STEP, RIGIDITY_STEP, LEAST_RIGIDITY = 0.02, 0.05, 0.1  # of ln E; of k, as a share of it, or of the reference's
LARGEST_STEP = 0.5  # of ln E, before the frames are read anew
READINGS = 5  # at most; what moves by less than a step is not read anew
CERTAIN = 0.001  # of a standard deviation: nothing is left of it


@dataclass(frozen=True)
class Settled:
    """What is known of an eye, what its frames read (None: cannot be read), and what their forces lose."""

    known: Known
    again: tuple[KnownForce | None, ...]
    loss: float

    def trial(self, found: Taken, refused: int) -> TissueTrial[Taken]:
        """Return what `stiffening.search` compares; `refused`: how many frames the filter did not take."""
        read = [frame for frame in self.again if frame is not None]
        refused += len(self.again) - len(read)
        return TissueTrial(
            found=found,
            refused=refused,
            frames=len(read),
            of_boundaries=sum(frame.loss for frame in read),
            of_forces=self.loss,
        )


def settled(
    known: Known,
    frames: Sequence[tuple[Boundaries, float]],
    earlier: Sequence[KnownForce],
    library: Library,
    study: Study,
) -> Settled:
    """Return what is known of an eye once its frames are read again.

    Args:
        known: of the eye, with its own modulus, after the filter.
        frames: boundaries, and the force that is known, N.
        earlier: frames that were read again before, and are no longer at hand.
        library: for any contact.
        study: of the calibration.
    """
    now, again = known, read_again(frames, known, library, study)
    read = _all_read(earlier, again)
    found = regression(read, known, place_of(now))
    for _ in range(READINGS - 1):
        moved = _moved(now, found)
        near = (np.abs(place_of(moved) - place_of(now)) < _steps(now)).all()
        if near or not read:
            now = moved
            break
        moved_again = read_again(frames, moved, library, study)
        moved_read = _all_read(earlier, moved_again)
        moved_found = regression(moved_read, known, place_of(moved))
        if len(moved_read) < len(read) or moved_found.loss >= found.loss:
            break
        now, again, read, found = moved, moved_again, moved_read, moved_found
    return Settled(_with_discrepancy(now, found, [frame.force_n for frame in read]), tuple(again), found.loss)


def _all_read(earlier: Sequence[KnownForce], again: Sequence[KnownForce | None]) -> list[KnownForce]:
    return [*earlier, *(frame for frame in again if frame is not None)]


def read_again(
    frames: Sequence[tuple[Boundaries, float]], known: Known, library: Library, study: Study
) -> list[KnownForce | None]:
    """Return what an eye's frames read without their forces, each None where it cannot be read.

    What the frames share, E and k, is taken for certain: it is no noise between them.

    Args:
        frames: boundaries, and the force that is known, N.
        known: of the eye, with its own modulus.
        library: for any contact.
        study: of the calibration.
    """
    assert known.modulus is not None  # its own
    near = library.nearest_contact(known.polar_rad)
    modulus_step, rigidity_step = _steps(known)
    certain = [_certain(known), _certain(known, modulus_step)]
    if globe_of(known).can_be_sealed:
        certain.append(_certain(known, 0.0, rigidity_step))
    priors = [prior_of(each, study.reader) for each in certain]
    found = list[KnownForce | None]()
    for seen, force_n in frames:
        at, smoothing_m = (near, seen.lateral_m, seen.depth_m), study.calibration.surface_smoothing_m
        fit = fit_boundaries(*at, priors[0], smoothing_m, force_n)
        if fit is None or not _read(fit):
            found.append(None)
            continue
        # A fit of its own for each could end in another valley, and the slope would be that from one to the other.
        moved = (fit.unknown + prior.mean - priors[0].mean for prior in priors)
        beside = [fit_from(*at, prior, smoothing_m, unknown) for prior, unknown in zip(priors, moved, strict=True)]
        if not all(_read(each) for each in beside):
            found.append(None)
            continue
        here, stiffer, *rigid = beside
        low_n, high_n = here.interval_n
        slopes = [log(each.force_n / here.force_n) for each in (stiffer, *rigid)]
        found.append(
            KnownForce(
                force_n=force_n,
                library_n=here.force_n,
                sd_n=0.5 * (high_n - low_n) / NINETY_PERCENT,
                modulus_pa=known.modulus.mean_pa,
                rigidity=globe_of(known).mean,
                by_modulus=slopes[0] / modulus_step,
                by_rigidity=slopes[1] / rigidity_step if rigid else 0.0,
                loss=here.loss,
            )
        )
    return found


def _read(fit: BoundaryFit) -> bool:
    """Return whether a frame was read."""
    return fit.misfit_m <= NO_WALL_M and fit.force_n > 0.0


def _steps(known: Known) -> Array:
    """Return the steps of ln E and k over the reference's (2,) by which slopes are found."""
    assert known.modulus is not None  # its own
    globe = globe_of(known)
    share = RIGIDITY_STEP * max(globe.mean / REFERENCE_RIGIDITY, LEAST_RIGIDITY)
    return np.array([max(known.modulus.relative_sd, MODULUS_STEP), max(globe.sd / REFERENCE_RIGIDITY, share)])


def _certain(known: Known, log_modulus: float = 0.0, rigidity: float = 0.0) -> Known:
    """Return an eye whose E and k are certain, each a step off: of ln E, and of k over the reference's."""
    assert known.modulus is not None  # its own
    modulus = Modulus(mean_pa=known.modulus.mean_pa * exp(log_modulus), sd_pa=0.0, source=known.modulus.source)
    globe = globe_of(known)
    if globe.can_be_sealed:
        mean = globe.mean + rigidity * REFERENCE_RIGIDITY
        globe = replace(
            globe,
            mean=mean,
            sd=CERTAIN * globe.sd,
            lowest=min(globe.lowest, mean),
            highest=max(globe.highest, mean),
            correlation=0.0,
        )
    return replace(known, modulus=modulus, globe=globe, discrepancy=None)


def _moved(known: Known, found: Found) -> Known:
    """Return an eye with the E and k that were found, not too far from those that it was read with."""
    assert known.modulus is not None  # its own
    globe, mean, covariance = globe_of(known), found.mean, found.covariance
    if globe.can_be_sealed:  # where k would leave its bounds, E is that of a k on the bound
        bounds = (globe.lowest / REFERENCE_RIGIDITY, globe.highest / REFERENCE_RIGIDITY)
        mean = within_bounds(mean, covariance, OF_RIGIDITY, bounds)
        globe = replace(globe, mean=float(mean[OF_RIGIDITY]) * REFERENCE_RIGIDITY)
    farther = np.clip(mean[OF_MODULUS] - log(known.modulus.mean_pa), -LARGEST_STEP, LARGEST_STEP)
    modulus = replace(known.modulus, mean_pa=known.modulus.mean_pa * exp(farther))
    return replace(known, modulus=modulus, globe=known.globe if known.globe is None else globe)


def _with_discrepancy(known: Known, found: Found, forces_n: Sequence[float]) -> Known:
    """Return an eye at its E and k with their uncertainty, and the discrepancy given these.

    Args:
        known: of the eye.
        found: what its frames tell.
        forces_n: of these frames, N.
    """
    assert known.modulus is not None  # its own
    globe, covariance = globe_of(known), found.covariance
    sds = np.sqrt(np.diag(covariance))
    modulus = replace(known.modulus, sd_pa=float(sds[OF_MODULUS]) * known.modulus.mean_pa)
    if globe.can_be_sealed:
        globe = replace(
            globe,
            sd=float(sds[OF_RIGIDITY]) * REFERENCE_RIGIDITY,
            correlation=correlation_of(covariance, OF_MODULUS, OF_RIGIDITY),
        )
    given = covariance[2:, :2] @ np.linalg.inv(covariance[:2, :2])
    level, growth = (found.mean[2:] + given @ (place_of(known) - found.mean[:2])).tolist()
    left = covariance[2:, 2:] - given @ covariance[:2, 2:]
    level_sd, growth_sd = np.sqrt(np.diag(left)).tolist()
    rising_n = [0.0, *sorted(forces_n)]
    by = given * np.array([modulus.relative_sd, float(sds[OF_RIGIDITY])])
    discrepancy = ForceDiscrepancy(
        level=level,
        growth=growth,
        level_sd=level_sd,
        growth_sd=growth_sd,
        correlation=correlation_of(left, 0, 1),
        level_by=(float(by[0, 0]), float(by[0, 1])),
        growth_by=(float(by[1, 0]), float(by[1, 1])),
        scatter=found.scatter,
        largest_n=rising_n[-1] if forces_n else None,
        widest_gap=float(np.diff(rising_n).max() / rising_n[-1]) if forces_n else None,
    )
    return replace(known, modulus=modulus, globe=known.globe if known.globe is None else globe, discrepancy=discrepancy)
