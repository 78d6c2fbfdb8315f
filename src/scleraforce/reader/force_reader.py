"""A model of kind "reader": a network that reads the force from a slice, and the response library for the fit."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.library_fit import BoundaryFit, fit_boundaries
from scleraforce.fitting.prior import prior_of
from scleraforce.known.eye import NOTHING_KNOWN, Known, outside_training
from scleraforce.library.responses import Library
from scleraforce.reader.answers import Answer, LiveReading, unusable
from scleraforce.reader.interval_factors import NO_FACTORS, IntervalFactors
from scleraforce.reader.limits import wall_limits
from scleraforce.reader.look import Look, can_calibrate, look
from scleraforce.reader.readings import METHODS, Reading, disagreement, fit_reading
from scleraforce.reader.verdicts import contact_outside, dent_leaves, fit_leaves, no_wall_of_an_eye, too_little_wall
from scleraforce.recording.info import OctInfo
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.observations import Boundaries
from scleraforce.segmentation.observed import segmented_boundaries, surface
from scleraforce.study import Study
from scleraforce.units import from_si

__all__ = ["SHIFTS", "WIDEST_N", "ForceReader", "SliceNetwork"]

CONTACTS = 32  # polar angles whose libraries are kept
# Of the slices that the network reads of one frame, in rows: the first is the slice itself. A slice of black and white
# says nothing of where in its pixels a boundary lies; a reading of one jumps when a drifting eye crosses a row.
SHIFTS = (0.0, 0.5)
WIDEST_N = 6e-3  # of the interval of a dent that leaves the window: what its flanks tell must be as sure as this


class SliceNetwork(Protocol):
    """What reads slices: see `ForceReader.read_slices`."""

    @property
    def provenance(self) -> Mapping[str, str]: ...  # noqa: D102 - described by the class
    def read(self, cuts: NDArray[np.uint8], known: Known) -> Reading: ...  # noqa: D102


@final
class ForceReader:
    """Reads force, interval and contact from a wall; see `Reader`. Made by `load_model`; all of it belongs together.

    `default` names the method whose reading is the answer, "network" or "fit"; the other one checks it.
    """

    kind = "reader"
    reads_force = True
    fixed_modulus_pa = None

    def __init__(
        self,
        path: Path,
        study: Study,
        record: Mapping[str, Any],
        network: SliceNetwork,
        library: Library,
        default: str,
        factors: IntervalFactors = NO_FACTORS,
    ) -> None:
        if default not in METHODS:
            raise ValueError(f"default: found {default!r}, expected {' or '.join(METHODS)}")
        self.path = path
        self.study = study
        self.record = record
        self.library = library
        self.default = default
        self.factors = factors
        self._network = network
        self._library_of = lru_cache(maxsize=CONTACTS)(library.nearest_contact)

    @property
    def classes(self) -> int:
        """Number of force classes."""
        return len(self.study.classes.bounds_n) + 1

    @property
    def other(self) -> str:
        """The method that checks the default."""
        return METHODS[1 - METHODS.index(self.default)]

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making."""
        return self._network.provenance

    def read(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> Answer:
        """Read one raw frame with the network and the fit; see `Reader.read`."""
        seen = look(frame, scale, self.study.slice, SHIFTS)
        if seen.reason:
            return unusable(self.classes, seen.reason)
        boundaries = segmented_boundaries(seen.segmentation, scale)
        reason = self.refusal(known)
        if reason:
            return replace(unusable(self.classes, reason), can_calibrate=can_calibrate(seen, boundaries))
        reason = too_little_wall(boundaries.lateral_m, boundaries.depth_m[0], self.study.slice)
        if reason:
            return unusable(self.classes, reason)
        return self._fitted(seen, boundaries, known)

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame with the network alone; see `Reader.read_live`."""
        seen = look(frame, scale, self.study.slice, SHIFTS)
        return LiveReading(self._live(seen, scale, known), seen.segmentation.outer_row, seen.segmentation.inner_row)

    def refusal(self, known: Known) -> str | None:
        """Return why an eye cannot be read: what is known of it lies outside the training; None: inside."""
        return outside_training(known, self.study.reader)

    def limits(self, known: Known, scan: OctInfo) -> tuple[str, ...]:
        """Return where an eye and its B-scans lie outside the training; see `Reader.limits`."""
        return wall_limits(self.study, known, scan)

    def library_at(self, polar_rad: float | None) -> Library:
        """Return the library for a contact's polar angle; that in the middle of the study's where it is not known.

        Angles beyond the library's count as its largest.
        """
        return self._library_of(polar_rad)

    def read_slices(self, cuts: NDArray[np.uint8], known: Known) -> Reading:
        """Return what the network reads.

        Args:
            cuts: slices of one wall, of the study's size (slice, row, column), 255 where wall is, 0 elsewhere.
            known: of the eye.
        """
        return self._network.read(cuts, known)

    def _live(self, seen: Look, scale: PixelScale, known: Known) -> Answer:
        """Return the network's answer, with every verdict that needs no fit."""
        if seen.reason:
            return unusable(self.classes, seen.reason)
        reason = self.refusal(known) or too_little_wall(*surface(seen.segmentation, scale), self.study.slice)
        if reason:
            return unusable(self.classes, reason)
        return self._answer(self.read_slices(seen.cuts, known), "network", dent_leaves(seen.cut))

    def _fitted(self, seen: Look, boundaries: Boundaries, known: Known) -> Answer:
        """Lay a wall of the library on the frame, and read it where that is the wall of an eye."""
        prior, library = prior_of(known, self.study.reader), self.library_at(known.polar_rad)
        smoothing_m = self.study.calibration.surface_smoothing_m
        fit = fit_boundaries(library, boundaries.lateral_m, boundaries.depth_m, prior, smoothing_m)
        if fit is None:
            return unusable(self.classes, "too little of the wall is seen")
        reason = no_wall_of_an_eye(fit, prior)
        if reason:
            return replace(unusable(self.classes, reason), fit=fit)
        by_fit = fit_reading(fit, self.study.classes.bounds_n, self.factors.of_fit(known, fit))
        answer = self._checked(seen, fit, {"network": self.read_slices(seen.cuts, known), "fit": by_fit})
        return replace(answer, can_calibrate=can_calibrate(seen, boundaries, fit.contact_m), fit=fit)

    def _checked(self, seen: Look, fit: BoundaryFit, readings: Mapping[str, Reading]) -> Answer:
        """Return the answer of the model's default method, checked by the other one."""
        default, other = readings[self.default], readings[self.other]
        leaves = dent_leaves(seen.cut) or fit_leaves(fit, self.study.slice)
        answer = self._answer(default, self.default, leaves)
        elsewhere = contact_outside(other, self.study.reader)
        if answer.usable and elsewhere:
            answer = unusable(self.classes, elsewhere)
        warning = disagreement(default, other, (self.default, self.other)) if answer.usable else None
        return replace(answer, warnings=(warning,) if warning else (), readings=tuple(readings.items()))

    def _answer(self, reading: Reading, name: str, leaves: bool) -> Answer:
        """Return the answer that one method gives.

        Args:
            reading: of the method.
            name: of the method.
            leaves: whether the dent leaves the window.
        """
        if not reading.finite:
            return unusable(self.classes, f"what the {name} reads is no number")
        reason = contact_outside(reading, self.study.reader)
        if reason:
            return unusable(self.classes, reason)
        if leaves and not reading.width_n < WIDEST_N:
            return unusable(
                self.classes,
                "the dent leaves the window of the slice, and its flanks leave the force open by "
                f"{from_si(reading.width_n, 'mn'):.0f} mN",
            )
        return Answer(
            predicted=reading.predicted,
            probabilities=reading.probabilities,
            usable=True,
            reason=None,
            force_n=reading.force_n,
            interval_n=reading.interval_n,
            contact_m=reading.contact_m,
        )
