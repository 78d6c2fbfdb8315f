"""`scleraforce read`: the force, or its class, from single frames."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.inputs import known_sources, known_words, scale_entry, size_words
from scleraforce.cli.options import EYE, FRAME_SIZE, PATH, eye_options, options
from scleraforce.cli.output import Command, Report, each_of
from scleraforce.errors import InputError
from scleraforce.plain_text import wrapped
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.notebook.frames import Reading
    from scleraforce.reader import Reader
    from scleraforce.reader.answer import Answer


@click.command(cls=Command)
@click.argument("model", type=PATH)
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=PATH)
@options(*FRAME_SIZE)
@eye_options(*EYE, default="by default it is not known", stiffening="by default it does not stiffen",
             globe="by default it is not known, and intervals are wider")  # fmt: skip
@options("calibration", calibration="File of `calibrate`: gives the modulus of the eye, or of the population.")
@click.option("--eye", help="Name of the eye in the calibration; by default the recording's.")
@options("finder")
def read(
    model: Path,
    frames: tuple[Path, ...],
    width_m: float | None,
    depth_m: float | None,
    refractive_index: float | None,
    transpose: bool,
    calibration: Path | None,
    eye: str | None,
    finder: Path | None,
    **given: Any,
) -> Report:
    """Read the force, or its class, from raw frames (PNG, TIFF, JPEG, DICOM).

    MODEL is a folder that `train` wrote, or `default`, the bundled reader.

    A model of kind "reader" reads the force as well, the better the more is
    known of the eye; one of kind "classifier" knows one modulus only. A frame
    that cannot be judged is class 2 (withdraw) and not usable.

    The size of a frame, and what is known of its eye, come from the options,
    then from the recording.toml beside its folder, then from the file.
    `evaluate` reads whole recordings. `classify` is another name of `read`.

    Example: scleraforce read default frames/0001.png
    --youngs-modulus-mpa 0.27 --iop-mmhg 2 --thickness-um 650 --gap-mm 0.5
    --globe open
    """
    import scleraforce as sf
    from scleraforce.known import NOTHING_KNOWN
    from scleraforce.notebook.frames import check_calibrated, given_eye, reading, summary_of_calibration
    from scleraforce.recording.folder import Scanner

    for path in filter(os.path.isdir, frames):
        raise InputError(f"{path}: a folder; `scleraforce evaluate {model} {path}` reads a recording, this one frames")
    known, size = given_eye(**given), Scanner(width_m=width_m, depth_m=depth_m, refractive_index=refractive_index)
    check_calibrated(known, calibration is not None, eye)
    reader = sf.load_model(model, wall_finder=finder)
    summary = None if calibration is None else summary_of_calibration(calibration)
    found = list(each_of(frames, lambda path: reading(reader, path, known, size, summary, eye, transpose)))
    answered = [(path, one) for path, one in found if not isinstance(one, InputError)]
    notes = list(dict.fromkeys(note for _, one in answered for note in one.notes))
    if reader.fixed_modulus_pa is not None and (known != NOTHING_KNOWN or calibration is not None):
        modulus_mpa = from_si(reader.fixed_modulus_pa, "mpa")
        notes.insert(0, "a classifier does not use what is known of an eye; it reads each as one of "
                     f"{modulus_mpa:g} MPa")  # fmt: skip
    entries = [_entry(path, one, reader) for path, one in found]
    return Report(
        {"model": str(model), "kind": reader.kind, "notes": notes, "frames": entries},
        [
            *(_line(path, one.answer) for path, one in answered),
            *_read_with(answered),
            *(wrapped(note, "note: ") for note in notes),
        ],
        [one for _, one in found if isinstance(one, InputError)],
    )


def _read_with(answered: "list[tuple[Path, Reading]]") -> Iterator[str]:
    """Yield what frames were read with, equal ones together."""
    equal: dict[str, list[Path]] = {}
    for path, one in answered:
        words = f"{size_words(one.frame)}; {known_words(known_sources(one.given, one.stated, one.known))}"
        equal.setdefault(words, []).append(path)
    for words, paths in equal.items():
        names = f"{paths[0]} and {len(paths) - 1} more" if paths[1:] else str(paths[0])
        yield wrapped(f"{names}: {words}", "read with: ")


def _entry(path: Path, found: "Reading | InputError", reader: "Reader") -> dict[str, Any]:
    """Return a frame for JSON; one that could not be read is withdrawn from, and has an `error`."""
    if isinstance(found, InputError):
        from scleraforce.reader.answer import unusable

        return {"file": str(path), **unusable(reader.classes, str(found)).as_json(), "error": str(found)}
    sources = known_sources(found.given, found.stated, found.known)
    known = {key: {"value": value, "source": source} for key, value, source in sources}
    return {"file": str(path), **found.answer.as_json(), "scale": scale_entry(found.frame), "known": known}


def _line(path: Path, answer: "Answer") -> str:
    if answer.probabilities is None:
        return f"{path}: class {answer.predicted} (withdraw): not usable: {answer.reason}"
    words = (
        f"{path}: class {answer.predicted} (probabilities {', '.join(f'{one:.3f}' for one in answer.probabilities)})"
    )
    if answer.force_n is not None and answer.interval_n is not None:
        low, high = (f"{from_si(end, 'mn'):.1f}" for end in answer.interval_n)
        words += f", {from_si(answer.force_n, 'mn'):.1f} mN (90 %: {low} to {high})"
    if answer.iop_at_dent_pa is not None:
        words += f", {from_si(answer.iop_at_dent_pa, 'mmhg'):.1f} mmHg at the dent"
    return "\n".join([words, *(wrapped(warning, "  warning: ") for warning in answer.warnings)])
