"""The folder that the app works in: its recordings, calibrations and sources, and paths
that stay inside.
"""

import os
import secrets
import shutil
from collections.abc import AsyncIterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePath
from typing import Any

from scleraforce.base.errors import InputError
from scleraforce.front.app.request_end import check_wanted
from scleraforce.recordings.import_sources import source_kind
from scleraforce.recordings.log_tables import holds_times
from scleraforce.recordings.recording_folder import read_info
from scleraforce.recordings.source_files import files_of
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.model_folder import RECORD_FILE

TIMES = "times"  # a kind of source that is none: it states when frames were taken
SOURCES = "sources"  # files dropped onto the page
MOST_ENTRIES = 65536  # that are not read again while they are unchanged
# of a recording
PARTS = ("recording.toml", "frames.csv", "forces.csv", "walls.csv", "import.json")
MOST_UPLOAD_BYTES = 16 * 2**30
LEFT_BYTES = 2**30  # of the disk, after an upload


@dataclass(frozen=True)
class Folder:
    """A folder, resolved; every name from the page is looked up with `inside`."""

    root: Path

    def inside(self, name: str) -> Path:
        """Return the path of a name; raises `InputError` if it leads out of the folder,
        by links too.
        """
        path = self.root / name
        try:
            fits = bool(name) and path.resolve().is_relative_to(self.root)
        except (
            OSError,
            ValueError,
            RuntimeError,
        ) as fault:  # too long, a null character, links that go round
            raise InputError(f"{name[:80]!r}: {fault}") from fault

        if not fits:
            raise InputError(f"{name}: leads out of {self.root}")

        return path

    def whole(self, name: str) -> Path:
        """Return the path of a file or folder; raises `InputError` if it, or a link
        below it, leads out.
        """
        path = self.inside(name)
        for place, folders, files in os.walk(path):
            check_wanted()
            for each in (Path(place, entry) for entry in [*folders, *files]):
                if each.is_symlink():
                    self.inside(str(each.relative_to(self.root)))
        return path

    def shortened(self, found: Any) -> Any:
        """Return JSON with the names of files in its texts as the page has them."""
        if isinstance(found, str):
            return found.replace(f"{self.root}/", "")
        if isinstance(found, dict):
            return {key: self.shortened(value) for key, value in found.items()}
        if isinstance(found, list):
            return [self.shortened(value) for value in found]
        return found

    def recording(self, name: str, file: str = "") -> Path:
        """Return the path of a recording; raises `InputError` if it, its files or a
        frame's wall lead out.
        """
        for part in (*PARTS, "frames", f"walls/{PurePath(file).stem}.png"):
            self.inside(f"{name}/{part}")
        return self.inside(name)

    def new(self, name: str) -> Path:
        """Return the path of a new file or folder, by a plain name."""
        if not name or Path(name).name != name or name.startswith("."):
            raise InputError(f"{name!r}: give a plain name")
        path = self.inside(name)
        if path.exists() or path.is_symlink():
            raise InputError(f"{name}: exists already; choose another name")
        return path

    def contents(self) -> dict[str, Any]:
        """Return recordings with their eyes, calibrations with theirs, models, and
        sources with kind or fault.
        """
        found: dict[str, list[dict[str, Any]]] = {
            "recordings": [],
            "calibrations": [],
            "models": [],
            "sources": [],
        }
        known = [place for place in (self.root, self.root / SOURCES) if place.is_dir()]
        places = [place for place in known if place.resolve().is_relative_to(self.root)]

        for each in [
            each
            for place in places
            for each in sorted(os.scandir(place), key=lambda each: each.name)
        ]:
            check_wanted()
            name = str(Path(each.path).relative_to(self.root))
            if each.name.startswith(".") or name == SOURCES:
                continue

            try:
                if each.is_symlink():
                    self.inside(name)
                kind, entry = _entry(Path(each.path), _stamp(each))
            except (
                OSError,
                InputError,
            ):
                # without permission, gone meanwhile, or a link that leads out
                continue

            if kind:
                found[kind].append({"name": name, **entry})

        return {"folder": self.root.name, **found}

    async def upload(self, name: str, size: int, chunks: AsyncIterator[bytes]) -> None:
        """Write a dropped file as it arrives, whole or not at all; one of that name is
        never replaced.
        """
        if not 0 < size <= MOST_UPLOAD_BYTES:
            raise InputError(
                f"{name}: {size} bytes; a file may have 1 to {MOST_UPLOAD_BYTES}"
            )
        if shutil.disk_usage(self.root).free - size < LEFT_BYTES:
            raise InputError(f"{name}: the disk is too full for {size} bytes")

        self.inside(SOURCES).mkdir(exist_ok=True)
        sources = Folder((self.root / SOURCES).resolve())
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
                raise InputError(
                    f"{name}: ended {left} bytes before its end; drop it again"
                )

            path.open("xb").close()  # fails if a file of that name has come meanwhile
            part.replace(path)
        except FileExistsError as fault:
            raise InputError(f"{name}: exists already; choose another name") from fault
        finally:
            part.unlink(missing_ok=True)


def _stamp(each: os.DirEntry[str]) -> tuple[int, ...]:
    """Return numbers that change with a file, or with the files that make a folder a
    recording or a model.
    """
    marks = (
        [
            mark
            for name in (PARTS[0], RECORD_FILE)
            if (mark := Path(each.path, name)).exists()
        ]
        if each.is_dir()
        else []
    )
    stats = [each.stat(), *(mark.stat() for mark in marks)]

    return tuple(
        number
        for stat in stats
        for number in (stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)
    )


@lru_cache(MOST_ENTRIES)
def _entry(path: Path, _: tuple[int, ...]) -> tuple[str, dict[str, Any]]:
    """Return the list of `Folder.contents` that a path is in ("": none), and its entry
    there; by path and stamp.
    """
    try:
        if (path / "recording.toml").is_file():
            return "recordings", {"eye": read_info(path / "recording.toml").eye.name}
        if (path / RECORD_FILE).is_file():
            return "models", {}
        if path.suffix == ".json":
            return "calibrations", {"eyes": sorted(read_calibration(path).eyes)}
        if path.is_file():
            kind = source_kind(path)
            return "sources", {
                "kind": TIMES if kind == "log" and holds_times(path) else kind
            }
        if first := next((each for each in files_of([path]) if each.is_file()), None):
            return "sources", {"kind": f"folder of {source_kind(first)} files"}
    except InputError as fault:
        other = path.suffix == ".json" or (
            path.is_dir() and not (path / PARTS[0]).exists()
        )
        return ("", {}) if other else ("sources", {"fault": str(fault)})

    return "", {}
