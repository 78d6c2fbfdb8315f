"""The folder that the app works in: its recordings, calibrations and sources, and paths that stay inside."""

import secrets
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scleraforce.errors import InputError
from scleraforce.known.calibration_file import read_calibration
from scleraforce.models import RECORD_FILE
from scleraforce.recording.folder import read_info
from scleraforce.recording.sources import source_kind

SOURCES = "sources"  # what was dropped onto the page
MOST_UPLOAD_BYTES = 16 * 2**30
LEFT_BYTES = 2**30  # of the disk, after an upload


@dataclass(frozen=True)
class Folder:
    """A folder, resolved; every name from the page is looked up with `inside`."""

    root: Path

    def inside(self, name: str) -> Path:
        """Return the path of a name; raises `InputError` if it leads out of the folder, by links too."""
        path = self.root / name
        try:
            fits = bool(name) and path.resolve().is_relative_to(self.root)
        except (OSError, ValueError, RuntimeError) as fault:  # too long, a null character, links that go round
            raise InputError(f"{name[:80]!r}: {fault}") from fault
        if not fits:
            raise InputError(f"{name}: leads out of {self.root}")
        return path

    def new(self, name: str) -> Path:
        """Return the path of a new file or folder, by a plain name."""
        if not name or Path(name).name != name or name.startswith("."):
            raise InputError(f"{name!r}: give a plain name")
        path = self.inside(name)
        if path.exists() or path.is_symlink():
            raise InputError(f"{name}: exists already; choose another name")
        return path

    def contents(self) -> dict[str, Any]:
        """Return recordings with their eyes, calibrations with theirs, models, and sources with kind or fault."""
        found: dict[str, list[dict[str, Any]]] = {"recordings": [], "calibrations": [], "models": [], "sources": []}
        dropped = self.root / SOURCES
        for path in sorted([*self.root.iterdir(), *(dropped.iterdir() if dropped.is_dir() else [])]):
            name = str(path.relative_to(self.root))
            if path.name.startswith(".") or path == dropped or not path.resolve().is_relative_to(self.root):
                continue
            kind, entry = _entry(path)
            if kind:
                found[kind].append({"name": name, **entry})
        return {"folder": self.root.name, **found}

    async def upload(self, name: str, size: int, chunks: AsyncIterator[bytes]) -> None:
        """Write a dropped file as it arrives, whole or not at all; one of that name is never replaced."""
        if not 0 < size <= MOST_UPLOAD_BYTES:
            raise InputError(f"{name}: {size} bytes; a file may have 1 to {MOST_UPLOAD_BYTES}")
        if shutil.disk_usage(self.root).free - size < LEFT_BYTES:
            raise InputError(f"{name}: the disk is too full for {size} bytes")
        sources = Folder(self.root / SOURCES)
        self.inside(SOURCES).mkdir(exist_ok=True)
        path = sources.new(name)
        part = sources.root / f".scleraforce-{secrets.token_hex(8)}.part"
        try:
            with part.open("xb") as file:
                left = size
                async for chunk in chunks:
                    left -= len(chunk)
                    if left < 0:
                        raise InputError(f"{name}: more bytes than were announced")
                    file.write(chunk)
            if left:
                raise InputError(f"{name}: ended {left} bytes before its end; drop it again")
            path.hardlink_to(part)  # fails where a file of that name has come meanwhile
        except FileExistsError as fault:
            raise InputError(f"{name}: exists already; choose another name") from fault
        finally:
            part.unlink(missing_ok=True)


def _entry(path: Path) -> tuple[str, dict[str, Any]]:
    """Return the list of `Folder.contents` that a path is in, "" for none, and what is said of it there."""
    try:
        if (path / "recording.toml").is_file():
            return "recordings", {"eye": read_info(path / "recording.toml").eye.id}
        if (path / RECORD_FILE).is_file():
            return "models", {}
        if path.suffix == ".json":
            return "calibrations", {"eyes": sorted(read_calibration(path).eyes)}
        if path.is_file():
            return "sources", {"kind": source_kind(path)}
    except InputError as fault:
        return ("", {}) if path.suffix == ".json" else ("sources", {"fault": str(fault)})
    return "", {}
