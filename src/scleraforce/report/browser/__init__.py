"""The page of `show RECORDING --html`: every frame with its wall and what a model reads in it, one at a time.

The page is one file. Its script stands inside and fetches nothing. A picture takes 40 KB; of a long recording not every
frame has one.
"""

from collections.abc import Callable, Iterator
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.recording.folder import read_recording
from scleraforce.report.files import write_page
from scleraforce.report.frames import WALL_COLOURS, shown_frames, wall_picture
from scleraforce.report.html import Html, bullets, class_names, embedded, made_line, page, paragraph, section
from scleraforce.units import from_si

WIDTH = 560  # pixels of a picture
MOST_PICTURES = 1000  # what a browser opens at once: 40 MB
HERE = files("scleraforce.report.browser")
KEYS = (
    "Left and right arrow: one frame; page up and down: ten; home and end: first and last; space: play. The curve "
    "shows all frames; click in it to go to one. Grey: the measured force. Dots with bars: the read force with "
    "its 90 % interval; a cross at the top: not usable."
)


def write_browser_html(
    evaluation: Evaluation,
    path: Path,
    made_at: datetime,
    progress: Callable[[int], object],
) -> None:
    """Write the page of one recording.

    Args:
        evaluation: the answers to its frames, each with the wall that was read, which is drawn.
        path: the file to write.
        made_at: what the page gives as its date.
        progress: called with 1 after each frame.

    Raises:
        InputError: the file exists already or cannot be written, or a frame cannot be read again.
    """
    name = evaluation.frames[0].recording
    data = {
        "classes": class_names(evaluation.bounds_n),
        "bounds_mn": [from_si(bound, "mn") for bound in evaluation.bounds_n],
        "frames": list(_frames(evaluation, progress)),
    }
    markup = Html(HERE.joinpath("browser.html").read_text(encoding="utf-8"))
    script = HERE.joinpath("browser.js").read_text(encoding="utf-8")
    style = HERE.joinpath("browser.css").read_text(encoding="utf-8")
    limits = [section("What limits the readings", bullets(evaluation.notes))] if evaluation.notes else []
    content = page(
        f"Recording {evaluation.frames[0].eye}",
        f"{name}, read by {evaluation.model}.",
        made_line(made_at),
        Html(markup + embedded("frames", data)),
        section("How to read it", paragraph(KEYS), paragraph(WALL_COLOURS)),
        *limits,
        style=style,
        script=script,
    )
    write_page(content, path)


def _frames(evaluation: Evaluation, progress: Callable[[int], object]) -> Iterator[dict[str, Any]]:
    """Yield what the script shows of each frame; one frame is in memory at a time."""
    recording = read_recording(evaluation.frames[0].recording)
    extent_m = recording.info.oct.width_m, recording.info.oct.depth_m
    pictured = {frame.file for frame in shown_frames(evaluation.frames, MOST_PICTURES)}
    for entry, frame in zip(recording.frames, evaluation.frames, strict=True):
        picture = None
        if entry.file in pictured:
            wall = frame.answer.segmentation
            if wall is None:
                raise ValueError(f"{frame.file}: the answer has no segmentation")
            picture = wall_picture(recording.frame(entry), wall, extent_m, WIDTH)
        yield {"time_s": entry.time_s, "picture": picture, **_answered(frame)}
        progress(1)


def _answered(frame: FrameAnswer) -> dict[str, Any]:
    answer = frame.answer
    return {
        "file": frame.file,
        "measured_mn": from_si(frame.measured_force_n, "mn"),
        "read_mn": from_si(answer.force_n, "mn"),
        "interval_mn": None if answer.interval_n is None else [from_si(end, "mn") for end in answer.interval_n],
        "predicted": answer.predicted,
        "target": frame.target,
        "usable": answer.usable,
        "reason": answer.reason,
        "remarks": [
            *answer.warnings,
            *(["Young's modulus was calibrated on this frame"] if frame.calibration else []),
            *([f"left out of metrics: {frame.excluded}"] if frame.excluded else []),
        ],
    }
