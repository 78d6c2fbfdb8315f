"""Files before their import: what they state, what is missing, their pictures, force
log, and a clock offset.
"""

from collections.abc import Sequence
from dataclasses import fields
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from scleraforce.app.looks import curve, png
from scleraforce.app.request_end import check_wanted
from scleraforce.arrays import Floats
from scleraforce.errors import FrameError, InputError
from scleraforce.plain_json import finite
from scleraforce.recording.folder import Plane
from scleraforce.recording.importing import given_times, open_questions
from scleraforce.recording.labels import low_pass
from scleraforce.recording.pixels import (
    PictureStream,
    PixelScale,
    Scan,
    UnansweredError,
    find_greys,
    one_grey,
)
from scleraforce.recording.sources import OPTION, Gathered, ImportOptions, gather
from scleraforce.segmentation.observations import MIDDLE_M, surface
from scleraforce.segmentation.wall import find_wall
from scleraforce.units import from_si, to_si

ANSWERS = {field.name for field in fields(ImportOptions)} - {"columns", "grey_range"}
# The options of an import, their names and types checked.
Checked: Any = dataclass(
    ImportOptions, frozen=True, config=ConfigDict(strict=True, extra="forbid")
)
GATHERED = (
    "axes",
    "array",
    "columns",
    "image_topic",
    "force_topic",
    "by_arrival",
    "first_frame",
    "last_frame",
)
SEEN_FRAMES = 100  # of a long recording, for the curve of the dent
LEAST_SHARE = 0.75  # of the frames that must lie on the log under an offset
LEAST_FRAMES = 6
STEP_S = 0.05
OFFSETS = (4000, 20000)  # fewest and most that are tried
AS_GOOD = 0.01  # less correlation than the best one


def proposed_offset_s(
    frame_s: Floats, dent_m: Floats, log_s: Floats, force_n: Floats
) -> tuple[float, float] | None:
    """Return the log's clock minus the frames' clock at which force and dent correlate
    best, and the correlation.

    Args:
        frame_s: times of the frames on their own clock.
        dent_m: depth of the surface in each, NaN where it is not seen.
        log_s: times of the log, rising.
        force_n: contact force, of one sign.
    """
    seen = np.isfinite(dent_m)
    frame_s = frame_s[seen]
    dent_m = dent_m[seen]
    if len(frame_s) < LEAST_FRAMES or not len(log_s):
        return None

    first_s = log_s[0] - frame_s[-1]
    last_s = log_s[-1] - frame_s[0]
    offsets_s = np.linspace(
        first_s, last_s, int(np.clip((last_s - first_s) / STEP_S, *OFFSETS))
    )

    fits = np.array(
        [
            _correlation(frame_s + offset_s, dent_m, log_s, force_n)
            for offset_s in offsets_s.tolist()
        ]
    )
    if np.isnan(fits).all():
        return None

    best = int(np.nanargmax(np.abs(fits)))
    # Frames taken while the needle rests fit as well a little earlier or later: the
    # middle of these.
    worse = np.flatnonzero(~(np.abs(fits) > abs(fits[best]) - AS_GOOD))
    at = np.searchsorted(worse, best)
    first = worse[at - 1] + 1 if at else 0
    last = worse[at] - 1 if at < len(worse) else len(offsets_s) - 1

    return float(offsets_s[first] + offsets_s[last]) / 2, float(fits[best])


def _correlation(
    time_s: Floats, dent_m: Floats, log_s: Floats, force_n: Floats
) -> float:
    on = (time_s >= log_s[0]) & (time_s <= log_s[-1])
    if on.sum() < max(LEAST_FRAMES, LEAST_SHARE * len(on)):
        return float("nan")

    force = np.interp(time_s[on], log_s, force_n)
    if np.ptp(force) == 0.0 or np.ptp(dent_m[on]) == 0.0:
        return float("nan")

    return float(np.corrcoef(force, dent_m[on])[0, 1])


Planes = Sequence[Plane | None]  # one for each source


class Sources:
    """The sources that the page looks at, as `import` would read them."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._asked = ""
        self._gathered: Gathered | None = None

    def gathered(
        self, paths: Sequence[Path], planes: Planes, answers: ImportOptions
    ) -> Gathered:
        """Return the frames and the log, read again only if sources or the answers
        about them have changed.
        """
        stamps = [(path, path.stat().st_mtime_ns) for path in paths]
        asked = repr((stamps, planes, [getattr(answers, name) for name in GATHERED]))

        with self._lock:
            check_wanted()
            if self._gathered is None or self._asked != asked:
                self._gathered = gather(
                    paths, answers, lambda _: check_wanted(), planes
                )
                self._asked = asked
            return self._gathered

    def look(
        self, paths: Sequence[Path], planes: Planes, answers: ImportOptions
    ) -> dict[str, Any]:
        """Return what sources state and what is missing; or a single question that has
        to be answered first.
        """
        try:
            found = self.gathered(paths, planes, answers)
            scan = found.scan
            log = found.log
            greys = find_greys(
                islice(scan.pictures(), 1), answers.grey_range, scan.names[0]
            )
            given = {
                name: OPTION
                for name in ANSWERS
                if getattr(answers, name) not in (None, False)
            }
            stated, missing = open_questions(found, greys, answers, given)
        except UnansweredError as fault:
            return {
                "question": fault.question,
                "option": fault.option,
                "forms": list(fault.forms),
            }

        axes = (
            []
            if log is None
            else [
                name.removesuffix("_n") for name in log.columns if name.endswith("_n")
            ]
        )
        stated_now: dict[str, Any] = finite(
            {
                "frames": len(scan.names),
                "rows": scan.rows,
                "columns": scan.columns,
                "stated": {
                    name: {"value": value, "source": source}
                    for name, (value, source) in stated.items()
                },
                "missing": {
                    name: question.words
                    for name, question in missing.items()
                    if not question.optional
                },
                "log": {
                    axis: curve(log.time_s, from_si(log.force_n(axis), "mn"))
                    for axis in axes
                    if log is not None
                },
                "notes": list(found.notes),
            }
        )

        return stated_now

    def picture(
        self, paths: Sequence[Path], planes: Planes, answers: ImportOptions, number: int
    ) -> bytes:
        """Return a frame as a PNG."""
        scan = self.gathered(paths, planes, answers).scan
        for picture in islice(_while_wanted(scan), max(number, 0), None):
            return png(one_grey(picture))
        raise InputError(f"frame {number + 1}: there are {len(scan.names)}")

    def clocks(
        self, paths: Sequence[Path], planes: Planes, answers: ImportOptions
    ) -> dict[str, Any]:
        """Return the surface's depth under the needle over time, and the offset at
        which it fits the log best.
        """
        found = self.gathered(paths, planes, answers)
        times = (
            given_times(found.scan, answers.times, answers.rate_hz) or found.scan.times
        )

        width_m, depth_m = (
            to_si(size, "mm") for size in (answers.width_mm, answers.depth_mm)
        )
        if (
            times is None
            or found.log is None
            or width_m is None
            or depth_m is None
            or min(width_m, depth_m) <= 0.0
        ):
            raise InputError(
                "clocks: give the frames' size and rate first, and a force log"
            )

        scan = found.scan
        axis = answers.axis or found.log.columns[0].removesuffix("_n")
        if f"{axis}_n" not in found.log.columns:
            raise InputError(
                f"--axis: {axis} is not in the force log, which has"
                f" {', '.join(found.log.columns)}"
            )

        scale = PixelScale(
            lateral_m=width_m / scan.columns,
            depth_m=depth_m / scan.rows,
            refractive_index=answers.refractive_index or 1.0,
        )
        shown = np.unique(
            np.linspace(0, len(scan.names) - 1, SEEN_FRAMES).astype(np.intp)
        )
        chosen = set(shown.tolist())
        dent_m = np.array(
            [
                _surface_m(picture, scan.names[number], scale)
                for number, picture in enumerate(_while_wanted(scan))
                if number in chosen
            ]
        )
        log = found.log.known(axis)
        force_n = float(answers.contact_sign or 1) * low_pass(
            log.force_n(axis), log.time_s
        )
        offset = proposed_offset_s(times.time_s[shown], dent_m, log.time_s, force_n)
        curves: dict[str, Any] = finite(
            {
                "time_s": times.time_s[shown].tolist(),
                "dent_mm": from_si(dent_m, "mm").tolist(),
                "offset_s": None if offset is None else offset[0],
                "correlation": None if offset is None else offset[1],
            }
        )

        return curves


def _while_wanted(scan: Scan) -> PictureStream:
    """Yield the pictures of a scan until the request has ended."""
    for picture in scan.pictures():
        check_wanted()
        yield picture


def _surface_m(picture: NDArray[Any], name: str, scale: PixelScale) -> float:
    """Return how deep the surface lies in the middle below its mean, m; NaN where it is
    not seen.
    """
    picture = one_grey(picture)
    try:
        wall = find_wall(find_greys([picture], None, name).counts(picture), scale)
    except (FrameError, ValueError):  # an empty, damaged or tiny frame
        return float("nan")

    lateral_m, depth_m = surface(wall, scale)
    middle = (np.abs(lateral_m) < MIDDLE_M) & np.isfinite(depth_m)
    return (
        float(depth_m[middle].max() - np.nanmean(depth_m))
        if wall.usable and middle.any()
        else float("nan")
    )
