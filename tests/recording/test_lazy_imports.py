"""Each format imports its own packages only, and those that only it needs may be missing."""

import subprocess
import sys
from pathlib import Path

import cv2
import tifffile
from format_frames import FRAMES

PACKAGES = {"pydicom", "tifffile", "nibabel", "nrrd", "metaimageio", "rosbags", "mcap", "gdcm", "matplotlib"}


def loaded_by(path: Path) -> set[str]:
    """Which of the packages an interpreter has imported when it has read a source."""
    program = (
        "import sys\nfrom pathlib import Path\n"
        "from scleraforce.recording.sources import ImportOptions, gather\n"
        f"scan = gather([Path({str(path)!r})], ImportOptions()).scan\n"
        "assert len(list(scan.pictures())) == len(scan.names)\n"
        f"print(*({PACKAGES!r} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_a_picture_needs_none_of_them_and_a_stack_its_own(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), FRAMES[0])
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    assert loaded_by(tmp_path / "a.png") == set()
    assert loaded_by(tmp_path / "a.tif") == {"tifffile"}
