"""One virtual eye of the figures: all that is drawn of it. `figures.groups` draws them."""

from dataclasses import dataclass, replace

from scleraforce.laboratory.virtual_eye import PhantomEye
from scleraforce.study import Study, fixed


@dataclass(frozen=True)
class FigureEye:
    """One virtual eye: what it is, its study (form, globe, tilt of the needle) and where its forces lie.

    `shares` are uniform between 0 and 1, one for each frame: the forces as shares of the largest one, which is the
    study's or, in an eye that gives way before, less (see `ComputedEye.largest_n`). `tell_globe`: its recording says
    whether the globe is open or sealed, though never how rigid it is.
    """

    group: str
    eye: PhantomEye
    study: Study
    shares: tuple[float, ...]
    seed: int
    tell_globe: bool = True

    def forces_n(self, largest_n: float) -> tuple[float, ...]:
        """Return the forces of the frames, in N, where the largest one is `largest_n`."""
        return tuple(share * largest_n for share in self.shares)

    def held_still(self) -> "FigureEye":
        """Return the eye as it is where it does not turn under the needle."""
        phantom = replace(self.study.phantom, eye_drift_rad=fixed(0.0), eye_saccade_rad=fixed(0.0))
        return replace(self, study=replace(self.study, phantom=phantom))
