"""One virtual eye of the figures: all that is drawn of it. `figures.groups` draws
them.
"""

from dataclasses import dataclass, replace
from math import atan, cos
from pathlib import Path

from scleraforce.lab.virtual_eye import eye_name
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, fixed


@dataclass(frozen=True)
class Lean:
    """A needle that leans on its way to the wall.

    Attributes:
        angle_rad: between the needle and the wall's normal.
        direction_rad: of the needle's way down, along the wall, from the meridian.
        friction: Coulomb's, between needle and wall; None: the needle sticks, and
            pushes along itself.
    """

    angle_rad: float
    direction_rad: float
    friction: float | None = None

    @property
    def push_rad(self) -> float:
        """Angle between the force on the wall and the normal: the needle's, or
        friction's where the needle slides.
        """
        return (
            self.angle_rad
            if self.friction is None
            else min(self.angle_rad, atan(self.friction))
        )

    @property
    def felt(self) -> float:
        """Share of the force on the wall that a sensor along the needle feels; the
        holder bears the part across it.
        """
        return cos(self.angle_rad - self.push_rad)


@dataclass(frozen=True)
class FigureEye:
    """One virtual eye: what it is, its study (form, globe, tilt of the needle) and
    where its forces lie.

    `shares` are uniform between 0 and 1, one for each frame: the forces as shares of
    the largest one, which is the study's or, in an eye that gives way before, less (see
    `ComputedEye.largest_n`). `tell_globe`: its recording says whether the globe is open
    or sealed, though never how rigid it is. `lean`: of a needle that leans;
    `calibrated_at`: its lean in a recording of its own that calibrates the eye, None if
    the eye's one recording does. `scan`: file of a real scan whose pixels the frames
    have; None: they are drawn.
    """

    group: str
    setup: Setup
    study: Study
    shares: tuple[float, ...]
    seed: int
    tell_globe: bool = True
    lean: Lean | None = None
    calibrated_at: Lean | None = None
    scan: Path | None = None

    @property
    def name(self) -> str:
        """Name of the recording: the eye's, with a mark if it only calibrates."""
        return eye_name(self.setup) + "-calibration" * (
            self.lean is not None and self.calibrated_at is None
        )

    @property
    def calibrating(self) -> "FigureEye":
        """The eye in the recording that calibrates it: another session, or this one."""
        if self.calibrated_at is None:
            return self
        return replace(
            self, lean=self.calibrated_at, calibrated_at=None, seed=self.seed + 1
        )

    def forces_n(self, largest_n: float) -> tuple[float, ...]:
        """Return the forces of the frames, in N, where the largest one is
        `largest_n`.
        """
        return tuple(share * largest_n for share in self.shares)

    def held_still(self) -> "FigureEye":
        """Return the eye as it is where it does not turn under the needle."""
        phantom = replace(
            self.study.phantom, eye_drift_rad=fixed(0.0), eye_saccade_rad=fixed(0.0)
        )
        return replace(self, study=replace(self.study, phantom=phantom))
