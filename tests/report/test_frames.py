"""Frames in reports: an answered frame looked at again, its picture, the preview of a recording."""

import base64
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from small_recordings import changed, evaluation_of, frame_answer, looked_at_frames

from bench_conjunctiva import SCALE, STUDY, drawn
from scleraforce.models import SHIPPED_READER
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import FrameAnswer, evaluate_recordings
from scleraforce.reader.verdicts import look
from scleraforce.report.frames import MOST_PICTURES, frame_pictures, look_at_all, shown_frames


def recording_under_a_conjunctiva(folder: Path) -> tuple[np.ndarray, float]:
    """Write a recording of one frame; return the frame and the wall's thickness, which the recording states."""
    bscan, thickness_m = drawn(140, 1)
    (folder / "frames").mkdir(parents=True)
    cv2.imwrite(str(folder / "frames" / "1.png"), bscan.frame)
    (folder / "frames.csv").write_text("file,time_s\n1.png,0\n")
    (folder / "recording.toml").write_text(
        f'[eye]\nid = "eye"\nthickness_m = {thickness_m}\n[oct]\ncolumns = 512\nrows = 512\nbits = 12\n'
        "width_m = 15e-3\ndepth_m = 4e-3\n[needle]\ngauge = 22\nslice_gap_m = 5e-4\n"
    )
    return bscan.frame, thickness_m


def test_an_evaluation_carries_the_wall_that_was_read_below_a_conjunctiva(tmp_path: Path) -> None:
    frame, thickness_m = recording_under_a_conjunctiva(tmp_path)
    evaluation = evaluate_recordings(load_model(SHIPPED_READER), [tmp_path])
    (shown,) = look_at_all(evaluation.frames)
    read, first = (look(frame, SCALE, STUDY.slice, thickness_m=stated).segmentation for stated in (thickness_m, None))
    np.testing.assert_array_equal(shown.found.outer_row, read.outer_row)
    assert np.nanmean(read.outer_row - first.outer_row) > 8.0  # it is not the layer's surface


def many(count: int, misread: tuple[int, ...] = ()) -> tuple[FrameAnswer, ...]:
    return tuple(frame_answer(file=f"{n:04d}.png", predicted=2 if n in misread else 1) for n in range(count))


def pictures(html: str) -> list[np.ndarray]:
    found = re.findall(r'src="data:image/jpeg;base64,([^"]*)"', html)
    return [cv2.imdecode(np.frombuffer(base64.b64decode(one), np.uint8), cv2.IMREAD_COLOR) for one in found]


def test_misread_frames_are_shown_first_and_others_in_even_steps() -> None:
    few = many(MOST_PICTURES)
    assert shown_frames(few) == few
    frames = many(1001, misread=(3, 4, 997))
    shown = shown_frames(frames)
    assert [frame.file for frame in shown[:3]] == ["0000.png", "0003.png", "0004.png"]
    numbers = [frames.index(frame) for frame in shown]
    assert numbers == sorted(numbers)
    assert len(shown) == MOST_PICTURES
    assert np.diff([number for number in numbers if number not in (3, 4, 997)]).min() > 20
    assert len(shown_frames(many(500, misread=tuple(range(400))))) == MOST_PICTURES


def test_a_picture_is_to_scale_and_has_surface_and_inner_boundary_where_they_were_found(tmp_path: Path) -> None:
    looks = looked_at_frames(tmp_path, 1)
    (picture,) = pictures(frame_pictures(evaluation_of([looks[0].answer]), looks))
    rows, columns = picture.shape[:2]
    width_m, depth_m = looks[0].extent_m
    assert abs(rows / columns - depth_m / width_m) < 0.5 / columns
    blue, green, red = (picture[:, columns // 2, channel].astype(int) for channel in range(3))
    scale = rows / len(looks[0].frame)
    middle = looks[0].frame.shape[1] // 2
    for colour, other, boundary in ((red, green, looks[0].found.outer_row), (green, red, looks[0].found.inner_row)):
        assert abs(int(np.argmax(colour - other)) - (boundary[middle] + 0.5) * scale) < 2.0
    assert (blue - green).max() < 60


def test_below_a_picture_are_the_measured_and_the_read_force_and_misread_ones_are_marked(tmp_path: Path) -> None:
    looks = looked_at_frames(tmp_path, 3)
    answers = (
        changed(looks[0].answer, predicted=2, force_n=0.031, interval_n=(0.029, 0.033)),
        changed(looks[1].answer, usable=False, reason="no wall found", probabilities=None, predicted=2, target=2),
        changed(looks[2].answer, measured_force_n=None, target=None, predicted=0),
    )
    looks = [replace(look, answer=answer) for look, answer in zip(looks, answers, strict=True)]
    html = frame_pictures(evaluation_of(answers), looks)
    assert html.count('<figure class="marked">') == 1
    assert "measured 20.0 mN (class 1); read 31.0 mN (29.0 to 33.0; class 2)" in html
    assert "not usable: no wall found" in html
    assert "not measured; read class 0" in html
    assert "All 3 frames are shown." in html
    assert "3 of the 101 frames are shown" in frame_pictures(evaluation_of([*answers, *many(98)]), looks)
