"""Files before their import: what they state, what is missing, their pictures, force
log, and a clock offset.
"""

from collections.abc import Sequence
from dataclasses import asdict, fields
from functools import lru_cache
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from scleraforce.base.errors import FrameError, InputError
from scleraforce.base.plain_json import finite_json
from scleraforce.base.units import from_si, to_si
from scleraforce.front.api.importing import picture_dents
from scleraforce.front.app.recording_views import png, thinned_curve
from scleraforce.front.app.request_end import check_wanted
from scleraforce.recordings.clock_offsets import estimate_clocks
from scleraforce.recordings.forces_under_frames import low_pass
from scleraforce.recordings.formats.picture_streams import (
    PictureSource,
    PictureStream,
    UnansweredError,
    find_greys,
    one_grey,
)
from scleraforce.recordings.import_answers import given_times, open_questions
from scleraforce.recordings.import_sources import (
    OPTION,
    GatheredSources,
    ImportOptions,
    gather_sources,
)
from scleraforce.recordings.log_tables import (
    QUANTITY_OF,
    UNITS,
    LogTable,
    first_log,
    read_log_table,
)
from scleraforce.records.scan import PixelScale, Plane

ANSWERS = {field.name for field in fields(ImportOptions)} - {"columns", "grey_range"}
# The options of an import, their names and types checked.
Checked: Any = dataclass(
    ImportOptions, frozen=True, config=ConfigDict(strict=True, extra="forbid")
)
GATHERED = (
    "axes",
    "flip",
    "array",
    "columns",
    "image_topic",
    "force_topic",
    "by_arrival",
    "first_frame",
    "last_frame",
    "rate_hz",
    "times",
    "frames_by",
)
TABLES = 4  # of logs, kept in memory
SEEN_FRAMES = 100  # of a long recording, for the curve of the dent


def given_answers(answers: ImportOptions) -> list[str]:
    """Return the names of the options that are given, of an offset of 0, too.

    >>> given_answers(ImportOptions(clock_offset_s=0, eye="mine"))
    ['clock_offset_s', 'eye']
    """
    values = {field.name: getattr(answers, field.name) for field in fields(answers)}
    return [
        name
        for name, value in values.items()
        if value is not None and value is not False and value != ()
    ]


Planes = Sequence[Plane | None]  # one for each source


class Sources:
    """The sources that the page looks at, as `import` would read them."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._asked = ""
        self._gathered: GatheredSources | None = None

    def gathered(
        self, paths: Sequence[Path], planes: Planes, answers: ImportOptions
    ) -> GatheredSources:
        """Return the frames and the log, read again only if sources or the answers
        about them have changed.
        """
        tables = [] if answers.times is None else [answers.times]
        stamps = [(path, path.stat().st_mtime_ns) for path in (*paths, *tables)]
        asked = repr((stamps, planes, [getattr(answers, name) for name in GATHERED]))

        with self._lock:
            check_wanted()
            if self._gathered is None or self._asked != asked:
                self._gathered = gather_sources(
                    paths, answers, lambda _: check_wanted(), planes
                )
                self._asked = asked
            return self._gathered

    def describe(
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
            given = dict.fromkeys(given_answers(answers), OPTION)
            stated, missing = open_questions(found, greys, answers, given)
        except UnansweredError as fault:
            return {
                "question": fault.question,
                "field": fault.field,
                "forms": list(fault.forms),
                "table": _log_table(paths),
            }

        axes = (
            []
            if log is None
            else [
                name.removesuffix("_n") for name in log.columns if name.endswith("_n")
            ]
        )
        stated_now: dict[str, Any] = finite_json(
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
                    axis: thinned_curve(log.time_s, from_si(log.force_n(axis), "mn"))
                    for axis in axes
                    if log is not None
                },
                "table": _log_table(paths),
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
                f"`axis`: {axis} is not in the force log, which has"
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
        dents = np.array(
            [
                _dents(picture, scan.names[number], scale)
                for number, picture in enumerate(_while_wanted(scan))
                if number in chosen
            ]
        ).T
        log = found.log.known(axis)
        force_n = low_pass(log.force_n(axis), log.time_s)
        sign = answers.contact_sign
        signs = (1, -1) if sign is None else (int(sign),)
        estimates = {
            each: estimate_clocks(
                times.time_s[shown], dents, log.time_s, each * force_n
            )
            for each in signs
        }
        sign, offset = max(
            estimates.items(), key=lambda item: item[1].likelihood if item[1] else -1.0
        )
        curves: dict[str, Any] = finite_json(
            {
                "time_s": times.time_s[shown].tolist(),
                "dent_mm": from_si(dents[0], "mm").tolist(),
                "offset_s": None if offset is None else offset.offset_s,
                "sure": offset is not None and offset.sure,
                "words": None if offset is None else offset.words,
                "contact_sign": str(sign),
            }
        )

        return curves


def _log_table(sources: Sequence[Path]) -> dict[str, Any] | None:
    """Return the columns of the first force log of text, how its header is read, and
    the units to choose from; None without one.
    """
    try:
        log = first_log(sources)
        if log is None:
            return None
        table = _read_table(log, log.stat().st_mtime_ns)
    except InputError:  # which `describe` reports
        return None

    return {
        "columns": [asdict(column) for column in table.columns],
        "read": {
            column.short: {"name": column.name, "unit": column.unit}
            for column in table.read
        },
        "units": {short: UNITS[quantity] for short, quantity in QUANTITY_OF.items()},
    }


@lru_cache(TABLES)
def _read_table(path: Path, _: int) -> LogTable:
    return read_log_table(path)


def _while_wanted(scan: PictureSource) -> PictureStream:
    """Yield the pictures of a scan until the request has ended."""
    for picture in scan.pictures():
        check_wanted()
        yield picture


def _dents(picture: NDArray[Any], name: str, scale: PixelScale) -> tuple[float, float]:
    """Return measures of the dent in a frame, m; NaN where it is not seen."""
    picture = one_grey(picture)
    try:
        counts = find_greys([picture], None, name).counts(picture)
    except (FrameError, ValueError):  # an empty or damaged frame
        return float("nan"), float("nan")
    return picture_dents(counts, scale)
