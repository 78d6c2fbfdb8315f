"""`scleraforce classify`: the force class of single frames, and with a model of kind "reader" the force."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.known_eye import known_entry, known_eye, known_eye_options, known_words
from scleraforce.cli.output import print_json, say
from scleraforce.cli.single_frames import (
    each_of,
    end_with_faults,
    is_folder,
    scale_entry,
    scanner_options,
    size_words,
    told_scanner,
)
from scleraforce.cli.wall_finder_option import finder_folder, wall_finder_option
from scleraforce.errors import FrameError, InputError
from scleraforce.plain_text import wrapped
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.known.eye import Known
    from scleraforce.reader import Reader
    from scleraforce.reader.answer import Answer
    from scleraforce.recording.folder import Scanner


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=click.Path(path_type=Path))
@scanner_options
@known_eye_options
@wall_finder_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def classify(
    model: Path,
    frames: tuple[Path, ...],
    width_mm: float | None,
    depth_mm: float | None,
    refractive_index: float | None,
    transpose: bool,
    youngs_modulus_mpa: float | None,
    iop_mmhg: float | None,
    thickness_um: float | None,
    gap_mm: float | None,
    polar_angle_deg: float | None,
    plane_direction_deg: float | None,
    stiffening: float | None,
    globe: str | None,
    rigidity: float | None,
    finder: Path | None,
    as_json: bool,
) -> None:
    """Read the force class of raw frames (PNG, TIFF, JPEG, DICOM) with MODEL.

    MODEL is a folder that `train` wrote, or `default`, the reader that ships.

    A model of kind "reader" reads the force as well, the better the more is
    known of the eye; one of kind "classifier" knows one modulus only. A frame
    that cannot be judged is class 2 (withdraw) and not usable.

    How large a frame is, and what is known of its eye, stands in the
    recording.toml beside its folder, in the file, or in the options, which come
    first. `evaluate` reads whole recordings.

    Example: scleraforce classify default frames/0001.png
    --youngs-modulus-mpa 0.27 --iop-mmhg 2 --thickness-um 650 --gap-mm 0.5
    --globe open
    """
    from scleraforce.reader import load_model

    for path in filter(is_folder, frames):
        raise InputError(f"{path}: a folder; `scleraforce evaluate {model} {path}` reads a recording, this one frames")
    reader = load_model(model, finder=finder_folder(finder))
    told = told_scanner(width_mm, depth_mm, refractive_index)
    known = known_eye(
        youngs_modulus_mpa,
        iop_mmhg,
        thickness_um,
        gap_mm,
        polar_angle_deg,
        plane_direction_deg,
        stiffening,
        globe,
        rigidity,
    )
    found = list(each_of(frames, lambda path: _read(reader, path, told, known, transpose)))
    read = [(path, answer) for path, answer in found if not isinstance(answer, InputError)]
    notes = [*_notes(reader, known), *_limits(read)]
    if as_json:
        entries = [_entry(path, answer, reader) for path, answer in found]
        print_json({"model": str(model), "kind": reader.kind, "notes": notes, "frames": entries})
    else:
        for line in [*(_line(path, one.answer) for path, one in read), *_read_as(read)]:
            say(line)
        for note in notes:
            say(wrapped(note, "note: "))
    end_with_faults(answer for _, answer in found)


@dataclass(frozen=True)
class _FrameRead:
    """The answer to a frame, with what it was read with: for JSON (`read_with`), in words, and where it is limited."""

    answer: "Answer"
    read_with: dict[str, Any]
    words: str
    limits: tuple[str, ...]


def _read(reader: "Reader", path: Path, told: "Scanner", known: "Known", transpose: bool) -> _FrameRead:
    """Read one frame with what was told and what else its recording and its file state."""
    from scleraforce.known.eye import NOTHING_KNOWN, completed, known_of_recording
    from scleraforce.recording.folder import Scanner, read_scaled_frame, recording_of

    assumed = Scanner(refractive_index=reader.study.oct.refractive_index)
    frame = read_scaled_frame(path, told, (assumed, "model's study"), transpose)
    stated = NOTHING_KNOWN if frame.info is None else known_of_recording(frame.info)
    used = completed(known, stated)
    try:
        answer = reader.read(frame.pixels, frame.scale, used)
    except ValueError as fault:
        raise FrameError(f"{path}: {fault}") from fault
    place = recording_of(path) or path
    limits = () if frame.info is None else reader.limits(used, frame.info.oct, frame.info.needle.gauge)
    return _FrameRead(
        answer,
        {"scale": scale_entry(frame), "known": known_entry(known, stated)},
        f"{size_words(frame)}; {known_words(known, stated)}",
        (*frame.notes, *(f"{place}: {sentence}" for sentence in limits)),
    )


def _notes(reader: "Reader", known: "Known") -> list[str]:
    """Return what was told and not used."""
    from scleraforce.known.eye import NOTHING_KNOWN

    if reader.fixed_modulus_pa is None or known == NOTHING_KNOWN:
        return []
    modulus_mpa = from_si(reader.fixed_modulus_pa, "mpa")
    return [f"a classifier takes no notice of what is known of an eye; it reads each as one of {modulus_mpa:g} MPa"]


def _limits(read: "list[tuple[Path, _FrameRead]]") -> list[str]:
    """Return once what limits the answers to a recording's frames."""
    return list(dict.fromkeys(sentence for _, one in read for sentence in one.limits))


def _read_as(read: "list[tuple[Path, _FrameRead]]") -> list[str]:
    """Return what frames were read with, those that are alike together."""
    alike: dict[str, list[Path]] = {}
    for path, one in read:
        alike.setdefault(one.words, []).append(path)
    names = {words: f"{paths[0]} and {len(paths) - 1} more" if paths[1:] else str(paths[0])
             for words, paths in alike.items()}  # fmt: skip
    return [wrapped(f"{names[words]}: {words}", "read with: ") for words in alike]


def _entry(path: Path, found: _FrameRead | InputError, reader: "Reader") -> dict[str, Any]:
    """Return a frame as it stands in JSON; one that could not be read is withdrawn from, and has an `error`."""
    if isinstance(found, InputError):
        from scleraforce.reader.answer import unusable

        return {**_answered(path, unusable(reader.classes, str(found))), "error": str(found)}
    return {**_answered(path, found.answer), **found.read_with}


def _answered(path: Path, answer: "Answer") -> dict[str, Any]:
    from scleraforce.segmentation.needle import needle_entry

    return {
        "file": str(path),
        "predicted": answer.predicted,
        "probabilities": answer.probabilities,
        "predicted_force_mn": from_si(answer.force_n, "mn"),
        "interval_mn": None if answer.interval_n is None else [from_si(end, "mn") for end in answer.interval_n],
        "contact_mm": from_si(answer.contact_m, "mm"),
        "pressure_pa": answer.iop_at_dent_pa,
        "pressure_mmhg": from_si(answer.iop_at_dent_pa, "mmhg"),
        "needle": needle_entry(answer.needle),
        "conjunctiva_um": from_si(answer.conjunctiva_m, "um"),
        "usable": answer.usable,
        "reason": answer.reason,
        "warnings": answer.warnings,
        "can_calibrate": answer.can_calibrate,
    }


def _line(path: Path, answer: "Answer") -> str:
    if answer.probabilities is None:
        return f"{path}: class {answer.predicted} (withdraw): not usable: {answer.reason}"
    shares = ", ".join(f"{share:.3f}" for share in answer.probabilities)
    read = "".join(f", {words}" for words in _force(answer))
    lines = [f"{path}: class {answer.predicted} (probabilities {shares}){read}"]
    return "\n".join([*lines, *(wrapped(warning, "  warning: ") for warning in answer.warnings)])


def _force(answer: "Answer") -> list[str]:
    """Return the force with its interval and the pressure at the dent, as far as they were read."""
    words = []
    if answer.force_n is not None and answer.interval_n is not None:
        low, high = (f"{from_si(end, 'mn'):.1f}" for end in answer.interval_n)
        words.append(f"{from_si(answer.force_n, 'mn'):.1f} mN (90 %: {low} to {high})")
    if answer.iop_at_dent_pa is not None:
        words.append(f"{from_si(answer.iop_at_dent_pa, 'mmhg'):.1f} mmHg at the dent")
    return words
