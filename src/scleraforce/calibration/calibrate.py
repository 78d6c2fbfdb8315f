"""Young's modulus of each eye from its recordings, and of the population (paper sec. 3.2, Table 2)."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from scleraforce.calibration.one_tissue import FrameWalls, StepCount, Way, calibrate_eye
from scleraforce.calibration.result import Calibration, EyeCalibration, rigidity_words
from scleraforce.calibration.stiffening import TissueTrial, most_trials, search
from scleraforce.errors import CalibrationError
from scleraforce.known import NINETY_PERCENT, OPEN, SEALED, UNKNOWN
from scleraforce.library import Library
from scleraforce.recording.folder import Recording
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import Study

SURE_SEALED = 3.0  # standard deviations that a rigidity lies above 0 of a globe that cannot be open
STIFFENING = "stiffening"  # the parameter that no filter has: it is searched for
SOUGHT_ON = 6  # frames; where more are wanted, they are calibrated on once it is found


def calibrate_recordings(
    recordings: Sequence[Recording],
    study: Study,
    study_sha256: str,
    library: Library | None,
    parameters: tuple[str, ...] | None = None,
    frames: int | None = None,
    earlier: Calibration | None = None,
    progress: Callable[[int], object] | None = None,
    finder: WallFinder | None = None,
) -> Calibration:
    """Calibrate every eye on its recordings; recordings of one eye add up.

    Args:
        recordings: with force logs.
        study: prior, filter, mesh.
        study_sha256: hash of the study, kept as provenance.
        library: responses of finite strain; None: linear mechanics, as in the paper.
        parameters: what is uncertain, of `e`, `stiffening`, `iop`, `thickness`, `gap`; `e` among them. None: e, and
            with a library the stiffening, which is found on the first recording of an eye. If it is not among them, it
            is the study's.
        frames: take so many frames of each recording that bear enough force, deep dents among them; None: all.
        earlier: to go on from; the frames that its eyes have used are left out.
        progress: called with 1 after each frame, in each of `calibration_passes`.
        finder: checks the walls: a frame in which it sees another one is not used. None: nothing checks them.

    Raises:
        CalibrationError: a recording without force log or wall thickness, or no frame that can be used; an earlier
            calibration with other mechanics or parameters.
    """
    if parameters is None:
        parameters = ("e",) if library is None else ("e", STIFFENING)
    if "e" not in parameters:
        raise CalibrationError(f"parameters {','.join(parameters)}: e must be among them")
    if library is None and STIFFENING in parameters:
        raise CalibrationError("parameters: linear mechanics knows no tissue that stiffens; leave out stiffening")
    mechanics = "linear" if library is None else "finite-strain"
    if earlier is not None and earlier.mechanics != mechanics:
        raise CalibrationError(
            f"the earlier calibration has {earlier.mechanics} mechanics, not {mechanics}; name the same"
        )
    of_filter = tuple(name for name in parameters if name != STIFFENING)
    passes = calibration_passes(library, parameters)
    way = Way(study, library, of_filter, STIFFENING in parameters, frames, finder)
    eyes = {} if earlier is None else dict(earlier.eyes)
    for recording in recordings:
        eye_id = recording.info.eye.id
        before = eyes.get(eye_id)
        count = StepCount(passes * len(recording.frames), progress)
        eyes[eye_id] = _of_eye(recording, way, before, count)
        count.finish()
    mine = {recording.info.eye.id: eyes[recording.info.eye.id] for recording in recordings}
    return Calibration(mine, study_sha256, study.classes.bounds_n, mechanics)


def _of_eye(recording: Recording, way: Way, before: EyeCalibration | None, count: StepCount) -> EyeCalibration:
    """Calibrate an eye; where its filter diverges, say what its frames tell of its globe."""
    told = recording.info.eye.globe
    used = frozenset() if before is None else frozenset(record.sha256 for record in before.frames)
    frames = FrameWalls(recording, way.finder, used)
    if before is not None and told == before.globe.kind == "open" and before.globe.can_be_sealed:
        return _as_open(_of_tissue(_untold(recording), way, frames, before, count))
    found = _of_tissue(recording, way, frames, before, count)
    if found.status == "ok" or before is not None or way.library is None or told is None:
        return found
    other = _of_tissue(_untold(recording), way, frames, None, StepCount(0, None))
    if other.status != "ok":
        return found
    if told == "open" and other.globe.mean < max(SEALED.lowest, SURE_SEALED * other.globe.sd):
        return _doubted(
            _as_open(other),
            f"eye.globe is stated as open, and its walls are none that the model knows: they are read as with "
            f"{rigidity_words(other)}, less than that of closed eyes; is its limbus in view, or its wall uneven?",
        )
    doubt = (
        f"eye.globe is stated as {told}, and the frames contradict that; of a globe that may be open or sealed "
        f"they say {rigidity_words(other)} and do not: state what it is, or leave eye.globe out"
    )
    return _doubted(replace(found, globe=UNKNOWN), doubt)


def _untold(recording: Recording) -> Recording:
    """Return a recording that says nothing of its globe."""
    eye = replace(recording.info.eye, globe=None, rigidity_pa13_per_m3=None, rigidity_law=None)
    return replace(recording, info=replace(recording.info, eye=eye))


def _as_open(eye: EyeCalibration) -> EyeCalibration:
    """Return an eye that was told open and found with a small rigidity, which stands for what its walls have else.

    So it is no surer than what was told: the band that holds it with 90 % reaches down to 0.
    """
    sd = max(eye.globe.sd, eye.globe.mean / NINETY_PERCENT)
    return replace(eye, globe=replace(eye.globe, kind=OPEN.kind, sd=sd))


def _doubted(eye: EyeCalibration, doubt: str) -> EyeCalibration:
    """Return an eye whose last recording is doubted."""
    *others, last = eye.recordings
    return replace(eye, recordings=(*others, replace(last, doubts=(*last.doubts, doubt))))


def calibration_passes(library: Library | None, parameters: tuple[str, ...] | None) -> int:
    """Return how often, at most, every frame of a recording is gone through."""
    sought = parameters is None or STIFFENING in parameters
    return most_trials(library) + 1 if sought and library is not None else 1


def stated_tissue(library: Library, study: Study) -> Library:
    """Return the library of a study's tissue.

    Raises:
        InputError: the library does not hold such tissue.
    """
    return library.for_stiffening(study.tissue.stiffening)


def _of_tissue(
    recording: Recording, way: Way, frames: FrameWalls, earlier: EyeCalibration | None, count: StepCount
) -> EyeCalibration:
    """Calibrate an eye with the walls of the tissue that explains its frames best, or of the one that is known."""
    if way.library is None:
        known = None
    elif earlier is not None:
        known = way.library.for_stiffening(earlier.stiffening)
    elif way.stiffening_sought:
        return _of_sought_tissue(recording, way, way.library, frames, count)
    else:
        known = stated_tissue(way.library, way.study)
    return calibrate_eye(recording, replace(way, library=known), frames, earlier, count).found


def _of_sought_tissue(
    recording: Recording, way: Way, library: Library, frames: FrameWalls, count: StepCount
) -> EyeCalibration:
    """Calibrate an eye with the walls of the tissue that explains its frames best."""
    faults = list[CalibrationError]()
    more = len(recording.frames) > SOUGHT_ON and (way.frames is None or way.frames > SOUGHT_ON)

    def calibrate(of_tissue: Library, wanted: int | None) -> TissueTrial[EyeCalibration]:
        with np.errstate(all="ignore"):  # with walls that are far from the eye's a filter may end anywhere
            return calibrate_eye(recording, replace(way, library=of_tissue, frames=wanted), frames, None, count)

    def attempt(of_tissue: Library) -> TissueTrial[EyeCalibration] | None:
        try:
            return calibrate(of_tissue, SOUGHT_ON if more else way.frames)
        except CalibrationError as fault:
            faults.append(fault)
            return None

    found = search(library, attempt)
    if found is None:
        raise faults[0]
    stiffening, eye = found
    return calibrate(library.for_stiffening(stiffening), way.frames).found if more else eye
