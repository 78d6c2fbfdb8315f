"""What the app and the worker process of a job send each other.

The app sends a job and its `CommandWords`; the worker answers with progress and notes,
and at the end with the result or the fault. A worker that ends without either was
stopped, or died.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scleraforce.base.notebook_cards import Row
from scleraforce.recordings.import_sources import ImportOptions
from scleraforce.records.scan import Plane


@dataclass(frozen=True, kw_only=True)
class ImportJob:
    """An import of sources into the recording `out`.

    Of several `planes` there is one for each source, None for a force log. Paths of
    this job and the others are relative to the app's folder, in which the worker runs.
    """

    sources: tuple[str, ...]
    out: str
    options: ImportOptions
    planes: tuple[Plane | None, ...] = ()


@dataclass(frozen=True, kw_only=True)
class CalibrateJob:
    """A calibration on recordings, written to `out`; the options are those of the
    command, None: not given.
    """

    recordings: tuple[str, ...]
    out: str
    frames: int | None = None
    without_force: bool = False
    parameters: tuple[str, ...] | None = None
    thickness_um: float | None = None
    calibration: str | None = None


@dataclass(frozen=True, kw_only=True)
class EvaluateJob:
    """The reading of recordings by a model; None: no calibration, or no page `html`."""

    model: str
    recordings: tuple[str, ...]
    calibration: str | None = None
    html: str | None = None


Job = ImportJob | CalibrateJob | EvaluateJob


@dataclass(frozen=True)
class Progressed:
    """`done` of `total` steps of a part of the work."""

    title: str
    done: int
    total: int


@dataclass(frozen=True)
class Noted:
    """A sentence on the work, while it runs."""

    words: str


@dataclass(frozen=True)
class Finished:
    """The result, as the command prints it as JSON; of an evaluation also its rows."""

    result: Mapping[str, Any]
    rows: tuple[Row, ...] = ()


@dataclass(frozen=True)
class Failed:
    """Why there is no result, in a line that names fields."""

    words: str


FromWorker = Progressed | Noted | Finished | Failed
