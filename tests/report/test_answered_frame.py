"""Pages show the wall that was read, not one that is found again with other inputs."""

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from frame_answers import frame_answer

from bench_conjunctiva import SCALE, STUDY, drawn
from scleraforce.models.folder import SHIPPED_READER
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import evaluate_recordings
from scleraforce.reader.verdicts import look
from scleraforce.report.browser import write_browser_html
from scleraforce.report.frames import look_at, look_at_all, wall_picture
from scleraforce.segmentation.wall import Segmentation

MADE_AT = datetime(2026, 3, 1, tzinfo=UTC)


def recording_under_a_conjunctiva(folder: Path) -> tuple[np.ndarray, float]:
    """Write a recording of one frame; return the frame and the wall's thickness, which the recording states."""
    bscan, told_m = drawn(140, 1)
    (folder / "frames").mkdir(parents=True)
    cv2.imwrite(str(folder / "frames" / "1.png"), bscan.frame)
    (folder / "frames.csv").write_text("file,time_s\n1.png,0\n")
    (folder / "recording.toml").write_text(
        f'[eye]\nid = "eye"\nthickness_m = {told_m}\n[oct]\ncolumns = 512\nrows = 512\nbits = 12\nwidth_m = 15e-3\n'
        "depth_m = 4e-3\n[needle]\ngauge = 22\nslice_gap_m = 5e-4\n"
    )
    return bscan.frame, told_m


def test_an_evaluation_carries_the_wall_that_was_read_below_a_conjunctiva(tmp_path: Path) -> None:
    frame, told_m = recording_under_a_conjunctiva(tmp_path)
    evaluation = evaluate_recordings(load_model(SHIPPED_READER), [tmp_path])
    (shown,) = look_at_all(evaluation.frames)
    read, first = (look(frame, SCALE, STUDY.slice, thickness_m=told).segmentation for told in (told_m, None))
    np.testing.assert_array_equal(shown.found.outer_row, read.outer_row)
    assert np.nanmean(read.outer_row - first.outer_row) > 8.0  # it is not the layer's surface


def test_the_browsing_page_draws_the_wall_of_the_answer(tmp_path: Path) -> None:
    frame, _ = recording_under_a_conjunctiva(tmp_path / "rec")
    evaluation = evaluate_recordings(load_model(SHIPPED_READER), [tmp_path / "rec"])
    (answer,) = evaluation.frames
    moved = moved_wall(answer.segmentation)
    write_browser_html(
        replace(evaluation, frames=(replace(answer, segmentation=moved),)),
        tmp_path / "page.html", MADE_AT, lambda _: None,
    )  # fmt: skip
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    (picture,) = re.findall(r'"picture": ?"(data:image/jpeg;base64,[^"]+)"', page)
    assert picture.replace("\\/", "/") == wall_picture(frame, moved, (15e-3, 4e-3), 560)


def test_an_answer_without_a_wall_cannot_be_looked_at(tmp_path: Path) -> None:
    recording_under_a_conjunctiva(tmp_path)
    with pytest.raises(ValueError, match="segmentation"):
        look_at(frame_answer(recording=str(tmp_path), file="1.png"))


def moved_wall(found: Segmentation | None) -> Segmentation:
    """The same wall 20 rows deeper: one that no segmentation of the frame would find."""
    assert found is not None
    return Segmentation(
        found.outer_row + 20.0, found.inner_row + 20.0, found.rows, found.usable, found.reason, found.inner_found,
        thickness_m=found.thickness_m,
    )  # fmt: skip
