"""The frames of a recording as a calibration sees them, moment by moment.

Of several planes, the fit to all of a moment (`fit.planes_of_a_moment`) shows where
each of them lies. The filter and the joint fit follow the plane that lies nearest to
the needle, at the place that the moment shows; the force of a moment is then read from
all its planes together (`stiffness_from_forces`). A moment counts once: its planes show
one dent of one wall.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import islice
from math import cos, sin

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import CalibrationError
from scleraforce.calibration.filter import eye_filter
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.calibration.relaxation_from_holds import with_elastic_forces
from scleraforce.calibration.start_of_an_eye import ForceFrame
from scleraforce.fit.one_frame import NO_WALL_M
from scleraforce.fit.planes_of_a_moment import PlanesFit, SeenPlane, fit_planes
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.fit.unknowns import GAP
from scleraforce.library import Library
from scleraforce.recordings.clock_offsets import MOST_FRAMES
from scleraforce.recordings.force_errors import FrameForces, frame_forces
from scleraforce.recordings.forces_under_frames import (
    Trial,
    label_frames,
    log_doubts,
)
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.frame import frame_digest
from scleraforce.records.needle import one_lean
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Plane
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation
from scleraforce.wall.wall_in_metres import (
    Boundaries,
    dent_measures,
    segmented_boundaries,
)

NO_WALL = "the library's walls do not lie on its boundaries"
LOOKED_AT = 5  # moments, of which the plane that is followed lies nearest to the needle


def count_nothing(_: int) -> None:
    """Count no steps."""


@dataclass(frozen=True)
class CalibrationSettings:
    """The arguments of `calibrate_recordings`; `parameters` are those found by one fit,
    without the stiffening; `count` is called with steps done.
    """

    study: Study
    library: Library | None
    parameters: tuple[str, ...]
    stiffening_sought: bool
    frames: int | None
    walls: FoundWalls
    count: Callable[[int], object] = count_nothing


@dataclass(frozen=True, eq=False)
class SeenFrame:
    """A frame's wall, or why it has none; of several planes, that of the followed one,
    and the fit to all.

    `sha256`: digest of its pixels. `files`: name and digest of each plane's frame.
    `place`: gap, m, direction from the scanner's x axis and tilt, rad, of that plane.
    """

    file: str
    sha256: str
    wall: Boundaries | eye_filter.SkippedFrame
    planes: PlanesFit | None = None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    files: tuple[tuple[str, str], ...] = ()

    def with_force(self, force_n: float, iop_pa: float | None) -> ForceFrame:
        """Return the frame with its known force, N, and the pressure at rest at its
        time, Pa, if that is not the eye's.
        """
        assert not isinstance(self.wall, eye_filter.SkippedFrame)
        return ForceFrame(
            wall=self.wall,
            force_n=force_n,
            planes=self.planes,
            gap_m=None if self.planes is None else self.place[0],
            iop_pa=iop_pa,
        )

    def beside(self, setup: Setup) -> Setup:
        """Return what is stated of an eye, at the place of the plane if there are
        several; the scan of `setup` is along the scanner's x axis.
        """
        if self.planes is None:
            return setup

        gap_m, turn_rad, tilt_rad = self.place
        turned = setup.turned(turn_rad)
        return replace(
            turned,
            needle=replace(turned.needle, gap_m=gap_m),
            scan=replace(turned.scan, tilt_rad=tilt_rad),
        )


class EyeFrames:
    """The moments of a recording of which no frame's digest is in `used`; each is
    segmented, fitted and labelled once.

    `recording` has the first frame of each moment. Forces are parts along the wall's
    normal, with a library elastic ones. `relaxation` is how the tissue relaxes, if that
    is known already.
    """

    def __init__(
        self,
        recording: Recording,
        settings: CalibrationSettings,
        used: frozenset[str],
        relaxation: Relaxation | None,
    ) -> None:
        self.moments = recording.moments
        self.settings = settings
        self.used = used
        self.relaxation = relaxation
        self.recording = recording

        if recording.info.scan.planes:
            self.recording = replace(
                recording, frames=tuple(first for first, *_ in self.moments)
            )

        self.seen = cache(self._seen)
        self.labelled = cache(self._labelled)
        self._look = cache(self._look_at)
        self._fitted = cache(self._fit)

    def _seen(self, index: int) -> SeenFrame | None:
        moment = self.moments[index]
        plane = self.followed
        if any(self._look(entry)[0] in self.used for entry in moment):
            return None

        entry = next(
            (entry for entry in moment if plane is None or entry.plane == plane.name),
            moment[0],
        )
        sha256, wall = self._look(entry)

        if plane is not None and entry.plane != plane.name:
            wall = eye_filter.SkippedFrame(
                f"not usable: no frame of plane {plane.name}"
            )

        seen = SeenFrame(entry.file, sha256, wall)
        if plane is None or isinstance(wall, eye_filter.SkippedFrame):
            return seen

        found = self._fitted(index)
        if isinstance(found, eye_filter.SkippedFrame):
            return replace(seen, wall=found)

        turn_rad = plane.direction_rad
        x_rad, y_rad = found.place.tilt_rad
        place = (
            gap_of(found, plane),
            turn_rad,
            cos(turn_rad) * y_rad - sin(turn_rad) * x_rad,
        )
        files = tuple((entry.file, self._look(entry)[0]) for entry in moment)

        return replace(seen, planes=found, place=place, files=files)

    @cached_property
    def dents(self) -> Floats:
        """Measures of the dent in the first frame of each moment (measure, moment), of
        many the evenly chosen ones; NaN: not seen, or not looked at.
        """
        count = len(self.moments)
        dents = np.full((2, count), np.nan)
        for index in np.linspace(0, count - 1, min(count, MOST_FRAMES)).astype(np.intp):
            _, wall = self._look(self.moments[index][0])
            if not isinstance(wall, eye_filter.SkippedFrame):
                dents[:, index] = dent_measures(wall.lateral_m, wall.depth_m[0])
        return dents

    @cached_property
    def log_remarks(self) -> tuple[Remark, ...]:
        """Remarks on a force log that does not fit the frames."""
        return log_doubts(self.recording, self.settings.study.classes, self.dents)

    @cached_property
    def followed(self) -> Plane | None:
        """The plane that lies nearest to the needle in the first moments that can be
        fitted; None of a single one.
        """
        planes = self.recording.info.scan.planes
        if not planes:
            return None

        each = (self._fitted(index) for index in range(len(self.moments)))
        fitted = list(
            islice((one for one in each if isinstance(one, PlanesFit)), LOOKED_AT)
        )

        return min(
            planes,
            key=lambda plane: np.median(
                [abs(gap_of(one, plane)) for one in fitted] or [0.0]
            ),
        )

    def _look_at(
        self, entry: FrameEntry
    ) -> tuple[str, Boundaries | eye_filter.SkippedFrame]:
        """Return the digest of a frame's pixels, and its wall."""
        pixels = self.recording.frame(entry)
        scale = self.recording.info.scan.scale
        found = self.settings.walls.of_frame(self.recording, entry, pixels)
        if not found.usable:
            return frame_digest(pixels), eye_filter.SkippedFrame(
                f"not usable: {found.reason}"
            )

        return frame_digest(pixels), segmented_boundaries(found, scale)

    def _fit(self, index: int) -> PlanesFit | eye_filter.SkippedFrame:
        """Fit the planes of a moment that show a wall together, beside the population's
        modulus.
        """
        info = self.recording.info
        study = self.settings.study
        library = self.settings.library
        assert library is not None  # `calibrate.check_planes_can_calibrate`
        known = replace(
            info.setup,
            eye=replace(
                info.setup.eye,
                modulus=study.calibration.prior(),
            ),
        )
        planes = list[SeenPlane]()

        for entry in self.moments[index]:
            _, wall = self._look(entry)
            plane = info.scan.named(entry.plane)
            if plane is not None and not isinstance(wall, eye_filter.SkippedFrame):
                turn_rad = plane.direction_rad
                prior = prior_of(
                    known.turned(turn_rad), study.reader, study.eye.radius_m
                )
                planes.append(
                    SeenPlane(
                        plane.offset_m, turn_rad, wall.lateral_m, wall.depth_m, prior
                    )
                )

        if len(planes) < 2:
            return eye_filter.SkippedFrame(
                "not usable: fewer than two planes show a wall"
            )

        near = library.for_stiffening(
            float(library.walls.stiffening[0])
        ).nearest_contact(known.needle.polar_rad)
        fits, place = fit_planes(near, planes, study.calibration.surface_smoothing_m)
        if place is None:
            return eye_filter.SkippedFrame(eye_filter.UNSEEN)

        found = PlanesFit(tuple(planes), fits, place)
        return (
            found
            if found.whole.misfit_m <= NO_WALL_M
            else eye_filter.SkippedFrame(NO_WALL)
        )

    @cached_property
    def along_normal(self) -> Recording:
        """The recording with the parts of its forces along the wall's normal."""
        log = self.recording.forces
        if log is None or self.recording.info.force is None:
            raise CalibrationError(
                f"{self.recording.path}: no forces.csv; a calibration needs frames of"
                " known force"
            )

        lean = cos(one_lean(self.recording.info.needle.lean_rad) or 0.0)
        log = replace(log, wrench_sc=log.wrench_sc * lean)
        return replace(self.recording, forces=log)

    @cached_property
    def without_gaps(self) -> Recording:
        """The same without the samples that have no force."""
        log = self.along_normal.forces
        info = self.recording.info.force
        assert log is not None
        assert info is not None
        return replace(self.recording, forces=log.known(info.axis))

    def decide(self, relaxation: Relaxation) -> None:
        """Label the frames by a relaxation that is known by now."""
        self.relaxation = relaxation
        self.labelled = cache(self._labelled)

    def _labelled(
        self,
    ) -> tuple[tuple[Trial, ...], FrameForces, Relaxation | None, Floats]:
        study = self.settings.study
        trials = label_frames(
            self.along_normal, study.classes, study.needle.max_force_n
        )
        recording = self.without_gaps
        forces = frame_forces(recording, trials)

        if self.settings.library is None:
            return trials, forces, None, np.empty(0)

        return trials, *with_elastic_forces(recording, forces, self.relaxation)


def gap_of(found: PlanesFit, plane: Plane) -> float:
    """Return the gap of a plane, m, with its sign; infinite if it is not in the fit."""
    there = (
        (seen.offset_m, seen.direction_rad) == (plane.offset_m, plane.direction_rad)
        for seen in found.planes
    )
    return next(
        (
            float(fit.unknown[GAP])
            for fit, is_it in zip(found.fits, there, strict=True)
            if is_it
        ),
        np.inf,
    )


def frame_order(
    force_n: Floats,
    included: Sequence[bool],
    min_force_n: float,
    frames: int | None,
) -> list[int]:
    """Return the frames in the order in which they are examined: of the included ones
    the wanted number, or all (None).

    All in their own order; if only some are wanted, the first few that show where the
    eye lies (up to `min_force_n`), then the frames of the highest force and of even
    shares of it, which tell modulus and rigidity apart, in rising order, then the
    others as substitutes.
    """
    if frames is None:
        return list(range(len(included)))

    light = [
        index
        for index, inside in enumerate(included)
        if inside and force_n[index] <= min_force_n
    ]
    left = [
        index
        for index, inside in enumerate(included)
        if inside and force_n[index] > min_force_n
    ]
    left.sort(key=lambda index: -force_n[index])

    chosen = list[int]()
    highest_n = force_n[left[0]] if left else 0.0

    for share in np.arange(frames, 0, -1) / frames:
        if left:
            nearest = min(
                left, key=lambda index: abs(force_n[index] - share * highest_n)
            )
            left.remove(nearest)
            chosen.append(nearest)

    return [*light[:frames], *reversed(chosen), *left]
