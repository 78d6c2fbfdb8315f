"""The counts and scales of a scanner's images; parts against their whole image; images
other than a B-scan.
"""

import struct
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
from effects import less_than
from fastcrc.crc64 import ecma_182
from hypothesis import given, settings, strategies as st

from scleraforce.base.errors import ProtocolError
from scleraforce.live.network.openigtlink import Decoder, Image
from scleraforce.live.network.scanner_frame import FrameAssembler, ScannerFrame

DRAW = np.random.default_rng(11)
COUNTS = DRAW.integers(0, 4096, (6, 9)).astype(np.uint16)
# Steps of 3-4-5 and 8-15-17 triangles: the pixel measures 5 x 17 um whatever way the
# plane lies.
MATRIX = (0.003, 0.0, 0.004, 0.0, -0.008, 0.015, 1.0, 0.0, 0.0, 7.0, 8.0, 9.0)


def image(counts: np.ndarray = COUNTS, **changes: object) -> Image:
    return replace(Image(counts[np.newaxis], MATRIX), **changes)


def part(
    rows: slice,
    columns: slice = slice(0, 9),
    counts: np.ndarray = COUNTS,
    **changes: object,
) -> Image:
    height, width = counts.shape
    placed = {
        "size": (width, height, 1),
        "offset": (columns.start, rows.start, 0),
        **changes,
    }

    return image(counts[rows, columns], **placed)


def frame_of(found: ScannerFrame | None) -> ScannerFrame:
    assert found is not None
    return found


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(
    ("sent", "counted", "code"),
    [
        ("int8", "uint8", 2),
        ("uint8", "uint8", 3),
        ("int16", "uint16", 4),
        ("uint16", "uint16", 5),
    ],
)
def test_what_is_sent_is_counted_without_a_sign(sent, counted, code, order):
    counts = [[0, 1, np.iinfo(sent).max], [5, 6, 7]]
    pixels = np.array(counts, np.dtype(sent).newbyteorder(order))
    head = struct.pack(">H4B", 1, 1, code, 1 + (order == "<"), 1)
    size = struct.pack(">3H12f6H", 3, 2, 1, *MATRIX, 0, 0, 0, 3, 2, 1)
    body = head + size + pixels.tobytes()
    header = struct.pack(">H12s20sQQQ", 1, b"IMAGE", b"x", 0, len(body), ecma_182(body))
    (event,) = Decoder().feed(header + body)
    frame = frame_of(FrameAssembler().add(event.message))
    assert frame.pixels.dtype == np.dtype(counted)
    assert frame.pixels.tolist() == counts
    assert not frame.pixels.flags.writeable


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (image(COUNTS.astype(np.int16) - np.int16(4000)), "negative"),
        (image(np.array([[0, -1]], dtype=np.int8)), "int8 pixels down to -1"),
        (Image(np.zeros((1, 2, 2, 3), np.uint8), MATRIX), "1 slices, 3 components"),
        (Image(np.zeros((2, 2, 2), np.uint8), MATRIX), "2 slices"),
        (part(slice(0, 2), size=(9, 6, 3)), "3 slices"),
        (image(matrix=(0.0, 0.0, 0.0, *MATRIX[3:])), "0.0 x "),
        (image(matrix=(*MATRIX[:3], 0.0, 0.0, 0.0, *MATRIX[6:])), " x 0.0 m"),
        (image(matrix=(float("nan"), *MATRIX[1:])), "nan"),
        (image(COUNTS.astype(np.float32)), "float32"),
        (image(COUNTS.astype(">u2")), "byte order"),
    ],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_an_image_other_than_a_b_scan_is_refused_in_one_line(wrong, says):
    assembler = FrameAssembler()
    with pytest.raises(ProtocolError, match=says) as refused:
        assembler.add(wrong)

    assert "\n" not in str(refused.value)
    assert frame_of(assembler.add(image())).pixels.shape == (6, 9)


@settings(max_examples=60, deadline=None)
@given(
    st.sets(st.integers(1, 5), max_size=4),
    st.sets(st.integers(1, 8), max_size=4),
    st.randoms(use_true_random=False),
    st.sampled_from(["uint8", "int16", "uint16"]),
)
def test_parts_in_any_order_behind_the_first_make_the_image_they_were_cut_from(
    rows, columns, random, dtype
):
    counts = (COUNTS % 120).astype(dtype)
    cut = [
        [slice(*ends) for ends in pairwise([0, *sorted(at), end])]
        for at, end in ((rows, 6), (columns, 9))
    ]
    first, *others = [part(r, c, counts) for r, c in product(*cut)]
    random.shuffle(others)
    assembler = FrameAssembler()

    for _ in range(2):  # a second image follows
        *before, last = [assembler.add(p) for p in [first, *others]]
        assert before == [None] * len(others)
        frame = frame_of(last)
        assert np.array_equal(frame.pixels, counts)
        assert not frame.pixels.flags.writeable
        assert (frame.lateral_m, frame.depth_m) == pytest.approx((5e-6, 17e-6))


UPPER = part(slice(0, 4))
LOWER = part(slice(4, 6))
OTHER = COUNTS ^ 0xFFF


@pytest.mark.parametrize(
    "second",
    [
        part(slice(3, 6)),
        part(slice(3, 4), slice(8, 9)),
        image(),
        part(slice(4, 6), size=(9, 7, 1)),
        part(slice(4, 6), counts=COUNTS.astype(np.int16)),
        part(slice(4, 6), matrix=(0.0031, *MATRIX[1:])),
        part(slice(4, 6), coordinates=2),
    ],
)
def test_a_part_that_does_not_belong_is_refused_and_those_before_it_are_forgotten(
    second,
):
    assembler = FrameAssembler()
    assembler.add(UPPER)
    with pytest.raises(ProtocolError, match="IMAGE: the part rows"):
        assembler.add(second)

    with pytest.raises(ProtocolError, match="first pixel"):
        assembler.add(LOWER)

    assert assembler.add(part(slice(0, 4), counts=OTHER)) is None
    whole = frame_of(assembler.add(part(slice(4, 6), counts=OTHER)))
    assert np.array_equal(whole.pixels, OTHER)


def test_a_part_that_overlaps_begins_the_next_image():
    assembler = FrameAssembler()
    assembler.add(UPPER)
    with pytest.raises(ProtocolError, match="overlaps"):
        assembler.add(part(slice(0, 3), counts=OTHER))
    whole = frame_of(assembler.add(part(slice(3, 6), counts=OTHER)))
    assert np.array_equal(whole.pixels, OTHER)


@pytest.mark.parametrize("other_s", [5.0, 0.0, None, 10.0 + 2.0**-20])
def test_parts_of_different_times_are_not_one_frame(other_s):
    assembler = FrameAssembler()
    assert assembler.add(UPPER, 1.0, 10.0) is None
    with pytest.raises(ProtocolError, match="another size, type, matrix or time"):
        assembler.add(LOWER, 1.001, other_s)

    assert assembler.add(UPPER, 2.0, other_s) is None
    frame = frame_of(assembler.add(LOWER, 7.0, other_s))
    assert frame.begun_s == 2.0  # as old as its oldest part
    assert frame_of(FrameAssembler().add(image(), 3.0, 10.0)).begun_s is None


@settings(max_examples=100, deadline=None)
@given(st.integers(2, 4), st.data())
def test_whatever_parts_are_lost_no_frame_is_put_together_of_two_images(parts, data):
    lost = data.draw(st.sets(st.integers(0, 8 * parts - 1)))
    assembler = FrameAssembler()
    frames = []

    for turn in range(8 * parts):
        number, index = divmod(turn, parts)
        # every image is of one number
        counts = np.full((2 * parts, 3), number, dtype=np.uint8)

        if turn in lost:
            assembler = FrameAssembler()
            continue

        try:
            frames.append(
                assembler.add(
                    part(slice(2 * index, 2 * index + 2), slice(0, 3), counts)
                )
            )
        except ProtocolError:
            continue

    whole = [n for n in range(8) if not lost & set(range(n * parts, (n + 1) * parts))]
    assert [
        np.unique(frame.pixels).tolist() for frame in frames if frame is not None
    ] == [[n] for n in whole]


def test_a_frame_over_the_cap_takes_no_room():
    corner = Image(np.ones((1, 1, 1), dtype=np.uint16), MATRIX, (0xFFFF, 0xFFFF, 1))
    with (
        less_than(100_000),
        pytest.raises(ProtocolError, match="8589672450 bytes: at most 16777216"),
    ):
        FrameAssembler().add(corner)

    assert FrameAssembler(108).add(UPPER) is None
    with pytest.raises(ProtocolError, match="108 bytes: at most 107"):
        FrameAssembler(107).add(UPPER)
