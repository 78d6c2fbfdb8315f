"""A frame that was answered shows, looked at again, the wall that was read."""

from pathlib import Path

import cv2
import numpy as np
from frame_answers import frame_answer

from bench_conjunctiva import SCALE, STUDY, drawn
from scleraforce.reader.look import look
from scleraforce.report.answered_frame import look_at_all


def test_the_wall_below_a_conjunctiva_is_the_one_that_was_read(tmp_path: Path) -> None:
    bscan, told_m = drawn(140, 1)
    (tmp_path / "frames").mkdir()
    cv2.imwrite(str(tmp_path / "frames" / "1.png"), bscan.frame)
    (tmp_path / "frames.csv").write_text("file,time_s\n1.png,0\n")
    (tmp_path / "recording.toml").write_text(
        f'[eye]\nid = "eye"\nthickness_m = {told_m}\n[oct]\ncolumns = 512\nrows = 512\nbits = 12\nwidth_m = 15e-3\n'
        "depth_m = 4e-3\n[needle]\ngauge = 22\nslice_gap_m = 5e-4\n"
    )
    (shown,) = look_at_all([frame_answer(recording=str(tmp_path), file="1.png")])
    read, first = (look(bscan.frame, SCALE, STUDY.slice, thickness_m=told).segmentation for told in (told_m, None))
    np.testing.assert_array_equal(shown.found.outer_row, read.outer_row)
    assert np.nanmean(read.outer_row - first.outer_row) > 8.0  # it is not the layer's surface
