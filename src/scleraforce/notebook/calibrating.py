"""Recordings with their force logs: calibrate on them, and compare a model's answers with them."""

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path

from scleraforce.calibration.result import Calibration, calibration_as_json
from scleraforce.compiled import use_compiled_loops
from scleraforce.errors import InputError
from scleraforce.known.calibration_file import write_calibration
from scleraforce.models.folder import SHIPPED_WALL_FINDER
from scleraforce.notebook.frames import check_model, summary_of_calibration
from scleraforce.notebook.work import Given, calibrate_eyes, counting_for, opened
from scleraforce.reader.answer import Reader
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.study import Study

MECHANICS = ("finite-strain", "linear")
LEAST_WALL_M, LARGEST_WALL_M = 100e-6, 3e-3  # as in a recording.toml
PARAMETERS = ("e", "stiffening", "iop", "thickness", "gap")


def calibrate(
    recordings: Given | Sequence[Given],
    study: Study | None = None,
    *,
    frames: int | None = None,
    parameters: Sequence[str] | None = None,
    mechanics: str = "finite-strain",
    earlier: Calibration | None = None,
    wall_finder: str | PathLike[str] | None = SHIPPED_WALL_FINDER,
    thickness_m: float | None = None,
    out: str | PathLike[str] | None = None,
    progress: Callable[[int], object] | None = None,
) -> Calibration:
    """Estimate Young's modulus of each eye from its recordings.

    Args:
        recordings: one or more, opened or as folders, with force logs; those of one eye add up.
        study: prior, filter and library; None: the paper's.
        frames: take the first so many frames above 5 mN of each recording; None: all.
        parameters: what is uncertain, of "e", "stiffening", "iop", "thickness", "gap"; "e" among them. None: e and the
            stiffening, with linear mechanics e.
        mechanics: "finite-strain" (from the library), or the paper's "linear".
        earlier: to go on from.
        wall_finder: model folder that checks the walls, by default the one that ships; None: nothing does.
        thickness_m: of the wall; None: the recordings'. All of them are of one eye then.
        out: a file to write as well, for the commands; it must not exist.
        progress: called with 1 after each frame.

    Returns:
        `eyes` by name, each with `mean_pa`, `sd_pa` and `status`, and the mean and spread of the `population`.

    Raises:
        InputError: a recording cannot be calibrated on, `out` exists, or the study has keys that this mechanics does
            not use.

    >>> import scleraforce as sf
    >>> calibration = sf.calibrate("eye-a", sf.read_study("study.toml"), frames=2)
    >>> print(f"{calibration.eyes['eye-a'].mean_pa / 1e6:.1f} MPa")
    0.3 MPa
    """
    if mechanics not in MECHANICS:
        raise InputError(f"mechanics: {mechanics!r}; give {' or '.join(MECHANICS)}")
    if parameters is not None and ("e" not in parameters or set(parameters) - set(PARAMETERS)):
        others = ", ".join(repr(name) for name in PARAMETERS[1:])
        raise InputError(f"parameters: {parameters!r}; give a list of 'e' and of {others} what else")
    if frames is not None and frames < 1:
        raise InputError(f"frames: {frames}; give at least 1")
    if thickness_m is not None and not LEAST_WALL_M <= thickness_m <= LARGEST_WALL_M:
        raise InputError(f"thickness_m: {thickness_m:g}; give between {LEAST_WALL_M:g} and {LARGEST_WALL_M:g} m")
    if out is not None and Path(out).exists():
        raise InputError(f"{out}: exists already; remove it or choose another name")
    found = calibrate_eyes(
        recordings,
        study or Study(),
        counting_for("frames", progress),
        mechanics=mechanics,
        parameters=parameters,
        frames=frames,
        earlier=earlier,
        wall_finder=wall_finder,
        thickness_m=thickness_m,
    )
    if out is not None:
        write_calibration(calibration_as_json(found), Path(out))
    return found


def evaluate(
    model: Reader,
    recordings: Given | Sequence[Given],
    calibration: Calibration | str | PathLike[str] | None = None,
    *,
    progress: Callable[[int], object] | None = None,
) -> Evaluation:
    """Read every frame of recordings and compare with their force logs.

    Args:
        model: of `load_model` or `train`.
        recordings: one or more, opened or as folders.
        calibration: of `calibrate`, or its file: gives a reader the eyes' moduli; its frames are not scored.
        progress: called with 1 after each frame.

    Returns:
        The answer to each of the `frames`, `mae_n`, `coverage`, `accuracy`, `confusion` (rows: target), and `notes`.

    Raises:
        InputError: a recording or the calibration cannot be used, or not with this model.

    >>> import scleraforce as sf
    >>> evaluation = sf.evaluate(sf.load_model("reader"), "eye-a")
    >>> [frame.predicted for frame in evaluation.frames]
    [1, 2, 2]
    """
    check_model(model)
    use_compiled_loops()
    folders = [recording.path for recording in opened(recordings)]
    summary = None if calibration is None else summary_of_calibration(calibration)
    return evaluate_recordings(model, folders, summary, progress)
