"""The kinds of models that read frames: the paper's classifier, the reader with its
library, the raw reader.
"""

import reprlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import zip_longest
from math import sqrt
from pathlib import Path
from typing import Any, ClassVar, Self, final

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types

from scleraforce.base.arrays import Bytes, Floats
from scleraforce.base.errors import ModelError
from scleraforce.base.onnx_network import check_interface, run_network
from scleraforce.base.units import from_si
from scleraforce.fit.one_frame import BoundaryFit, fit_boundaries
from scleraforce.fit.planes_of_a_moment import SeenPlane, fit_planes
from scleraforce.fit.prior_of_an_eye import Prior, prior_of
from scleraforce.fit.unknowns import GAP
from scleraforce.library.wall_responses import Library
from scleraforce.reading import frame_checks
from scleraforce.reading.answer import (
    METHODS,
    UNCHECKED,
    Answer,
    Reading,
    disagreement,
    fit_reading,
    joined_answers,
    not_below,
    unusable_answer,
)
from scleraforce.reading.force_network import ForceNetwork
from scleraforce.reading.interval_widths import (
    NO_FACTORS,
    IntervalFactors,
    frame_stretch,
)
from scleraforce.reading.needle_place import (
    contact_depth,
    in_space,
    places_of,
    shaft_lean,
)
from scleraforce.reading.trained_ranges import (
    CLASSIFIER,
    RAW_READER,
    READER,
    other_index,
    outside_training,
    untrained_values,
)
from scleraforce.records.frame import Pixels
from scleraforce.records.model_folder import (
    NETWORK_FILE,
    RECORD_FILE,
    Origin,
    model_name,
)
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale, Plane, Scan
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.records.study import Range, ReaderStudy, Study
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import Boundaries, segmented_boundaries
from scleraforce.wall.wall_network import FrameWindow, WallFinder

INPUT = "slices"
OUTPUT = "probabilities"
ReadingMethod = Callable[[frame_checks.SlicedFrame, Pixels, PixelScale, Setup], Answer]


@dataclass(eq=False, repr=False)
class Reader(ABC):
    """A trained model that reads raw frames. Made by `load_model`; its parts belong
    together.

    `path` is the folder, `study` the study of the training, `record` the content of
    `model.json`, `provenance` the metadata of `model.onnx` (hashes of study and data
    set, seed, versions, class bounds). `kind` is the folder's word for it
    ("classifier", "reader" or "raw-reader"), `classes` the number of force classes.
    `reads_force`: answers have a force with its interval, not the class alone.
    `serves_loop`: it may serve the control loop. The `finder` checks the wall of
    `read`, not of `read_live`: the control loop does not wait for it. `origin`: the
    folder that it was loaded from, from which a pickle loads it again.
    """

    kind: ClassVar[str]
    reads_force: ClassVar[bool] = True
    serves_loop: ClassVar[bool] = True
    _shifts: ClassVar[tuple[float, ...]] = (0.0,)
    _ends_at_thickness: ClassVar[bool] = False  # of slices, where it is known

    path: Path
    study: Study
    record: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    provenance: Mapping[str, str] = field(default_factory=dict, kw_only=True)
    finder: WallFinder | None = field(default=None, kw_only=True)
    origin: Origin | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        self.classes = len(self.study.classes.bounds_n) + 1
        self.name = model_name(self.path)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.path}>"

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return a copy that shares what does not change: networks and library."""
        return replace(self)

    @property
    def bounds_mn(self) -> list[float]:
        """Bounds of the force classes, mN."""
        return [from_si(bound_n, "mn") for bound_n in self.study.classes.bounds_n]

    @property
    def words(self) -> str:
        """Name, kind and class bounds, for people."""
        bounds = " and ".join(f"{bound_mn:g}" for bound_mn in self.bounds_mn)
        return f"{self.name} ({self.kind}), classes bounded at {bounds} mN"

    @property
    def fixed_modulus_pa(self) -> float | None:
        """Young's modulus that the model reads every eye with, a classifier's; None: it
        takes each eye's own.
        """
        return None if self.reads_force else self.study.eye.youngs_modulus_pa

    def read(
        self,
        frame: Pixels,
        scale: PixelScale,
        setup: Setup = NOTHING_KNOWN,
        wall: Segmentation | None = None,
    ) -> Answer:
        """Read one raw frame (row, column) by every method of the model.

        `scale` is the size of a pixel as stored, with the refractive index. With a
        fixed modulus the model uses the thickness alone of the eye. `wall`: in
        place of the one that is found. An invalid frame raises `ValueError` (see
        `find_wall`), a network that fails `ModelError`.
        """
        seen = frame_checks.segment_and_slice(
            frame,
            scale,
            self.study.slice,
            self._shifts,
            setup.eye.before_learning.thickness_m,
            self.finder,
            wall,
            ends_at_thickness=self._ends_at_thickness,
        )
        answer = self._careful(self._read, seen, frame, scale, setup)

        return self.signed(answer, seen.segmentation)

    def read_live(
        self, frame: Pixels, scale: PixelScale, setup: Setup = NOTHING_KNOWN
    ) -> Answer:
        """Read one raw frame within a millisecond or two, without the fit;
        `can_calibrate` stays False.

        Arguments and errors as for `read`.
        """
        seen = frame_checks.segment_and_slice(
            frame,
            scale,
            self.study.slice,
            self._shifts,
            setup.eye.before_learning.thickness_m,
            ends_at_thickness=self._ends_at_thickness,
        )
        answer = self._careful(self._live, seen, frame, scale, setup)

        return self.signed(answer, seen.segmentation)

    def _careful(
        self,
        method: ReadingMethod,
        seen: frame_checks.SlicedFrame,
        frame: Pixels,
        scale: PixelScale,
        setup: Setup,
    ) -> Answer:
        """Read a frame by a method; of an eye whose E was learned, with the eye before
        as well.

        The one place that keeps learning from lowering the upper end of an interval.
        """
        if seen.reason:
            return unusable_answer(self.classes, seen.reason)

        answer = method(seen, frame, scale, setup)
        if setup.eye.unlearned is None:
            return answer

        return not_below(
            answer, method(seen, frame, scale, replace(setup, eye=setup.eye.unlearned))
        )

    def signed(self, answer: Answer, wall: Segmentation | None = None) -> Answer:
        """Return an answer with the model's name and class bounds, and the wall that
        was read.
        """
        if answer.usable and wall is not None and not wall.inner_found:
            remark = frame_checks.surface_read(wall)
            answer = replace(answer, remarks=(*answer.remarks, remark))

        return replace(
            answer,
            segmentation=wall,
            model=self.name,
            class_bounds_n=self.study.classes.bounds_n,
        )

    def read_together(
        self,
        frames: Sequence[Pixels],
        scale: PixelScale,
        setup: Setup = NOTHING_KNOWN,
        planes: Sequence[Plane] = (),
        walls: Sequence[Segmentation | None] = (None,),
    ) -> tuple[Answer, ...]:
        """Read the frames of one moment, one of each plane, or a single frame without
        planes.

        Every frame gets the answer of all, with its own contact, fit and segmentation.
        `walls`: given ones, in place of those found. Errors are as for `read`; a model
        without a fit reads no planes and raises `ModelError`.
        """
        if planes:
            raise ModelError(
                f"{self.path}: a {self.kind} reads single planes; several need a model"
                f" of kind {READER!r}"
            )
        return (self.read(frames[0], scale, setup, walls[0]),)

    def outside(self, setup: Setup) -> str | None:
        """Return the known value outside the training, where a gap may be 0, in a
        sentence; None: all are inside.
        """
        study = self.study
        trained = frame_checks.read_by_fit(study.reader)
        return outside_training(setup, trained, study.library, study.eye.radius_m)

    def refusal(self, setup: Setup) -> str | None:
        """Return why the model cannot read an eye: a known value lies outside the
        training; None: it can.
        """
        return self.outside(setup)

    def steepest_n_m(self, setup: Setup) -> float | None:  # noqa: ARG002
        """Return the steepest rise of force with the dent, N/m, as far as the model
        knows: None.
        """
        return None

    def limits(
        self, setup: Setup, scan: Scan, gauge: int | None = None
    ) -> tuple[Remark, ...]:
        """Return a remark for each known value of an eye, its B-scans and its needle
        outside the training.
        """
        return untrained_values(self.kind, self.study, setup, scan, gauge)

    def _read(
        self,
        seen: frame_checks.SlicedFrame,
        frame: Pixels,
        scale: PixelScale,
        setup: Setup,
    ) -> Answer:
        """Return the answer of all methods, by default of the network alone, to a frame
        with a wall.
        """
        boundaries = segmented_boundaries(seen.segmentation, scale)
        return replace(
            self._live(seen, frame, scale, setup),
            can_calibrate=frame_checks.can_calibrate(seen, boundaries),
        )

    @abstractmethod
    def _live(
        self,
        seen: frame_checks.SlicedFrame,
        frame: Pixels,
        scale: PixelScale,
        setup: Setup,
    ) -> Answer:
        """Return the network's answer to a frame with a wall."""


@final
@dataclass(eq=False, repr=False)
class Classifier(Reader):
    """Reads the force class from slices.

    The same slices give the same answer: the session runs on the CPU with a fixed
    number of threads. It knows the modulus of its training only. A network of other
    inputs or outputs than its study's raises `ModelError`.
    """

    kind = CLASSIFIER
    reads_force = False

    session: onnxruntime.InferenceSession

    def __post_init__(self) -> None:
        super().__post_init__()
        inputs = {
            INPUT: ("tensor(uint8)", [self.study.slice.rows, self.study.slice.columns])
        }
        check_interface(
            self.session,
            inputs,
            {OUTPUT: ("tensor(float)", [self.classes])},
            str(self.path / NETWORK_FILE),
        )

    def probabilities(self, slices: Bytes) -> Floats:
        """Return the probability of each force class (slice, class); rows sum to 1.

        Slices are uint8 (slice, row, column) of the study's shape, 255 where wall is, 0
        elsewhere; others raise `ModelError`.
        """
        expected = (self.study.slice.rows, self.study.slice.columns)
        if slices.dtype != np.uint8 or slices.ndim != 3 or slices.shape[1:] != expected:
            raise ModelError(
                f"{self.path}: slices: found {slices.dtype} of shape {slices.shape},"
                f" this model reads uint8 of shape (n, {expected[0]}, {expected[1]})"
            )
        if np.any((slices != 0) & (slices != 255)):
            raise ModelError(
                f"{self.path}: slices: a value other than 0 (no wall) and 255 (wall)"
            )
        if not len(slices):
            return np.empty((0, self.classes))

        (answer,) = run_network(
            self.session,
            [OUTPUT],
            {INPUT: np.ascontiguousarray(slices)},
            str(self.path),
        )
        if answer.shape != (len(slices), self.classes):
            raise ModelError(
                f"{self.path}: the network answers {answer.shape} to {len(slices)}"
                " slices"
            )

        # float32 leaves the sum at 1 to some 1e-7; double makes it exact to the last
        # digits that are printed.
        result: Floats = answer.astype(np.float64)
        result /= result.sum(axis=1, keepdims=True)
        return result

    def refusal(self, setup: Setup) -> str | None:  # noqa: ARG002
        """Return None: a classifier reads every eye as its own."""
        return None

    def _live(
        self,
        seen: frame_checks.SlicedFrame,
        frame: Pixels,  # noqa: ARG002 - a reader's signature
        scale: PixelScale,  # noqa: ARG002 - a reader's signature
        setup: Setup,
    ) -> Answer:
        """Ask the network, unless a needle hides a part of the slice or the dent leaves
        it.

        The network met few dents that leave the window: it would take the rest for a
        wall without force, and read the most dangerous frames as the least. It was
        never trained on slices with a needle.
        """
        if seen.needle:
            return unusable_answer(self.classes, frame_checks.NEEDLE_SEEN)
        if reason := frame_checks.no_slice(seen, setup.eye.thickness_m):
            return unusable_answer(self.classes, reason)
        if seen.dent_leaves:
            return unusable_answer(
                self.classes, "the dent leaves the window of the slice"
            )

        probabilities = self.probabilities(seen.cuts[:1])[0]
        if not np.isfinite(probabilities).all():
            return unusable_answer(self.classes, "the network's answer is not a number")

        return Answer(
            predicted=int(probabilities.argmax()),
            probabilities=tuple(probabilities.tolist()),
            usable=True,
            reason=None,
        )


STEEP_M = 4e-3  # of the dents whose rise of force is looked at
STEEPER = 1.2  # reserve
CONTACTS = 32  # polar angles whose libraries are cached
# Shifts of the slices that the network reads of one frame, in rows; the first is the
# slice itself. A slice of black and white does not show where in its pixels a boundary
# lies; a reading of one jumps when a drifting eye crosses a row.
SHIFTS = (0.0, 0.5)
TOO_LITTLE = "too little of the wall is seen"


@final
@dataclass(frozen=True, eq=False)
class _FittedFrame:
    """A frame, its wall, what is known beside it, and the fit with its prior."""

    seen: frame_checks.SlicedFrame
    boundaries: Boundaries
    setup: Setup
    fit: BoundaryFit
    prior: Prior


@dataclass(eq=False, repr=False)
class ForceReader(Reader):
    """Reads force, interval and contact from a wall.

    `default` names the method whose reading is the answer, "network" or "fit"; the
    other one checks it. The `network` reads slices of a wall, 255 where wall is, 0
    elsewhere.
    """

    kind = READER
    _shifts = SHIFTS
    # Real walls end less sharply than drawn ones: from the inner boundary that is found
    # networks read them wrong by up to a third. At finite strain a wall keeps its
    # thickness; under linear mechanics, the classifier's, it does not.
    _ends_at_thickness = True

    network: ForceNetwork
    library: Library
    default: str
    factors: IntervalFactors = NO_FACTORS

    def __post_init__(self) -> None:
        if self.default not in METHODS:
            place = (
                f"{self.path / RECORD_FILE}: default: found"
                f" {reprlib.repr(self.default)}"
            )
            raise ModelError(f"{place}, expected {' or '.join(METHODS)}")

        super().__post_init__()
        library = self.library
        self._library_of = lru_cache(maxsize=CONTACTS)(
            lambda polar_rad, stiffening: library.for_stiffening(
                stiffening
            ).nearest_contact(polar_rad)
        )
        self._outside = lru_cache(maxsize=CONTACTS)(
            lambda known: outside_training(
                known, self.study.reader, self.study.library, self.study.eye.radius_m
            )
        )

    def refusal(self, setup: Setup) -> str | None:
        """Return why the network cannot read an eye: a known value lies outside the
        training; None: it can.
        """
        return self._outside(setup)

    def _unread_slices(
        self, seen: frame_checks.SlicedFrame, setup: Setup
    ) -> str | None:
        """Return why the network cannot read the slices of a frame, although the fit
        may; None if it can.
        """
        return (
            self.refusal(setup)
            or (frame_checks.NEEDLE_SEEN if seen.needle else None)
            or frame_checks.no_slice(seen, setup.eye.before_learning.thickness_m)
            or frame_checks.seen_by_network(seen.extent_m, self.study.slice)
        )

    def library_for(self, setup: Setup) -> Library:
        """Return the library of an eye's tissue at its contact, or at the middle of the
        study's angles if unknown.

        Angles beyond the library's count as its largest; tissue that it does not hold
        raises `InputError`.
        """
        return self._library_of(setup.needle.polar_rad, setup.eye.stiffening or 0.0)

    def steepest_n_m(self, setup: Setup) -> float | None:
        """Return the steepest rise of force with the dent of an open wall, N/m; None if
        the eye is not known.

        E is taken two standard deviations above its mean, and the rise a fifth steeper.
        """
        globe = setup.eye.globe
        modulus = setup.eye.modulus
        if (
            modulus is None
            or setup.eye.thickness_m is None
            or setup.eye.iop_pa is None
            or globe is None
            or globe.can_be_sealed
        ):
            return None

        library = self.library_for(setup)
        modulus_pa = modulus.mean_pa + 2.0 * modulus.sd_pa
        tip_m = library.tip_m[library.tip_m < STEEP_M]
        walls = (
            np.full(len(tip_m), setup.eye.thickness_m),
            np.full(len(tip_m), setup.eye.iop_pa / modulus_pa),
        )

        return (
            STEEPER
            * modulus_pa
            * float((np.diff(library.forces(*walls, tip_m)) / np.diff(tip_m)).max())
        )

    def _read(
        self,
        seen: frame_checks.SlicedFrame,
        frame: Pixels,  # noqa: ARG002 - a reader's signature
        scale: PixelScale,
        setup: Setup,
    ) -> Answer:
        """Return the answer of both methods."""
        boundaries = segmented_boundaries(seen.segmentation, scale)
        if reason := self._not_fitted(seen, boundaries, setup):
            return replace(
                unusable_answer(self.classes, reason),
                can_calibrate=frame_checks.can_calibrate(seen, boundaries),
            )

        prior = self._prior(seen, boundaries, setup, self.study.reader)
        smoothing_m = self.study.calibration.surface_smoothing_m

        fit = fit_boundaries(
            self.library_for(setup),
            boundaries.lateral_m,
            boundaries.depth_m,
            prior,
            smoothing_m,
        )
        if fit is None:
            return unusable_answer(self.classes, TOO_LITTLE)

        factor = self.factors.of_fit(setup, fit) * frame_stretch(
            seen.segmentation, setup, self.study.reader
        )
        return self._judged(_FittedFrame(seen, boundaries, setup, fit, prior), factor)

    def _not_fitted(
        self, seen: frame_checks.SlicedFrame, boundaries: Boundaries, setup: Setup
    ) -> str | None:
        """Return why a wall is not fitted, None if it is."""
        places = boundaries.lateral_m, boundaries.depth_m[0]
        return (
            self.outside(setup)
            or frame_checks.needle_elsewhere(
                seen.needle, setup, self.library.needle_radius_m
            )
            or frame_checks.too_little_wall(
                *places, self.study.slice, setup.eye.has_calibrated_modulus
            )
        )

    def _prior(
        self,
        seen: frame_checks.SlicedFrame,
        wall: Boundaries,
        setup: Setup,
        trained: ReaderStudy,
    ) -> Prior:
        if seen.needle:
            # for an unknown gap
            trained = replace(
                trained, gap_m=Range(min=0.0, max=self.library.needle_radius_m)
            )
        return replace(
            prior_of(setup, trained, self.study.eye.radius_m), wall_sd_m=wall.sd_m
        )

    def read_together(
        self,
        frames: Sequence[Pixels],
        scale: PixelScale,
        setup: Setup = NOTHING_KNOWN,
        planes: Sequence[Plane] = (),
        walls: Sequence[Segmentation | None] = (None,),
    ) -> tuple[Answer, ...]:
        """Read the frames of one moment, one of each plane, by one fit; the gap is not
        used.

        A plane without a wall is left out, with a remark. If the wall in one that is
        fitted is not that of an eye, or cannot be judged, none is usable.
        """
        if not planes:
            return super().read_together(frames, scale, setup, walls=walls)

        setup = replace(setup, needle=replace(setup.needle, gap_m=None))
        sliced_frames = [
            frame_checks.segment_and_slice(
                one,
                scale,
                self.study.slice,
                SHIFTS,
                setup.eye.thickness_m,
                self.finder,
                wall,
                ends_at_thickness=self._ends_at_thickness,
            )
            for one, wall in zip_longest(frames, walls)
        ]
        seen_walls = [
            None if seen.reason else segmented_boundaries(seen.segmentation, scale)
            for seen in sliced_frames
        ]
        each = list[tuple[Plane, frame_checks.SlicedFrame, Boundaries, Setup]]()
        left_out = dict[str, str]()

        for seen, wall, plane in zip(sliced_frames, seen_walls, planes, strict=True):
            here = setup.turned(plane.direction_rad)
            reason = seen.reason if wall is None else self._not_fitted(seen, wall, here)
            if wall is not None and reason is None:
                each.append((plane, seen, wall, here))
            else:
                left_out[plane.name] = f"plane {plane.name}: {reason}"

        found = (
            self._fitted_together(each)
            if each
            else [unusable_answer(self.classes, next(iter(left_out.values())))]
        )
        fault = next((one for one in found if not one.usable), None)
        # of no fit: one only
        of_plane = {
            plane.name: one for (plane, *_), one in zip(each, found, strict=False)
        }
        remarks = [
            Remark("plane-left-out", f"left out: {reason}", ("planes",))
            for reason in left_out.values()
        ]
        answers = list[Answer]()

        for plane, seen in zip(planes, sliced_frames, strict=True):
            shared = of_plane.get(plane.name) or replace(
                found[0], contact_m=None, fit=None, can_calibrate=False
            )
            if fault is not None:
                shared = replace(
                    unusable_answer(self.classes, fault.reason or ""), fit=shared.fit
                )

            shared = replace(
                shared,
                remarks=(*shared.remarks, *remarks) if shared.usable else (),
                left_out=left_out.get(plane.name),
            )
            answers.append(self.signed(shared, seen.segmentation))

        return tuple(answers)

    def _fitted_together(
        self, each: Sequence[tuple[Plane, frame_checks.SlicedFrame, Boundaries, Setup]]
    ) -> list[Answer]:
        """Return the answers of planes with a wall, by the fit to all of them; of one
        alone, by its own.
        """
        smoothing_m = self.study.calibration.surface_smoothing_m
        radius_m = self.library.needle_radius_m
        trained = self.study.reader
        library = self.library_for(each[0][3])
        priors = [
            self._prior(seen, wall, known, frame_checks.read_by_fit(trained))
            for _, seen, wall, known in each
        ]
        walls = [
            SeenPlane(
                plane.offset_m,
                plane.direction_rad,
                wall.lateral_m,
                wall.depth_m,
                prior,
                radius_m / sqrt(3.0) if seen.needle else None,
            )
            for (plane, seen, wall, _), prior in zip(each, priors, strict=True)
        ]

        fits, place = fit_planes(library, walls, smoothing_m)
        if not fits:
            return [unusable_answer(self.classes, TOO_LITTLE)]

        if place is not None:
            place = place.at_depth(*contact_depth(fits[0], priors[0], library))
            angles = [
                (plane.direction_rad, seen.needle.axis_rad)
                for (plane, seen, *_), fit in zip(each, fits, strict=True)
                if seen.needle
                and seen.needle.axis_rad is not None
                and shaft_lean(fit, seen.needle) is not None
            ]
            place = place.with_shafts(*zip(*angles, strict=True)) if angles else place

        gaps_m = [abs(float(fit.unknown[GAP])) for fit in fits]
        answers = list[Answer]()
        heres = [known for *_, known in each]

        if place is not None:
            heres = [
                replace(known, needle=replace(known.needle, gap_m=gap_m))
                for known, gap_m in zip(heres, gaps_m, strict=True)
            ]

        sections = [seen.segmentation for _, seen, *_ in each]
        stretch = min(
            frame_stretch(*pair, trained) for pair in zip(sections, heres, strict=True)
        )
        factor = stretch * max(map(self.factors.of_fit, heres, fits))

        for (plane, seen, wall, _), here, fit, prior in zip(
            each, heres, fits, priors, strict=True
        ):
            nearest = abs(float(fit.unknown[GAP])) == min(gaps_m)
            frame = _FittedFrame(seen, wall, here, fit, prior)
            answer = self._judged(frame, factor, METHODS[1], nearest)
            reason = None if answer.usable else f"plane {plane.name}: {answer.reason}"
            where = answer.places if place is None else in_space(answer.places, place)
            answers.append(replace(answer, place=place, places=where, reason=reason))

        return joined_answers(answers)

    def _live(
        self,
        seen: frame_checks.SlicedFrame,
        frame: Pixels,  # noqa: ARG002 - a reader's signature
        scale: PixelScale,  # noqa: ARG002 - a reader's signature
        setup: Setup,
    ) -> Answer:
        if reason := self._unread_slices(seen, setup):
            return unusable_answer(self.classes, reason)
        return frame_checks.judged_answer(
            self.network.read(seen.cuts, setup), "network", seen.dent_leaves, self.study
        )

    def _judged(
        self,
        frame: _FittedFrame,
        factor: float,
        default: str | None = None,
        may_rest: bool = True,
    ) -> Answer:
        """Read a frame from its fit, if that is the wall of an eye; `default`: the
        method that answers.

        `factor`: of the fit's interval; `may_rest`: a surface without a dent is tried.
        """
        seen = frame.seen
        boundaries = frame.boundaries
        known = frame.setup
        fit = frame.fit
        prior = frame.prior
        if reason := frame_checks.no_wall_of_an_eye(fit, prior):
            return replace(unusable_answer(self.classes, reason), fit=fit)

        by_fit = fit_reading(fit, self.study.classes.bounds_n, factor)
        leaves = seen.dent_leaves or frame_checks.fit_leaves(fit, self.study.slice)

        if unread := self._unread_slices(seen, known):
            answer = frame_checks.judged_answer(by_fit, "fit", leaves, self.study)
            unchecked = Remark("fit-unchecked", f"{UNCHECKED}: {unread}")
            answer = replace(
                answer,
                remarks=(unchecked,) if answer.usable else (),
                readings=(("fit", by_fit),),
            )
        else:
            answer = self._checked(
                {"network": self.network.read(seen.cuts, known), "fit": by_fit},
                leaves,
                default,
            )

        if may_rest and not seen.dent_leaves:
            # an eye at rest does not leave the frame in its middle
            answer = frame_checks.unless_at_rest(answer, fit, boundaries, self.study)

        if answer.usable:
            beside = fit.unknown.copy()
            beside[GAP] = abs(beside[GAP])
            library = self.library_for(known)
            there = replace(fit, unknown=beside)
            answer = replace(
                answer, places=places_of(there, prior, library, known, seen.needle)
            )

        return replace(
            answer,
            can_calibrate=frame_checks.can_calibrate(seen, boundaries, fit.contact_m),
            fit=fit,
        )

    def _checked(
        self, readings: Mapping[str, Reading], leaves: bool, default: str | None = None
    ) -> Answer:
        """Return the answer of a method, by default the model's, checked by the other
        one; `leaves`: the dent does.

        If both differ by more than their intervals allow, one of them is wrong, and
        nothing shows which: the interval then spans both. A frame whose interval
        reaches into every class is not usable.
        """
        name = default or self.default
        check = METHODS[1 - METHODS.index(name)]
        answering = readings[name]
        other = readings[check]
        warning = disagreement(answering, other, (name, check))
        reading = answering.spanning(other) if warning else answering
        answer = frame_checks.judged_answer(reading, name, leaves, self.study)
        undecided = (
            frame_checks.no_class(reading.interval_n, self.study.classes.bounds_n)
            if warning
            else None
        )

        reason = frame_checks.contact_outside(other, self.study.reader) or (
            undecided and f"{warning}; {undecided}"
        )
        if answer.usable and reason:
            answer = unusable_answer(self.classes, reason)

        answer = replace(answer, readings=tuple(readings.items()))
        if warning is None or not answer.usable:
            return answer
        return replace(answer, remarks=(Remark("methods-disagree", warning),))


@final
@dataclass(eq=False, repr=False)
class RawReader(Reader):
    """Reads force, interval and contact from a raw frame.

    The frame is segmented as for every model: that shows if there is the wall of an eye
    at all, if the dent leaves the window, and a needle or a conjunctiva. The force is
    the network's, which sees the frame itself. Nothing checks it.
    """

    kind = RAW_READER
    serves_loop = False  # its own second opinion would be that of the same network

    network: ForceNetwork

    def __post_init__(self) -> None:
        super().__post_init__()
        self._window = FrameWindow.of(self.study.raw_reader)

    def _live(
        self,
        seen: frame_checks.SlicedFrame,
        frame: Pixels,
        scale: PixelScale,
        setup: Setup,
    ) -> Answer:
        reason = (
            other_index(self.study, scale.refractive_index)
            or self.refusal(setup)
            or frame_checks.needle_elsewhere(
                seen.needle, setup, self.study.needle.outer_diameter_m / 2
            )
            or frame_checks.seen_by_network(seen.extent_m, self.study.slice)
        )
        if reason:
            return unusable_answer(self.classes, reason)

        reading = self.network.read(self._window.reduced(frame, scale)[None], setup)
        answer = frame_checks.judged_answer(
            reading, "network", seen.dent_leaves, self.study
        )

        return replace(answer, readings=(("network", reading),))
