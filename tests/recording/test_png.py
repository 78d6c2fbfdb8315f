import zlib

import cv2
import matplotlib.image
import numpy as np
import pytest

from scleraforce.recording.images import read_frame
from scleraforce.recording.writing import PngBuffer


@pytest.mark.parametrize("shape", [(2, 2), (2, 3), (512, 512), (3, 16384), (700, 2)])
def test_opencv_and_pillow_read_back_every_pixel_of_frame_after_frame(shape, tmp_path):
    buffer, rng = PngBuffer(*shape), np.random.default_rng(0)
    for _ in range(3):
        pixels = rng.integers(0, 2**16, shape).astype(np.uint16)
        data = bytes(buffer.encode(pixels))
        assert (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) == pixels).all()
        (tmp_path / "frame.png").write_bytes(data)
        assert (read_frame(tmp_path / "frame.png") == pixels).all()  # walks the chunks and their checksums
        assert (np.rint(matplotlib.image.imread(tmp_path / "frame.png") * 65535) == pixels).all()


def test_the_stream_is_that_of_zlib_and_its_lines_have_no_filter():
    pixels = np.arange(60, dtype=np.uint16).reshape(6, 10) * 999
    data = bytes(PngBuffer(6, 10).encode(pixels))
    begin = data.index(b"IDAT") + 4
    lines = zlib.decompress(data[begin : begin + int.from_bytes(data[begin - 8 : begin - 4], "big")])
    assert lines == b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)


def test_a_frame_of_another_size_is_refused():
    for shape in ((1, 10), (10,), (6, 1), (6, 11)):
        with pytest.raises(ValueError, match="a frame of"):
            PngBuffer(6, 10).encode(np.zeros(shape, dtype=np.uint16))
