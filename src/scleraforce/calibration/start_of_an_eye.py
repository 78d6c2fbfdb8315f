"""Where E and k of an eye lie: one fit to all its frames and their known forces, with
which a calibration begins.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, sqrt

import numpy as np

from scleraforce.base.normal_distribution import correlation_of, is_beyond_chance
from scleraforce.fit import unknowns
from scleraforce.fit.frames_of_an_eye import EyeToFit, JointFit, ShownFrame, fit_forces
from scleraforce.fit.one_frame import NO_WALL_M, BoundaryFit, fit_boundaries
from scleraforce.fit.planes_of_a_moment import PlanesFit
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.library import Library
from scleraforce.recordings.force_errors import LABEL_SD_N
from scleraforce.records.fields import declared
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.wall.wall_in_metres import Boundaries

# Loss of the boundaries of a frame of an even wall. Walls that the library does not
# have lose more, whatever their tissue, and say less of it.
EVEN_LOSS = 5.0
# parameters of a calibration, beside E, that frames share: places in `unknowns.NAMES`
SOUGHT = {
    "iop": unknowns.IOP,
    "thickness": unknowns.THICKNESS,
    "gap": unknowns.GAP,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class ForceFrame:
    """A frame of known force.

    Attributes:
        wall: its boundaries, of several planes those of the followed one.
        force_n: the elastic force along the wall's normal.
        planes: the fit to all planes of its moment; None: there is one.
        gap_m: of the followed plane; None: the eye's.
        iop_pa: the pressure at rest at its time; None: the eye's.
    """

    wall: Boundaries
    force_n: float
    planes: PlanesFit | None = None
    gap_m: float | None = None
    iop_pa: float | None = None

    @property
    def shown(self) -> ShownFrame:
        """The frame as a joint fit takes it."""
        return ShownFrame(
            lateral_m=self.wall.lateral_m,
            depth_bc=self.wall.depth_m,
            iop_pa=self.iop_pa,
            force_n=self.force_n,
            force_sd_n=LABEL_SD_N,
            gap_m=self.gap_m,
        )


def first_fit(
    frame: ShownFrame, setup: Setup, library: Library, study: Study
) -> BoundaryFit | None:
    """Return the fit of a frame alone; None if no wall of the library lies on it, or if
    a frame of known force shows none.

    `setup` is the eye with the modulus of other eyes, `library` that of its contact.
    """
    gap_m = setup.needle.gap_m if frame.gap_m is None else frame.gap_m
    iop_pa = setup.eye.iop_pa if frame.iop_pa is None else frame.iop_pa
    at_frame = Setup(
        eye=replace(setup.eye, iop_pa=iop_pa),
        needle=replace(setup.needle, gap_m=gap_m),
        scan=setup.scan,
    )
    fit = fit_boundaries(
        library,
        frame.lateral_m,
        frame.depth_bc,
        prior_of(at_frame, study.reader, library.radius_m),
        study.calibration.surface_smoothing_m,
        frame.force_n,
    )
    if fit is None or fit.misfit_m > NO_WALL_M:
        return None

    is_undented = frame.force_n is not None and not fit.force_n > 0.0
    return None if is_undented else fit


@dataclass(frozen=True, eq=False)
class StartedEye:
    """An eye after the joint fit.

    Attributes:
        setup: the eye, with E and globe as found.
        fit: the joint fit.
        alone: the loss of all frames fitted alone, with the walls of the tissue that
            explain them best so far.
    """

    setup: Setup
    fit: JointFit
    alone: float

    @property
    def status(self) -> str:
        """'ok', or the sentence of frames that contradict what is stated of the eye.

        One eye must explain its frames nearly as well as each frame alone. Walls that
        the library does not have lose more than even ones, and say less by it.
        """
        count = len(self.fit.forces_n)
        uneven = max(1.0, self.alone / (EVEN_LOSS * count))
        excess = (self.fit.cost - self.alone) / uneven
        if not is_beyond_chance(excess, count):
            return "ok"

        return (
            f"diverged: one eye misses its {count} frames by"
            f" {sqrt(excess / count):.1f} sd a frame more than eyes of their own"
        )


def start_eye(
    setup: Setup,
    frames: Sequence[ForceFrame],
    fits: Sequence[BoundaryFit],
    library: Library,
    study: Study,
    sought: Mapping[str, float],
    before: StartedEye | None = None,
) -> StartedEye:
    """Return an eye with the E and the globe's rigidity that its frames show.

    Args:
        setup: the eye, its modulus the prior, its globe stated.
        frames: one at least.
        fits: each frame's `first_fit`.
        library: that of the eye's contact, of one tissue.
        study: ranges of what is not stated, and the segmentation's smoothing.
        sought: what is uncertain and found as well: names in `SOUGHT`, with the
            standard deviations of what is stated, that of the IOP's logarithm.
        before: the eye by the same frames and walls of another tissue.
    """
    globe = declared(setup.eye.globe, "globe")
    eye = EyeToFit(
        library=library,
        frames=[frame.shown for frame in frames],
        setup=setup,
        trained=study.reader,
        smoothing_m=study.calibration.surface_smoothing_m,
        begun_fn=np.array([fit.unknown for fit in fits]),
    )
    fit = fit_forces(eye, {SOUGHT[name]: sd for name, sd in sought.items()})
    (log_modulus, ratio), covariance = fit.stiffness
    modulus = declared(setup.eye.modulus, "modulus")
    mean_pa = exp(log_modulus)
    sds = np.sqrt(np.diag(covariance))
    modulus = replace(modulus, mean_pa=mean_pa, sd_pa=float(sds[0]) * mean_pa)

    if globe.can_be_sealed:
        globe = replace(
            globe,
            mean=globe.mean * float(ratio),
            sd=globe.mean * float(sds[1]),
            correlation=correlation_of(covariance, 0, 1),
            calibrated=True,
        )

    thickness_m = setup.eye.thickness_m
    if unknowns.THICKNESS in fit.names:
        thickness_m, _ = fit.moments(unknowns.THICKNESS)

    iop_pa = setup.eye.iop_pa
    if setup.eye.iop_assumed and unknowns.IOP in fit.names:
        iop_pa = exp(fit.moments(unknowns.IOP)[0])

    found = replace(
        setup.eye,
        modulus=modulus,
        globe=globe,
        thickness_m=thickness_m,
        iop_pa=iop_pa,
    )
    alone = sum(one.loss for one in fits)
    if before is not None:
        alone = min(alone, before.alone)
    return StartedEye(replace(setup, eye=found), fit, alone)


def with_prior(setup: Setup, study: Study) -> Setup:
    """Return a setup with the study's prior of E, the eye's own."""
    prior = study.calibration.prior("own")
    return replace(setup, eye=replace(setup.eye, modulus=prior))


def of_other_eyes(setup: Setup) -> Setup:
    """Return a setup whose modulus counts as that of other eyes."""
    modulus = declared(setup.eye.modulus, "modulus")
    other = replace(modulus, source="population")
    return replace(setup, eye=replace(setup.eye, modulus=other))
