"""NumPy's own files."""

from pathlib import Path

import numpy as np
import pytest
from format_frames import FRAMES, pictures_of

from scleraforce.errors import FrameError
from scleraforce.recording.images import read_numpy
from scleraforce.recording.scan import AXES, UnansweredError

REAL = Path(__file__).parents[3] / "shared" / "real-oct" / "needle-volumes"


def test_an_array_of_a_file_of_its_own_comes_back(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.asfortranarray(FRAMES))
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npy", AXES, None)), FRAMES)


def test_the_only_array_of_frames_is_found_and_others_are_asked_for(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", volume=FRAMES, pos=np.zeros(6))
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npz", AXES, None)), FRAMES)
    np.savez_compressed(tmp_path / "b.npz", first=FRAMES, second=FRAMES[::-1])
    with pytest.raises(UnansweredError, match=r"which array has the frames.*first, second; give --array"):
        read_numpy(tmp_path / "b.npz", AXES, None)
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "b.npz", AXES, "second")), FRAMES[::-1])
    with pytest.raises(FrameError, match="no array 'third'; there are first, second"):
        read_numpy(tmp_path / "b.npz", AXES, "third")


def test_pickled_objects_are_never_opened(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(FrameError, match=r"a\.npy: damaged or an unknown kind of NumPy file"):
        read_numpy(tmp_path / "a.npy", AXES, None)


@pytest.mark.parametrize("kind", [bool, np.complex64, [("re", "f4"), ("im", "f4")], "M8[s]"])
def test_arrays_of_no_grey_are_refused_before_their_axes_are_asked_for(tmp_path: Path, kind) -> None:
    np.save(tmp_path / "a.npy", np.zeros((5, 24, 40), kind))
    with pytest.raises(FrameError, match=r"a\.npy: pixels of type .*; give whole numbers or floats"):
        read_numpy(tmp_path / "a.npy", None, None)


@pytest.mark.parametrize("kind", [">u2", "<i4", ">f8", np.float16])
def test_either_byte_order_and_any_number_is_read(tmp_path: Path, kind) -> None:
    frames = (FRAMES % 2048).astype(kind, order="F")
    np.save(tmp_path / "a.npy", frames)
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npy", AXES, None)), FRAMES % 2048)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", FRAMES)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-10])
    with pytest.raises(FrameError, match="unknown kind of NumPy file"):
        read_numpy(tmp_path / "a.npy", AXES, None)


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-oct")
def test_a_real_volume_is_frames_along_its_last_axis() -> None:
    scan = read_numpy(sorted(REAL.glob("*.npz"))[0], ("depth", "lateral", "frame"), None)
    assert (len(scan.names), scan.rows, scan.columns) == (64, 512, 64)
