"""When frames were taken, as somebody states it beside them: in a table, or by their rate."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.formats.log_columns import columns_by_header
from scleraforce.formats.log_text import numbers_of, read_log_text
from scleraforce.recording.delimited import fields_of
from scleraforce.recording.scan import Scan, Times, even_times

FILE_NAMES = ("file", "filename", "frame", "image")


def told_times(scan: Scan, table: Path | None, rate_hz: float | None) -> Times | None:
    """Return the frames' times that a table or a rate states; None: neither was given.

    A table has a column of times with its unit in its name (time_s, "Time (ms)"). Where it names files too, each time
    goes to the frame of that name; else they go to the frames in their order.

    Raises:
        InputError: both were given, the rate is none, or the table does not go with the frames.
    """
    if table is not None and rate_hz is not None:
        raise InputError("--rate-hz: --times states when frames were taken; give one of them")
    if rate_hz is not None:
        if not 0.0 < rate_hz < float("inf"):
            raise InputError(f"--rate-hz: {rate_hz:g}; give the frames taken in a second")
        return even_times(len(scan.names), 1.0 / rate_hz, "option")
    return None if table is None else Times(_of_table(scan, table), str(table))


def _of_table(scan: Scan, table: Path) -> NDArray[np.float64]:
    text = read_log_text(table, least=1)
    column = next((found for found in columns_by_header(text.names, {}) if found.ours == "time_s"), None)
    if column is None:
        listed = ", ".join(repr(name) for name in text.names)
        raise InputError(f"{table}: no column of times with its unit, like time_s or Time (ms); there are {listed}")
    time_s = numbers_of(text, [text.names.index(column.name)])[:, 0] * column.factor
    file = next((nth for nth, name in enumerate(text.names) if name.lower() in FILE_NAMES), None)
    if file is not None:
        files = [Path(fields_of(line, text.separator, str(table))[file]).name for line in text.lines]
        by_name = dict(zip(files, time_s.tolist(), strict=True))
        frames = [Path(name).name for name in scan.names]
        if set(frames) <= set(by_name):
            return np.array([by_name[name] for name in frames])
    if len(time_s) != len(scan.names):
        raise InputError(f"{table}: {len(time_s)} times for {len(scan.names)} frames")
    return time_s
