"""One eye, frame by frame: what a recording is calibrated with, and a session while it runs.

`begin`, then `step` for each frame; every value is a new record, and the posterior can be read at any time. Frames of
little force say where the eye lies but nothing of its modulus. All at once or one by one, the result is the same.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.assimilation import (
    LEAST_POINTS,
    PARAMETERS,
    EyeFilter,
    EyeState,
    FrameInput,
    FrameStep,
    Skipped,
    assimilate,
    eye_filter,
    first_state,
    known_globe_after,
    moments,
    rigidity_after,
)
from scleraforce.calibration.even_wall import without_form
from scleraforce.calibration.eye_model import EyeConstants, EyeModel, known_of_constants
from scleraforce.calibration.forces import ZERO_PRIOR
from scleraforce.calibration.library_eye import LibraryEye, library_eye
from scleraforce.calibration.linear_eye import linear_eye
from scleraforce.calibration.registration import frame_prior, register, updated_belief
from scleraforce.known.eye import Known, Modulus
from scleraforce.library import Library
from scleraforce.segmentation.observations import Boundaries
from scleraforce.study import Study
from scleraforce.units import from_si

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EyeSession:
    """An eye after some frames; `last` is what became of the latest one, None before the first.

    `zero_covariance` (2, 2) is that of the force sensor's zero and its drift, which all frames share.
    """

    filter: EyeFilter
    state: EyeState
    zero_covariance: Array
    last: FrameStep | Skipped | None = None

    @property
    def mean_pa(self) -> float:
        """Posterior mean of Young's modulus: the prior's before the first frame."""
        return self._modulus(0)

    @property
    def sd_pa(self) -> float:
        """Posterior standard deviation of Young's modulus."""
        return self._modulus(1)

    @property
    def updates(self) -> int:
        """How many frames the estimate rests on."""
        return self.state.posterior.updates

    def _modulus(self, moment: int) -> float:
        values = moments(self.filter, self.state)[moment]
        return float(values[self.filter.space.names.index("youngs_modulus_pa")])


def eye_model(
    study: Study, constants: EyeConstants, library: Library | None, thickness_uncertain: bool = False
) -> EyeModel:
    """Return the model of an eye: of finite strain with a library, of the paper's linear mechanics without.

    Raises:
        CalibrationError: the eye cannot be meshed, or the library does not have it.
    """
    if library is None:
        return linear_eye(study, constants, thickness_uncertain)
    return library_eye(study, constants, library)


def begin(
    study: Study,
    constants: EyeConstants,
    library: Library | None,
    parameters: tuple[str, ...] = ("e",),
    zero_covariance: Array = ZERO_PRIOR,
) -> EyeSession:
    """Return an eye before its first frame.

    Args:
        study: prior, filter, and for linear mechanics the mesh.
        constants: what is stated about the eye and the B-scan's plane.
        library: finite-strain responses; None: linear mechanics.
        parameters: what is uncertain, of `e`, `iop`, `thickness`, `gap`; `e` among them.
        zero_covariance: of the forces' zero (N) and drift (N/s), (2, 2).

    Raises:
        CalibrationError: the eye cannot be meshed, or the library does not have it.
        ValueError: an unknown or repeated parameter.
    """
    model = eye_model(study, constants, library, "thickness" in parameters)
    eye = eye_filter(model, study.calibration, parameters)
    return EyeSession(eye, first_state(eye), zero_covariance)


def step(session: EyeSession, boundaries: Boundaries, force_n: float, since_start_s: float = 0.0) -> EyeSession:
    """Return the eye after one more frame.

    Args:
        session: the eye so far.
        boundaries: of the frame, see `frames.segmented_boundaries`.
        force_n: the needle's force under the frame.
        since_start_s: time of the frame, from where the zero's drift counts.
    """
    eye = session.filter
    if isinstance(eye.model, LibraryEye):
        boundaries = without_form(eye.model, boundaries, eye.study)
    if force_n <= eye.study.min_force_n:
        return _refer(session, boundaries, force_n)
    return _update(session, boundaries, force_n, since_start_s)


def known_after(session: EyeSession) -> Known:
    """Return what is known of an eye after its frames; nothing of its modulus where its last one diverged."""
    constants = session.filter.model.constants
    diverged = isinstance(session.last, FrameStep) and session.last.result.status != "ok"
    if diverged or not session.updates:
        return known_of_constants(constants)
    names, means = session.filter.space.names, moments(session.filter, session.state)[0]
    thickness_m = dict(zip(names, means.tolist(), strict=True)).get(PARAMETERS["thickness"], constants.thickness_m)
    modulus = Modulus(mean_pa=session.mean_pa, sd_pa=session.sd_pa, source="own")
    globe = known_globe_after(session.filter, session.state)
    return replace(known_of_constants(constants, modulus), thickness_m=thickness_m, globe=globe)


def _update(session: EyeSession, boundaries: Boundaries, force_n: float, since_start_s: float) -> EyeSession:
    """Return the eye after a frame that bears enough force to say something of its modulus; arguments of `step`."""
    frame = FrameInput(
        boundaries, force_n=force_n, since_start_s=since_start_s, zero_covariance=session.zero_covariance
    )
    found = assimilate(session.filter, session.state, frame)
    return replace(session, state=session.state if isinstance(found, Skipped) else found.state, last=found)


def _refer(session: EyeSession, boundaries: Boundaries, force_n: float) -> EyeSession:
    """Return the eye after a frame that says where it lies, but nothing of its modulus; arguments of `step`."""
    eye, state = session.filter, session.state
    if np.isfinite(boundaries.depth_m).sum() >= LEAST_POINTS:
        prior = frame_prior(state.belief, eye.study)
        sought = session.mean_pa, prior, rigidity_after(eye, state)
        fit = register(eye.model, boundaries, max(force_n, 0.0), *sought)
        state = replace(state, belief=updated_belief(state.belief, prior, fit))
    reason = f"at most {from_si(eye.study.min_force_n, 'mn'):g} mN: used as a reference of the pose"
    return replace(session, state=state, last=Skipped(reason))
