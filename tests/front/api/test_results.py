"""Results as plain types, tables and HTML; stacks, floats and masked arrays in place of
a frame.
"""

import json

import numpy as np
import pytest
from analytic_frames import GAP_M, KNOWN_EYE, SCALE, SIZE, frame_under
from page_markup import Markup
from small_models import force_reader
from small_recordings import write_pushes

import scleraforce as sf
from scleraforce.base.errors import FrameError, InputError
from scleraforce.calibration.calibration import Calibration
from scleraforce.reading.answer import Answer, Answers
from scleraforce.wall.wall_in_metres import segmented_boundaries

FRAMES = np.stack([frame_under(force_n) for force_n in (0.010, 0.020)])
EYE = KNOWN_EYE | SIZE | {"gap_m": GAP_M}


def read(frame: object, **given: object) -> Answer:
    return sf.read(force_reader(), frame, **{**EYE, **given})  # type: ignore[call-overload,no-any-return]


def test_a_stack_is_read_as_its_frames_are_one_by_one() -> None:
    counted: list[int] = []
    stack = read(FRAMES, progress=counted.append)
    assert isinstance(stack, Answers)
    one_by_one = [read(frame).to_dict() for frame in FRAMES]
    assert [answer.to_dict() for answer in stack] == one_by_one
    assert counted == [1, 1]
    assert list(stack[1:]) == [stack[1]]
    masks = np.stack([sf.segment(frame, **SIZE).mask for frame in FRAMES])
    by_mask = read(FRAMES, mask=masks)
    assert [answer.segmentation.source for answer in by_mask] == ["mask", "mask"]
    with pytest.raises(InputError, match="mask: 1 for a stack of 2 frames"):
        read(FRAMES, mask=masks[:1])


def test_floats_are_scaled_alike_in_a_stack_and_a_note_says_so() -> None:
    shares = FRAMES.astype(np.float32) / 4095
    for answer, counts in zip(read(shares), FRAMES, strict=True):
        assert answer.force_n == pytest.approx(read(counts).force_n, rel=0.02)
        assert answer.warnings[-1].startswith(
            f"frame: pixels of 0 to {shares.max():g} were scaled to counts of 0 to 65"
        )

    whole = read(FRAMES[0].astype(np.int64))
    assert whole.to_dict() == read(FRAMES[0]).to_dict()

    for value in (np.nan, np.inf):
        shares[0, 3, 3] = value
        with pytest.raises(FrameError, match="1 pixels are not finite"):
            read(shares)

    assert read(np.ma.masked_invalid(shares))[1].usable
    with pytest.raises(FrameError, match=r"shape \(2, 2, 512, 512\)"):
        read(np.stack([FRAMES, FRAMES]))


def test_columns_that_a_masked_array_masks_are_not_judged_and_leave_no_edge() -> None:
    torn = np.ma.masked_array(FRAMES[1].copy(), np.zeros(FRAMES[1].shape, dtype=bool))
    torn.data[:, 100:140] = 4095
    torn[7, 100:140] = np.ma.masked  # one pixel of a column is enough
    answer = read(torn)
    whole = read(FRAMES[1])
    rows = answer.segmentation.outer_row
    assert np.isnan(rows[100:140]).all()
    off = np.abs(rows - whole.segmentation.outer_row)
    assert np.nanmean(off) < 0.1
    assert np.nanmax(off) < 3.0, "beside the gap"
    assert answer.force_n == pytest.approx(whole.force_n, rel=0.03)
    turned = read(torn.T, scan=sf.Scan(transposed=True))
    assert turned.force_n == answer.force_n
    found = sf.segment(torn, **SIZE)
    assert np.isnan(segmented_boundaries(found, SCALE).depth_m[0]).sum() >= 40
    assert read(np.ma.masked_all_like(torn)).reason == "all columns are masked"


def test_masked_columns_are_not_judged_in_a_given_wall_either() -> None:
    half = np.broadcast_to(np.arange(512) < 256, FRAMES[1].shape)
    wall = sf.segment(FRAMES[1], **SIZE).mask
    expected = read(
        FRAMES[1], mask=np.where(half, 128, wall).astype(np.uint8)
    ).to_dict()

    for answer in (
        read(np.ma.array(FRAMES[1], mask=half), mask=wall),
        read(FRAMES[1], mask=np.ma.array(wall > 0, mask=half)),
        read(np.ma.array(wall > 0, mask=half)),
        read(np.ma.array(FRAMES[1:], mask=half[None]), mask=wall[None])[0],
    ):
        assert answer.to_dict() == expected

    assert read((wall > 0)[None])[0].to_dict() == read(wall > 0).to_dict()
    for empty in (FRAMES[:0], FRAMES[:, :0], FRAMES[0, :0]):
        with pytest.raises(FrameError, match="an array of shape"):
            read(empty)


def test_results_become_plain_types_and_tables() -> None:
    stack = read(np.concatenate([FRAMES, np.zeros_like(FRAMES[:1])]))
    plain = stack.to_dict()
    assert json.loads(json.dumps(plain, allow_nan=False)) == plain
    table = stack.to_dataframe()
    forces_n = [answer.force_n for answer in stack[:2]]
    forces_mn = [1e3 * force_n for force_n in forces_n]
    assert table["frame"].tolist() == [0, 1, 2]
    assert table["predicted_force_mn"].tolist()[:2] == forces_mn
    assert table["usable"].tolist() == [True, True, False]
    data = stack.to_xarray()
    assert data["force_n"].values.tolist()[:2] == forces_n
    assert np.isnan(data["force_n"].values[2])
    assert data["outer_row"].dims == ("frame", "column")
    assert float(data["interval_n"].sel(end="high")[1]) == stack[1].interval_n[1]


def test_an_evaluation_and_a_calibration_become_tables(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_pushes(tmp_path / "eye-a", forces_mn=(10.0, 20.0, 40.0))
    found = sf.evaluate(force_reader(), ["eye-a"])
    table = found.to_dataframe()
    files = [frame.file for frame in found.frames]
    assert list(table["file"]) == files
    columns = {"recording", "eye", "measured_force_mn", "interval_low_mn"}
    assert columns <= set(table.columns)
    assert sf.export(found, "answers.csv") == len(files)
    with pytest.raises(InputError, match=r"answers\.csv: exists already"):
        sf.export(found, "answers.csv")

    recording = sf.read_recording("eye-a")
    stack = read(np.stack([recording.frame(entry) for entry in recording.frames]))
    assert sf.export("eye-a", "stack.csv", answers=stack) == len(stack)
    for wrong in (stack[:1], stack[0]):
        with pytest.raises(InputError, match="answers: "):
            sf.export("eye-a", "wrong.csv", answers=wrong)  # type: ignore[arg-type]  # the mistake

    with pytest.raises(InputError, match="author: 'a"):
        sf.save_wall("eye-a", files[0], stack[0].segmentation.mask, author="a\nb")

    assert sf.export("eye-a", "both.json", answers=found) == len(files)
    rows = json.loads((tmp_path / "both.json").read_text())["frames"]
    read_classes = [frame.answer.predicted for frame in found.frames]
    assert [row["predicted"] for row in rows] == read_classes
    assert_is_html(found._repr_html_(), "frames")
    assert_is_html(recording._repr_html_(), "eye-a")


def test_jupyter_shows_frame_wall_force_and_interval() -> None:
    answer = read(FRAMES[1])
    low_mn, high_mn = (1e3 * end for end in answer.interval_n)
    assert_is_html(
        answer._repr_html_(),
        f"{1e3 * answer.force_n:.1f} mN (90 %: {low_mn:.1f} to {high_mn:.1f})",
    )
    assert "data:image/png;base64," in answer._repr_html_()
    assert_is_html(read(0 * FRAMES[0])._repr_html_(), "the frame is empty")
    assert_is_html(read(FRAMES)._repr_html_(), "frame 1")
    named = Calibration({}, "<b>", (5e-3, 30e-3), "<script>")
    assert "<script>" not in named._repr_html_()


def assert_is_html(text: str, words: str) -> None:
    assert words in Markup(text).said
    assert "http" not in text
    assert "color" not in text, "the page's own colours, light or dark"
