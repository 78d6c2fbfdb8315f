"""OME-Zarr, versions 0.1 to 0.5, and single arrays of Zarr."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats import picture_streams
from scleraforce.recordings.formats.picture_streams import (
    METRES,
    SECONDS,
    PictureSource,
    PixelSize,
    array_scan,
)

AXES = "tczyx"  # of versions that name none
OTHER = {"c": "channels", "z": "slices"}
OME = "OME-Zarr"


def read_zarr(path: Path, axes: tuple[str, ...] | None) -> PictureSource:
    """Return the frames of an OME-Zarr store's finest level, rows (y) as depth, or of
    one array.
    """
    with picture_streams.named_faults(path, "Zarr"):
        store = zarr.open(path, mode="r")
        if isinstance(store, zarr.Array):
            picture_streams.check_bytes(store.nbytes)
            return array_scan(path, np.asarray(store[...]), axes)

        image = _image(store)
        multiscales = _multiscales(image)
        if not multiscales:
            names = ", ".join(sorted(image.array_keys())) or "no arrays"
            raise FrameError(
                f"a Zarr group without multiscales, so it is not {OME}; it has {names}:"
                " import one of its arrays by its folder"
            )

        level = multiscales[0]["datasets"][0]
        array = image[str(level["path"])]
        if not isinstance(array, zarr.Array):
            raise FrameError(f"multiscales: {level['path']} is not an array")
        return _frames(path, array, multiscales[0], level).of_file(path)


def _image(store: zarr.Group) -> zarr.Group:
    """Return the group of the only image, which bioformats2raw puts into "0"."""
    if _multiscales(store):
        return store

    series = [group for _, group in sorted(store.groups()) if _multiscales(group)]
    if len(series) > 1:
        names = ", ".join(group.basename for group in series)
        raise FrameError(f"{len(series)} images ({names}); import one by its folder")

    return series[0] if series else store


def _multiscales(group: zarr.Group) -> Sequence[Mapping[str, Any]]:
    found = dict(group.attrs)
    ome = found.get("ome", found)
    stated: Any = ome.get("multiscales", ()) if isinstance(ome, Mapping) else ()
    return list(stated)


def _frames(
    path: Path,
    array: zarr.Array[Any],
    image: Mapping[str, Any],
    level: Mapping[str, Any],
) -> PictureSource:
    stated = [
        {"name": axis} if isinstance(axis, str) else dict(axis)
        for axis in image.get("axes", ()) or AXES[-array.ndim :]
    ]
    names = [str(axis["name"]).lower() for axis in stated]
    if len(names) != array.ndim or names[-2:] != ["y", "x"]:
        raise FrameError(
            f"axes {', '.join(names)} of {array.ndim}; give frames whose last two are y"
            " (depth) and x (lateral)"
        )

    picture_streams.check_bytes(array.nbytes)
    steps = _steps(stated, image, level)
    long = [
        name
        for name, size in zip(names[:-2], array.shape[:-2], strict=True)
        if size > 1
    ]
    if len(long) > 1:
        sizes = ", ".join(f"{n} {s}" for n, s in zip(names, array.shape, strict=True))
        raise FrameError(
            f"axes {sizes}; save frames with one axis beside depth (y) and width (x)"
        )

    count = int(np.prod(array.shape[:-2], dtype=np.int64))
    rows, columns = array.shape[-2:]
    picture_streams.check_image_size(rows, columns)
    kind = OTHER.get(long[0]) if long else None
    step_s = steps.get("t", 0.0) if long == ["t"] else 0.0
    size = PixelSize(OME, depth_m=steps.get("y"), lateral_m=steps.get("x"))

    def pictures() -> Iterator[Any]:
        for place in np.ndindex(array.shape[:-2]):
            yield np.asarray(array[place])

    scan = PictureSource(
        picture_streams.frame_names(path, count),
        rows,
        columns,
        pictures,
        bits=8 if array.dtype == np.uint8 else None,
        size=size,
        times=picture_streams.even_times(count, step_s, OME),
    )
    words = f"{OME} states {count} {kind} ({long[0]})" if kind else None

    return replace(scan, one_moment=words)


def _steps(
    axes: Sequence[Mapping[str, Any]],
    image: Mapping[str, Any],
    level: Mapping[str, Any],
) -> dict[str, float]:
    """Return the steps along axes whose unit is stated, m or s."""
    scale = np.ones(len(axes))
    stated = False
    for transformations in (
        level.get("coordinateTransformations"),
        image.get("coordinateTransformations"),
    ):
        for each in transformations or ():
            if each.get("type") == "scale":
                scale = scale * np.asarray(each["scale"], dtype=np.float64)
                stated = True

    found = {}
    for axis, step in zip(axes, scale.tolist(), strict=True):
        unit = str(axis.get("unit", ""))
        units = SECONDS if axis.get("type") == "time" else METRES
        size = units.get(unit, units.get(f"{unit}s"))
        if stated and size is not None and step > 0.0:
            found[str(axis["name"]).lower()] = step * size

    return found
