"""OME-XML in a TIFF: the size of a pixel and the times of planes that it states."""

from math import isfinite
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from scleraforce.recording.scan import METRES, SECONDS, PixelSize, Times, even_times, rising


def _ome_pixels(xml: str) -> list[dict[str, str]]:
    """Return the attributes of all elements `Pixels`, whatever their name space."""
    return [element.attrib for element in ElementTree.fromstring(xml).iter() if _local(element) == "Pixels"]


def _local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def ome_sizes(path: Path, xml: str, notes: list[str]) -> list[PixelSize]:
    """Return the physical sizes of a pixel that OME-XML states; their unit is the micrometre where it names none."""
    found = []
    for stated in _ome_pixels(xml):
        units = {stated.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XY"} - set(METRES)
        notes += [f"{path}: OME's unit {unit!r} is not known: the scale is not either" for unit in sorted(units)]
        found.append(PixelSize("OME", depth_m=_ome_size(stated, "Y"), lateral_m=_ome_size(stated, "X")))
    return found


def _ome_size(stated: dict[str, str], axis: str) -> float | None:
    unit_m = METRES.get(stated.get(f"PhysicalSize{axis}Unit", "µm"))
    size = float(stated.get(f"PhysicalSize{axis}", "nan"))
    return size * unit_m if unit_m and isfinite(size) and size > 0.0 else None


def ome_times(xml: str, count: int) -> Times | None:
    """Return the times of planes, else even ones by the increment of time; None where neither is stated."""
    planes = [element.attrib for element in ElementTree.fromstring(xml).iter() if _local(element) == "Plane"]
    if len(planes) == count and all("DeltaT" in plane for plane in planes):
        units_s = [SECONDS.get(plane.get("DeltaTUnit", "s")) for plane in planes]
        if None not in units_s:
            time_s = np.array([float(plane["DeltaT"]) for plane in planes]) * np.array(units_s, dtype=np.float64)
            return Times(time_s, "OME's DeltaT") if rising(time_s) else None
    stated = next(iter(_ome_pixels(xml)), {})
    unit_s = SECONDS.get(stated.get("TimeIncrementUnit", "s"))
    return even_times(count, float(stated.get("TimeIncrement", "0")) * (unit_s or 0.0), "OME's TimeIncrement")
