"""Compare a model's answers with the force logs of recordings."""

from collections.abc import Callable, Sequence
from os import PathLike
from typing import TYPE_CHECKING

from scleraforce.errors import InputError
from scleraforce.notebook.counting import Counting, counting_for
from scleraforce.notebook.frames import check_model, summary_of_calibration
from scleraforce.reader import Reader
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.recording.folder import Recording, read_recording

if TYPE_CHECKING:
    from scleraforce.calibration.result import Calibration

Given = Recording | str | PathLike[str]


def evaluate(
    model: Reader,
    recordings: Given | Sequence[Given],
    calibration: "Calibration | str | PathLike[str] | None" = None,
    *,
    progress: Callable[[int], object] | None = None,
    counting: Counting | None = None,
) -> Evaluation:
    """Read every frame of recordings and compare with their force logs.

    Args:
        model: of `load_model` or `train`.
        recordings: one or more, opened or as folders.
        calibration: of `calibrate`, or its file: gives a reader the eyes' moduli; its frames are not scored.
        progress: called with 1 after each frame.
        counting: for bars, in place of `progress`: a context manager of the title "frames" and their number.

    Returns:
        The answer to each of the `frames`, `mae_n`, `coverage`, `accuracy`, `confusion` (rows: target), and `notes`.

    Raises:
        InputError: a recording or the calibration cannot be used, or not with this model.

    >>> import scleraforce as sf
    >>> evaluation = sf.evaluate(sf.load_model("reader"), "eye-a")
    >>> [frame.answer.predicted for frame in evaluation.frames]
    [1, 2, 2]
    """
    check_model(model)
    each = opened(recordings)
    summary = None if calibration is None else summary_of_calibration(calibration)
    with (counting or counting_for("frames", progress))("frames", sum(len(one.frames) for one in each)) as advance:
        return evaluate_recordings(model, each, summary, advance)


def opened(given: Given | Sequence[Given]) -> list[Recording]:
    """Return recordings; read folders.

    Raises:
        InputError: the list is empty, or a recording cannot be read.
    """
    each = [given] if isinstance(given, Recording | str | PathLike) else list(given)
    if not each:
        raise InputError("recordings: none; give at least one")
    return [entry if isinstance(entry, Recording) else read_recording(entry) for entry in each]
