"""The file import.json, which says where the values of an imported recording are from.

`import_answers.record_text` writes it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scleraforce.base.errors import RecordingError, StudyError
from scleraforce.base.whole_files import FileKind, read_text
from scleraforce.recordings.frame_and_force_tables import LARGEST_TIME_S
from scleraforce.records.decoder import parse_json_record
from scleraforce.records.fields import computed
from scleraforce.records.remark import Remark

IMPORT_RECORD = "import.json"
RECORD_KIND = FileKind(
    IMPORT_RECORD, 2**20, "`scleraforce import` writes it", RecordingError
)


@dataclass(frozen=True, kw_only=True)
class ImportRecord:
    """What is read of import.json: answers that other imports may take, the beginning
    of the recording's clock on that of the sources, s, and remarks.

    `notes` are the sentences of the remarks, all that earlier versions wrote.
    """

    answers: Mapping[str, Any] = field(default_factory=dict)
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
