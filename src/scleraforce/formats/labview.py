"""LabVIEW measurement files (.lvm): their header, by National Instruments' specification of the format."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scleraforce.errors import RecordingError

MARK = "LabVIEW Measurement"
END = "***End_of_Header***"
SEPARATORS = {"tab": "\t", "comma": ","}


@dataclass(frozen=True)
class LabviewHeader:
    """What the header of a LabVIEW measurement file states.

    Attributes:
        separator: of its columns.
        mark: the decimal mark.
        units: of its channels, in their order; may be empty.
        after: the index of the line after the header, which has the columns' names.
    """

    separator: str
    mark: str
    units: tuple[str, ...]
    after: int


def read_labview_header(path: Path, lines: Sequence[str]) -> LabviewHeader:
    """Read the header of a LabVIEW measurement file with one segment and one column of times.

    Raises:
        RecordingError: the header does not end, or states what is not read; naming the field.
    """
    ends = [index for index, line in enumerate(lines) if line.strip().strip(",") == END]
    if not ends:
        raise RecordingError(f"{path}: a LabVIEW measurement file without {END}")
    head = lines[: ends[0]]
    stated = next((line.removeprefix("Separator").strip() for line in head if line.startswith("Separator")), "Tab")
    separator = SEPARATORS.get(stated.strip(",").lower())
    if separator is None:
        raise RecordingError(f"{path}: Separator: {stated!r} is not read; export the file with Tab or Comma")
    told = _entries(head, separator)
    segments = ends[1:]
    if len(segments) > 1:
        raise RecordingError(
            f"{path}:{segments[1] + 1}: a second segment (Multi_Headings): its times begin anew; export each segment "
            "as a file of its own"
        )
    segment = _entries(lines[ends[0] + 1 : segments[0]], separator) if segments else {}
    columns = told.get("X_Columns", ("One",))[0].lower()
    channels = segment.get("Channels", ("1",))[0]
    if columns == "no" or (columns == "multi" and channels != "1"):
        raise RecordingError(
            f"{path}: X_Columns: {told['X_Columns'][0]} is not read; export the file with one column of times"
        )
    dimension = next((each for each in segment.get("X_Dimension", ()) if each), "Time")
    if dimension.lower() != "time":
        raise RecordingError(f"{path}: X_Dimension: {dimension!r}; the first column of a force log is the time")
    mark = told.get("Decimal_Separator", (".",))[0]
    if mark not in (".", ","):
        raise RecordingError(f"{path}: Decimal_Separator: {mark!r} is neither a point nor a comma")
    return LabviewHeader(separator, mark, segment.get("Y_Unit_Label", ()), (segments or ends)[-1] + 1)


def _entries(lines: Sequence[str], separator: str) -> dict[str, tuple[str, ...]]:
    """Return the values of each named line."""
    fields = [[field.strip() for field in line.split(separator)] for line in lines if line.strip()]
    return {name: tuple(values) or ("",) for name, *values in fields}
