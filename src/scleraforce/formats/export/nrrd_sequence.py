"""Frames as a volume sequence of 3D Slicer (.seq.nrrd): one slice for each time, in mm.

The layout is that of Slicer's developer guide ("Sequences"): axes I, J, K and a list, whose index values are times.
"""

from pathlib import Path

import numpy as np

from scleraforce.formats.extra import package_for
from scleraforce.recording.files import Recording
from scleraforce.recording.scan import check_bytes
from scleraforce.units import from_si
from scleraforce.whole_files import renamed_when_whole

SLICE_MM = 0.1  # as thick as a B-scan is drawn; it has no thickness of its own
NOWHERE = [np.nan] * 3


def write_sequence(recording: Recording, path: Path) -> None:
    """Write a recording's frames; lateral runs to the patient's left, depth to the back.

    Raises:
        InputError: pynrrd is not installed, the frames take too much memory, or the file cannot be written.
    """
    nrrd = package_for(path, "nrrd", "NRRD")
    oct_info = recording.info.oct
    check_bytes(path, len(recording.frames) * oct_info.rows * oct_info.columns * 2)
    shape = (oct_info.columns, oct_info.rows, 1, len(recording.frames))
    volume = np.empty(shape, dtype=np.uint16, order="F")
    for nth, entry in enumerate(recording.frames):
        volume[:, :, 0, nth] = recording.frame(entry).T
    lateral_mm = from_si(oct_info.width_m / oct_info.columns, "mm")
    depth_mm = from_si(oct_info.depth_m / oct_info.rows, "mm")
    header = {
        "space": "left-posterior-superior",
        "space directions": np.array([[lateral_mm, 0, 0], [0, depth_mm, 0], [0, 0, SLICE_MM], NOWHERE]),
        "space units": ["mm", "mm", "mm"],
        "space origin": np.zeros(3),
        "kinds": ["domain", "domain", "domain", "list"],
        "labels": ["lateral", "depth", "", "time"],
        "units": ["", "", "", "s"],
        "encoding": "raw",
        "axis 3 index type": "numeric",
        "axis 3 index values": " ".join(f"{entry.time_s:.6f}" for entry in recording.frames),
        "DataNodeClassName": "vtkMRMLScalarVolumeNode",
    }
    with renamed_when_whole(path) as part, part.open("wb") as file:
        nrrd.write(file, volume, header, index_order="F")
