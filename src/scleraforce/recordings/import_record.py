"""The file import.json, which says where the values of an imported recording are from.

`import_answers.record_text` writes it.
"""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from scleraforce.base.errors import RecordingError, StudyError
from scleraforce.base.whole_files import FileKind, read_text
from scleraforce.recordings.frame_and_force_tables import LARGEST_TIME_S
from scleraforce.records.decoder import parse_json_record
from scleraforce.records.fields import computed, option
from scleraforce.records.remark import Remark

IMPORT_RECORD = "import.json"
RECORD_KIND = FileKind(
    IMPORT_RECORD, 2**20, "`scleraforce import` writes it", RecordingError
)


@dataclass(frozen=True, kw_only=True)
class KeptAnswers:
    """Answers of an import on the form of its sources, by the names of
    `ImportOptions`, which other imports of the laboratory may take; None, () and False:
    not answered.
    """

    axes: str | None = None
    flip: str | None = option(None, "rows", "columns")
    array: str | None = None
    columns: tuple[str, ...] = ()
    image_topic: str | None = None
    force_topic: str | None = None
    by_arrival: bool = False
    grey_range: tuple[float, float] | None = None
    frames_by: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return those that were answered."""
        answers = {item.name: getattr(self, item.name) for item in fields(self)}
        return {name: answer for name, answer in answers.items() if answer}


@dataclass(frozen=True, kw_only=True)
class ImportRecord:
    """What is read of import.json: answers that other imports may take, the beginning
    of the recording's clock on that of the sources, s, and remarks.

    `notes` are the sentences of the remarks, all that earlier versions wrote.
    """

    answers: KeptAnswers = field(default_factory=KeptAnswers)
    clock_origin_s: float = computed(-LARGEST_TIME_S, LARGEST_TIME_S, default=0.0)
    notes: tuple[str, ...] = ()
    remarks: tuple[Remark, ...] | None = None

    @property
    def all_remarks(self) -> tuple[Remark, ...]:
        """The remarks, of earlier versions their sentences under one code."""
        if self.remarks is not None:
            return self.remarks
        return tuple(Remark("earlier-version", words) for words in self.notes)


def read_import_record(recording: Path) -> ImportRecord:
    """Read a recording's import.json; without one, nothing is known. Raises
    `RecordingError`.
    """
    path = recording / IMPORT_RECORD
    if not path.exists():
        return ImportRecord()

    try:
        return parse_json_record(ImportRecord, read_text(path, RECORD_KIND), str(path))
    except StudyError as fault:
        raise RecordingError(f"{fault}; `scleraforce import` writes it") from fault
