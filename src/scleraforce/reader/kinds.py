"""The kinds of models that answer to frames: the paper's classifier, the reader with its library, the raw reader."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol, final

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.errors import ModelError
from scleraforce.fitting.library_fit import BoundaryFit, fit_boundaries
from scleraforce.fitting.prior import prior_of
from scleraforce.known.eye import NOTHING_KNOWN, Known
from scleraforce.library.responses import Library
from scleraforce.models.folder import NETWORK_FILE, STUDY_FILE
from scleraforce.models.session import run_network
from scleraforce.reader.answer import (
    METHODS,
    Answer,
    LiveReading,
    Reading,
    disagreement,
    fit_reading,
    spanned_interval,
    unusable,
)
from scleraforce.reader.intervals import NO_FACTORS, IntervalFactors, frame_stretch
from scleraforce.reader.limits import other_index, outside_training, raw_limits, slice_limits, wall_limits
from scleraforce.reader.networks import OnnxRawNetwork
from scleraforce.reader.verdicts import (
    NEEDLE_SEEN,
    Look,
    can_calibrate,
    contact_outside,
    crossed_by_needle,
    dent_leaves,
    fit_leaves,
    judged_answer,
    look,
    needle_elsewhere,
    no_class,
    no_wall_of_an_eye,
    read_by_fit,
    too_little_wall,
)
from scleraforce.recording.folder import OctInfo
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.needle import SeenNeedle
from scleraforce.segmentation.observations import Boundaries, segmented_boundaries, surface
from scleraforce.segmentation.reduced import FrameWindow
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import Study

INPUT, OUTPUT = "slices", "probabilities"


@final
class Classifier:
    """Reads the force class from slices; see `Reader`. Made by `load_model`; all of it belongs together.

    The same slices give the same answer: the session runs on the CPU with a fixed number of threads. It knows the
    modulus of its training only, and of what is known of an eye takes notice of the thickness alone (see `look`).

    Raises:
        ModelError: the network has other inputs or outputs than its study asks for.
    """

    kind = "classifier"
    reads_force = False
    serves_loop = True

    def __init__(
        self,
        path: Path,
        study: Study,
        record: Mapping[str, Any],
        session: onnxruntime.InferenceSession,
        finder: WallFinder | None = None,
    ) -> None:
        self.path = path
        self.study = study
        self.record = record
        self._session = session
        self._finder = finder
        self._check()

    @property
    def classes(self) -> int:
        """Number of force classes."""
        return len(self.study.classes.bounds_n) + 1

    @property
    def fixed_modulus_pa(self) -> float:
        """Young's modulus that it was trained for, and reads every eye with."""
        return self.study.eye.youngs_modulus_pa

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making: hashes of study and data set, seed, versions, class bounds."""
        metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        return metadata

    def read(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> Answer:
        """Read one raw frame; see `Reader.read`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m, finder=self._finder)
        answer = self._seen(seen)
        if seen.reason:
            return answer
        return replace(answer, can_calibrate=can_calibrate(seen, segmented_boundaries(seen.segmentation, scale)))

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame in the control loop; see `Reader.read_live`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m)
        return LiveReading(self._seen(seen), seen.segmentation.outer_row, seen.segmentation.inner_row)

    def refusal(self, known: Known) -> None:
        """Return None: it reads every eye as the one that it was trained for."""

    def limits(self, known: Known, scan: OctInfo, gauge: int | None = None) -> tuple[str, ...]:
        """Return where an eye and its B-scans lie outside the training; see `Reader.limits`."""
        return slice_limits(self.study, known, scan, gauge)

    def probabilities(self, slices: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return the probability of each force class.

        Args:
            slices: uint8, shape (slice, row, column) of the study; 255 where wall is, 0 elsewhere.

        Returns:
            Shape (slice, class); rows sum to 1.

        Raises:
            ModelError: another shape or type, or values other than 0 and 255.
        """
        expected = (self.study.slice.rows, self.study.slice.columns)
        if slices.dtype != np.uint8 or slices.ndim != 3 or slices.shape[1:] != expected:
            raise ModelError(
                f"{self.path}: slices: found {slices.dtype} of shape {slices.shape}, this model reads uint8 of shape "
                f"(n, {expected[0]}, {expected[1]})"
            )
        if np.any((slices != 0) & (slices != 255)):
            raise ModelError(f"{self.path}: slices: a value other than 0 (no wall) and 255 (wall)")
        if not len(slices):
            return np.empty((0, self.classes))
        (answer,) = run_network(self._session, [OUTPUT], {INPUT: np.ascontiguousarray(slices)}, str(self.path))
        if answer.shape != (len(slices), self.classes):
            raise ModelError(f"{self.path}: the network answers {answer.shape} to {len(slices)} slices")
        # float32 leaves the sum at 1 to some 1e-7; double makes it exact to the last digits that are printed.
        result: NDArray[np.float64] = answer.astype(np.float64)
        result /= result.sum(axis=1, keepdims=True)

        return result

    def _seen(self, seen: Look) -> Answer:
        """Return the answer to what is seen in a frame; a slice that a needle hides in part was never trained on."""
        reason = seen.reason or (NEEDLE_SEEN if seen.needle else None)
        answer = unusable(self.classes, reason) if reason else self._answer(seen.cut)
        return seen.told(answer)

    def _answer(self, cut: NDArray[np.uint8]) -> Answer:
        """Ask the network.

        One that met few dents leaving the window takes what is left for a wall without force: the most dangerous
        frames would be read as the least. They are withdrawn from instead.
        """
        if dent_leaves(cut):
            return unusable(self.classes, "the dent leaves the window of the slice")
        probabilities = self.probabilities(cut[np.newaxis])[0]
        if not np.isfinite(probabilities).all():
            return unusable(self.classes, "the network's answer is no number")
        return Answer(
            predicted=int(probabilities.argmax()), probabilities=tuple(probabilities.tolist()), usable=True, reason=None
        )

    def _check(self) -> None:
        """Check that network and study fit each other."""
        place, rows, columns = self.path / NETWORK_FILE, self.study.slice.rows, self.study.slice.columns
        inputs = {item.name: (item.type, item.shape[1:]) for item in self._session.get_inputs()}
        outputs = {item.name: (item.type, item.shape[1:]) for item in self._session.get_outputs()}
        if inputs != {INPUT: ("tensor(uint8)", [rows, columns])}:
            raise ModelError(
                f"{place}: input: found {inputs}, {STUDY_FILE} asks for {rows} x {columns} uint8 '{INPUT}'"
            )
        if outputs != {OUTPUT: ("tensor(float)", [self.classes])}:
            raise ModelError(f"{place}: output: found {outputs}, expected {self.classes} floats '{OUTPUT}'")


CONTACTS = 32  # polar angles whose libraries are kept
# Of the slices that the network reads of one frame, in rows: the first is the slice itself. A slice of black and white
# says nothing of where in its pixels a boundary lies; a reading of one jumps when a drifting eye crosses a row.
SHIFTS = (0.0, 0.5)


class SliceNetwork(Protocol):
    """What reads slices: see `ForceReader.read_slices`."""

    @property
    def provenance(self) -> Mapping[str, str]: ...  # noqa: D102 - described by the class
    def read(self, cuts: NDArray[np.uint8], known: Known) -> Reading: ...  # noqa: D102


@final
class ForceReader:
    """Reads force, interval and contact from a wall; see `Reader`. Made by `load_model`; all of it belongs together.

    `default` names the method whose reading is the answer, "network" or "fit"; the other one checks it. The wall
    finder checks the wall of `read`, not of `read_live`, whose loop does not wait for it.
    """

    kind = "reader"
    reads_force = True
    serves_loop = True
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
        finder: WallFinder | None = None,
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
        self._finder = finder
        self._library_of = lru_cache(maxsize=CONTACTS)(self._found_library)

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
        seen = look(frame, scale, self.study.slice, SHIFTS, known.thickness_m, self._finder)
        return seen.told(self._read(seen, scale, known))

    def _read(self, seen: Look, scale: PixelScale, known: Known) -> Answer:
        """Return the answer of both methods to what is seen in a frame."""
        if seen.reason:
            return unusable(self.classes, seen.reason)
        boundaries = segmented_boundaries(seen.segmentation, scale)
        reason = outside_training(known, read_by_fit(self.study.reader), self.study.library)
        reason = reason or needle_elsewhere(seen.needle, known, self.library.needle_radius_m)
        if reason:
            return replace(unusable(self.classes, reason), can_calibrate=can_calibrate(seen, boundaries))
        reason = too_little_wall(boundaries.lateral_m, boundaries.depth_m[0], self.study.slice)
        if reason:
            return unusable(self.classes, reason)
        return self._fitted(seen, boundaries, known)

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame with the network alone; see `Reader.read_live`."""
        seen = look(frame, scale, self.study.slice, SHIFTS, known.thickness_m)
        return LiveReading(
            seen.told(self._live(seen, scale, known)), seen.segmentation.outer_row, seen.segmentation.inner_row
        )

    def refusal(self, known: Known) -> str | None:
        """Return why the network cannot read an eye: what is known lies outside the training; None: inside."""
        return outside_training(known, self.study.reader, self.study.library)

    def unread_slices(self, needle: SeenNeedle | None, known: Known) -> str | None:
        """Return why the network cannot read slices of a frame, which the fit may read; None where it can."""
        return self.refusal(known) or (NEEDLE_SEEN if needle else None)

    def limits(self, known: Known, scan: OctInfo, gauge: int | None = None) -> tuple[str, ...]:
        """Return where an eye and its B-scans lie outside the training; see `Reader.limits`."""
        return wall_limits(self.study, known, scan, gauge)

    def library_for(self, known: Known) -> Library:
        """Return the library of an eye's tissue at its contact; where that is not known, in the middle of the study's.

        Angles beyond the library's count as its largest.

        Raises:
            InputError: the library does not hold such tissue.
        """
        return self._library_of(known.polar_rad, known.stiffening or 0.0)

    def read_slices(self, cuts: NDArray[np.uint8], known: Known) -> Reading:
        """Return what the network reads.

        Args:
            cuts: slices of one wall, of the study's size (slice, row, column), 255 where wall is, 0 elsewhere.
            known: of the eye.
        """
        return self._network.read(cuts, known)

    def _found_library(self, polar_rad: float | None, stiffening: float) -> Library:
        return self.library.for_stiffening(stiffening).nearest_contact(polar_rad)

    def _live(self, seen: Look, scale: PixelScale, known: Known) -> Answer:
        """Return the network's answer, with every verdict that needs no fit."""
        if seen.reason:
            return unusable(self.classes, seen.reason)
        reason = self.unread_slices(seen.needle, known) or too_little_wall(
            *surface(seen.segmentation, scale), self.study.slice
        )
        if reason:
            return unusable(self.classes, reason)
        return judged_answer(self.read_slices(seen.cuts, known), "network", dent_leaves(seen.cut), self.study)

    def _fitted(self, seen: Look, boundaries: Boundaries, known: Known) -> Answer:
        """Lay a wall of the library on the frame, and read it where that is the wall of an eye."""
        library = self.library_for(known)
        trained = crossed_by_needle(self.study.reader, library.needle_radius_m) if seen.needle else self.study.reader
        prior = prior_of(known, trained)
        smoothing_m = self.study.calibration.surface_smoothing_m
        fit = fit_boundaries(library, boundaries.lateral_m, boundaries.depth_m, prior, smoothing_m)
        if fit is None:
            return unusable(self.classes, "too little of the wall is seen")
        reason = no_wall_of_an_eye(fit, prior)
        if reason:
            return replace(unusable(self.classes, reason), fit=fit)
        factor = self.factors.of_fit(known, fit) * frame_stretch(seen.segmentation, known, self.study.reader)
        by_fit = fit_reading(fit, self.study.classes.bounds_n, factor)
        unread = self.unread_slices(seen.needle, known)
        if unread:
            answer = self._unchecked(seen, fit, by_fit, unread)
        else:
            answer = self._checked(seen, fit, {"network": self.read_slices(seen.cuts, known), "fit": by_fit})
        return replace(answer, can_calibrate=can_calibrate(seen, boundaries, fit.contact_m), fit=fit)

    def _unchecked(self, seen: Look, fit: BoundaryFit, reading: Reading, unread: str) -> Answer:
        """Return the fit's answer to a frame that the network cannot read."""
        leaves = dent_leaves(seen.cut) or fit_leaves(fit, self.study.slice)
        answer = judged_answer(reading, "fit", leaves, self.study)
        warnings = (f"the fit alone reads it, and nothing checks that: {unread}",) if answer.usable else ()
        return replace(answer, warnings=warnings, readings=(("fit", reading),))

    def _checked(self, seen: Look, fit: BoundaryFit, readings: Mapping[str, Reading]) -> Answer:
        """Return the answer of the model's default method, checked by the other one.

        Where both are more apart than their intervals allow, one of them is wrong, and nothing says which: the interval
        then spans those of both. One that reaches into every class is no answer.
        """
        default, other = readings[self.default], readings[self.other]
        warning = disagreement(default, other, (self.default, self.other))
        reading = replace(default, interval_n=spanned_interval(default, other)) if warning else default
        leaves = dent_leaves(seen.cut) or fit_leaves(fit, self.study.slice)
        answer = judged_answer(reading, self.default, leaves, self.study)
        untold = no_class(reading.interval_n, self.study.classes.bounds_n) if warning else None
        reason = contact_outside(other, self.study.reader) or (untold and f"{warning}; {untold}")
        if answer.usable and reason:
            answer = unusable(self.classes, reason)
        warnings = (warning,) if warning and answer.usable else ()
        return replace(answer, warnings=warnings, readings=tuple(readings.items()))


@final
class RawReader:
    """Reads force, interval and contact from a raw frame; see `Reader`. Made by `load_model`.

    The frame is segmented as for every model: that says whether it shows the wall of an eye at all, whether the dent
    leaves the window and what else is seen. The force is the network's, which sees the frame itself. Nothing checks it.
    """

    kind = "raw-reader"
    reads_force = True
    serves_loop = False  # its own second opinion would be that of the same network
    fixed_modulus_pa = None

    def __init__(
        self,
        path: Path,
        study: Study,
        record: Mapping[str, Any],
        network: OnnxRawNetwork,
        finder: WallFinder | None = None,
    ) -> None:
        self.path = path
        self.study = study
        self.record = record
        self._network = network
        self._finder = finder
        self._window = FrameWindow.of(study.raw_reader)

    @property
    def classes(self) -> int:
        """Number of force classes."""
        return len(self.study.classes.bounds_n) + 1

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making."""
        return self._network.provenance

    def read(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> Answer:
        """Read one raw frame; see `Reader.read`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m, finder=self._finder)
        answer = seen.told(self._read(seen, frame, scale, known))
        if seen.reason:
            return answer
        return replace(answer, can_calibrate=can_calibrate(seen, segmented_boundaries(seen.segmentation, scale)))

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame in the control loop; see `Reader.read_live`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m)
        answer = seen.told(self._read(seen, frame, scale, known))
        return LiveReading(answer, seen.segmentation.outer_row, seen.segmentation.inner_row)

    def refusal(self, known: Known) -> str | None:
        """Return why the model cannot read an eye; see `Reader.refusal`."""
        return outside_training(known, read_by_fit(self.study.reader), self.study.library)

    def limits(self, known: Known, scan: OctInfo, gauge: int | None = None) -> tuple[str, ...]:
        """Return where an eye and its B-scans lie outside the training; see `Reader.limits`."""
        return raw_limits(self.study, known, scan, gauge)

    def _read(self, seen: Look, frame: Pixels, scale: PixelScale, known: Known) -> Answer:
        """Return the answer to a frame in which a wall was seen, or why there is none."""
        reason = (
            seen.reason
            or other_index(self.study, scale.refractive_index)
            or self.refusal(known)
            or needle_elsewhere(seen.needle, known, self.study.needle.outer_diameter_m / 2)
            or too_little_wall(*surface(seen.segmentation, scale), self.study.slice)
        )
        if reason:
            return unusable(self.classes, reason)
        reading = self._network.read(self._window.reduced(frame, scale), known)
        answer = judged_answer(reading, "network", dent_leaves(seen.cut), self.study)
        return replace(answer, readings=(("network", reading),))
