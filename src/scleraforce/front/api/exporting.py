"""Recordings and answers in the formats of other programs."""

import json
import tomllib
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from scleraforce.base import notebook_cards
from scleraforce.base.errors import InputError
from scleraforce.base.plain_json import finite_json
from scleraforce.base.whole_files import write_whole
from scleraforce.calibration.evaluation import Evaluation
from scleraforce.reading.answer import Answers
from scleraforce.recordings import exported_files
from scleraforce.recordings.import_record import read_import_record
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.decoder import format_record
from scleraforce.records.study import ClassesStudy

TABLES = (".csv", ".json")
ENDINGS = (*TABLES, ".mcap", ".nrrd")
GivenAnswers = Evaluation | Answers | str | PathLike[str]


def export(
    thing: Recording | GivenAnswers,
    out: str | PathLike[str],
    *,
    answers: GivenAnswers | None = None,
    replace: bool = False,
) -> int:
    """Write a recording, or answers, for other programs; return the number of frames.

    Args:
        thing: a recording, opened or as a folder; or answers: of `evaluate`, of `read`
            to a stack, or a file with the JSON that a command printed.
        out: the file; its ending decides: .csv and .json have a row for each frame,
            .mcap and .nrrd need a recording.
        answers: to a recording's frames, to add to their rows; of a stack one for each,
            in their order.
        replace: replace a file that exists.

    Raises:
        InputError: `out` exists or has another ending, or a format has no room for what
            is given.

    >>> import scleraforce as sf
    >>> sf.export("eye-a", "eye-a.csv")
    3
    """
    out = Path(out)
    kind = out.suffix.lower()
    if kind not in ENDINGS:
        raise InputError(f"out: {out}: give a name that ends in {', '.join(ENDINGS)}")
    if out.exists() and not replace:
        raise InputError(
            f"{out}: exists already; choose another name, or replace it (`replace`)"
        )

    for name, one in {"thing": thing, "answers": answers}.items():
        if one is not None and not isinstance(
            one, Recording | Evaluation | Answers | str | PathLike
        ):
            raise InputError(
                f"{name}: {type(one).__name__}; give a recording, an evaluation,"
                " answers of a stack or a file"
            )

    if isinstance(thing, Evaluation | Answers) or not (
        isinstance(thing, Recording) or Path(thing).is_dir()
    ):
        if answers is not None:
            raise InputError(
                f"answers: {thing} is answers already; give a recording with them"
            )
        if kind not in TABLES:
            raise InputError(
                f"out: {out}: answers alone become .csv or .json; give their recording,"
                " and them as answers"
            )

        return _write_table({}, _rows(thing), out)

    recording = thing if isinstance(thing, Recording) else read_recording(thing)
    if recording.info.scan.planes and kind not in TABLES:
        raise InputError(
            f"out: {out}: has room for frames of one plane; give a .csv or .json"
        )

    if kind == ".nrrd":
        if answers is not None:
            raise InputError(
                f"answers: {out} has room for frames only; give a .csv, .json or .mcap"
            )

        exported_files.write_sequence(recording, out)
        return len(recording.frames)

    rows = exported_files.frame_rows(recording, ClassesStudy())
    if answers is not None:
        given = _rows(answers)
        if isinstance(answers, Answers):
            if len(given) != len(rows):
                raise InputError(
                    f"answers: {len(given)} for {len(rows)} frames; give one for each,"
                    " in their order"
                )

            given = [
                {**one, "file": row["file"]}
                for one, row in zip(given, rows, strict=True)
            ]

        rows = exported_files.with_answers(rows, given, recording.path)

    if kind != ".mcap":
        return _write_table(tomllib.loads(format_record(recording.info)), rows, out)

    origin_s = read_import_record(recording.path).clock_origin_s
    exported_files.write_mcap(recording, rows, origin_s, out)
    return len(rows)


def _rows(answers: GivenAnswers) -> list[notebook_cards.Row]:
    if isinstance(answers, Evaluation | Answers):
        return [
            {"file": f"frame {nth}", **frame}
            for nth, frame in enumerate(answers.to_dict()["frames"])
        ]
    return exported_files.read_answers(Path(answers))


def _write_table(
    stated: Mapping[str, Any], rows: list[notebook_cards.Row], out: Path
) -> int:
    if out.suffix.lower() == ".json":
        write_whole(
            json.dumps(
                finite_json({**stated, "frames": rows}), indent=2, allow_nan=False
            )
            + "\n",
            out,
        )
    else:
        exported_files.write_table(rows, out)

    return len(rows)
