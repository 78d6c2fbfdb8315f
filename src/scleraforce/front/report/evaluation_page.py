"""The page of an evaluation, with pictures of its frames."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from scleraforce.calibration.evaluation import Evaluation
from scleraforce.front.report.frame_figures import answered_frames
from scleraforce.front.report.html_pages import shown_frames, write_evaluation_html


def write_answers_page(
    evaluation: Evaluation, path: Path, worded: Callable[[str], str]
) -> None:
    """Write an evaluation as one page, made now; `worded` says its remarks in the words
    of the user: fields as flags.

    Raises:
        InputError: a frame cannot be read again, or the page cannot be written.
    """
    remarks = tuple(
        replace(remark, words=worded(remark.words)) for remark in evaluation.remarks
    )
    evaluation = replace(evaluation, remarks=remarks)
    shown = answered_frames(shown_frames(evaluation.frames))
    write_evaluation_html(evaluation, shown, path, datetime.now(UTC))
