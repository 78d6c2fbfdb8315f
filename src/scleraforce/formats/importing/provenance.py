"""What import.json says of a recording: its sources with their SHA-256, who states each value, and the answers."""

from dataclasses import asdict
from hashlib import file_digest
from pathlib import Path
from typing import Any

from scleraforce.formats.answers import import_record
from scleraforce.formats.greys import Greys
from scleraforce.formats.importing.complete import Complete
from scleraforce.formats.importing.told import ImportAnswers


def record_text(done: Complete, greys: Greys, answers: ImportAnswers, version: str) -> str:
    """Return the text of import.json."""
    columns = [column.answer() for column in done.gathered.columns]
    files = [{"path": str(path), "kind": kind, "sha256": _sha256(path)} for path, kind in done.gathered.files]
    told = {"version": version, "files": files, **provenance(done, greys)}
    return import_record(asdict(answers) | {"columns": columns}, told)


def provenance(done: Complete, greys: Greys) -> dict[str, Any]:
    """Return where values, times and counts come from."""
    return {
        "values": done.sources,
        "clock_origin_s": done.origin_s,
        "columns": [column.answer() for column in done.gathered.columns],
        "grey": {"low": greys.low, "high": greys.high, "scaled": greys.scaled, "not_finite": greys.lost},
        "notes": list(done.gathered.notes),
    }


def _sha256(path: Path) -> str | None:
    """Return the hash of a file; None of a folder."""
    if path.is_dir():
        return None
    with path.open("rb") as file:
        return file_digest(file, "sha256").hexdigest()
