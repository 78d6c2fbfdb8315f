"""Evaluation of many recordings into one table; recordings that are finished are not
read again.
"""

import json
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from hashlib import file_digest, sha256
from pathlib import Path
from typing import Any

from scleraforce.base.errors import InputError, RecordingError
from scleraforce.base.kept_results import ENDING, check_folder, keep_result, kept_result
from scleraforce.base.notebook_cards import Row, tidy
from scleraforce.base.optional_packages import package_for
from scleraforce.base.version import __version__
from scleraforce.base.whole_files import hash_sources, opened_regular
from scleraforce.calibration.evaluation import (
    Evaluation,
    check_once,
    evaluate_recordings,
)
from scleraforce.front.api.progress import Counting
from scleraforce.front.api.reading_frames import load_model
from scleraforce.reading.trained_ranges import KINDS as FORCE_KINDS
from scleraforce.recordings.exported_files import write_table
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.decoder import Source, decode_record
from scleraforce.records.model_folder import WALL_FINDER, read_folder
from scleraforce.records.remark import Remark, sentences

ENDINGS = (".csv", ".parquet")
SUITED = ("default", "living")
DRAFT = re.compile(r"\..*\.draft\.json")  # the app's, of a wall


@dataclass(frozen=True)
class Batch:
    """Rows of all frames, as of `Evaluation.rows`; remarks; the number of recordings,
    and of those read now; the evaluation of all, if it was asked for.
    """

    rows: list[Row]
    remarks: tuple[Remark, ...]
    recordings: int
    read: int
    evaluation: Evaluation | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of the remarks."""
        return sentences(self.remarks)


def evaluate_to_table(
    model: str | Path,
    recordings: Sequence[Path],
    table: Path,
    calibration: Path | None,
    wall_finder: Path | None,
    counting: Counting,
    *,
    whole: bool = False,
) -> Batch:
    """Evaluate recordings as `sf.evaluate` does, one by one, and write the rows to a
    .csv or .parquet file.

    Each recording's rows are kept in a folder beside the table, `.NAME.state`, with the
    hashes of the code, of model, calibration and wall finder, and of all bytes of the
    recording: it is read again unless all are the same. What this user's program did
    not write there is neither believed nor deleted. Paths that are not recordings are
    left out with a remark. Counts "recordings". `whole`: all are read, also those that
    have not changed, and their evaluation is returned, too.
    """
    _check(table)
    folders = [path for path in recordings if (path / "recording.toml").is_file()]
    check_once(folders)
    if missing := [path for path in recordings if not path.exists()]:
        raise RecordingError(f"{missing[0]}: no such recording")
    if not folders:
        raise RecordingError(
            f"{recordings[0]}: not a recording; none of the given paths is one"
        )

    reader = load_model(model, wall_finder=wall_finder)
    summary = None if calibration is None else read_calibration(calibration)
    same = {
        "version": __version__,
        "code_sha256": hash_sources(""),
        "model_sha256": _digest_of(reader.record),
        # one of which may read an eye in place of the other
        "bundled_sha256": _digest_of(
            [read_folder(name, FORCE_KINDS).record for name in SUITED]
        ),
        "calibration_sha256": summary and summary.sha256,
        "wall_finder_sha256": wall_finder
        and _digest_of(read_folder(wall_finder, (WALL_FINDER,)).record),
    }
    state = _state(table)
    state.mkdir(exist_ok=True)
    rows = list[Row]()
    evaluations = list[Evaluation]()
    read = 0
    used = set[str]()
    others = [str(path) for path in recordings if path not in folders]
    left_out = f"left out, not recordings: {', '.join(others)}"
    remarks = [Remark("files-left-out", left_out)] if others else []

    with counting("recordings", len(folders)) as advance:
        for path in folders:
            key = same | {"recording": str(path), "recording_sha256": _digest(path)}
            part = state / f"{_digest_of(key)}{ENDING}"
            found = None if whole else _kept(part, key)
            if found is None:
                evaluation = evaluate_recordings(
                    reader, [read_recording(path)], summary
                )
                found = {
                    "key": key,
                    "rows": evaluation.rows(),
                    "remarks": [remark.to_dict() for remark in evaluation.remarks],
                }
                if _digest(path) == key["recording_sha256"]:  # nothing came meanwhile
                    keep_result(found, part)
                read += 1
                evaluations += [evaluation] * whole

            used.add(part.name)
            rows += found["rows"]
            remarks += (
                decode_record(Remark, entry, Source(part.name))
                for entry in found["remarks"]
            )
            advance(1)

    rows = tidy(rows)
    write_table(rows, table)
    for old in state.glob(f"*{ENDING}"):
        if old.name not in used and kept_result(old) is not None:
            old.unlink()

    each_once = tuple(dict.fromkeys(remarks))
    joined = _joined(evaluations, each_once) if whole else None
    return Batch(rows, each_once, len(folders), read, joined)


def _joined(
    evaluations: Sequence[Evaluation], remarks: tuple[Remark, ...]
) -> Evaluation:
    """Return the evaluation of the frames of several, by one model."""
    frames = tuple(frame for one in evaluations for frame in one.frames)
    return replace(evaluations[0], frames=frames, remarks=remarks)


def by_eye(rows: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return for each eye the numbers of its frames and of scored ones, their metrics,
    and the modulus that was used.

    `accuracy`, `mae_mn` and `coverage` are computed as in `Evaluation`, on the eye's
    frames; None without any.
    """
    return [
        _of_eye(eye, [row for row in rows if row["eye"] == eye])
        for eye in dict.fromkeys(row["eye"] for row in rows)
    ]


def _of_eye(eye: str, rows: Sequence[Mapping[str, Any]]) -> Row:
    scored = [row for row in rows if row["scored"]]
    known = [row for row in scored if row["covered"] is not None]
    return {
        "eye": eye,
        "frames": len(rows),
        "scored": len(scored),
        "accuracy": _mean([row["predicted"] == row["target"] for row in scored]),
        "mae_mn": _mean(
            [abs(row["predicted_force_mn"] - row["measured_force_mn"]) for row in known]
        ),
        "coverage": _mean([row["covered"] for row in known]),
        "youngs_modulus_mpa": rows[0]["youngs_modulus_mpa"],
        "modulus_source": rows[0]["modulus_source"],
    }


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None


def _state(table: Path) -> Path:
    return table.with_name(f".{table.name}.state")


def _check(table: Path) -> None:
    if table.suffix not in ENDINGS:
        raise InputError(
            f"`table`: {table}: give a file that ends in {' or '.join(ENDINGS)}"
        )

    if table.suffix == ".parquet":
        package_for("pyarrow.parquet", table.suffix)
    check_folder(_state(table))
    kept = _state(table).glob(f"*{ENDING}")
    if os.path.lexists(table) and not any(kept_result(each) for each in kept):
        raise InputError(f"{table}: exists already; remove it or choose another name")
    if not table.absolute().parent.is_dir():
        raise InputError(f"{table}: its folder does not exist")


def _kept(part: Path, key: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return a recording's rows and remarks; None if they are missing, not this user's
    or of another key.
    """
    found: Any = kept_result(part)
    return found if isinstance(found, dict) and found.get("key") == key else None


def _digest_of(value: Any) -> str:
    return sha256(json.dumps(value, sort_keys=True, default=dict).encode()).hexdigest()


def _digest(folder: Path) -> str:
    """Return the SHA-256 of a recording: of the names and the bytes of all files in it
    and in folders below, and of the places of links; drafts of walls do not count.
    """
    whole = sha256()
    # links may go round: each folder is followed once
    seen = set[str]()

    for place, folders, files in os.walk(folder, followlinks=True):
        real = os.path.realpath(place)
        if real in seen:
            folders.clear()
            continue

        seen.add(real)
        folders.sort()
        for name in sorted([*folders, *files]):
            path = Path(place, name)
            target = os.readlink(path) if path.is_symlink() else ""
            if name in files and not DRAFT.fullmatch(name):
                with (
                    suppress(FileNotFoundError),  # a link to nothing
                    opened_regular(path, RecordingError) as file,
                ):
                    target += f"\0{file_digest(file, 'sha256').hexdigest()}"

                whole.update(repr((str(path.relative_to(folder)), target)).encode())
            elif target:
                whole.update(repr((str(path.relative_to(folder)), target)).encode())

    return whole.hexdigest()
