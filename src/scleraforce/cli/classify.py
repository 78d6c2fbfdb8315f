"""`scleraforce classify`: the force class of single frames, and with a model of kind "reader" the force."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.known_eye import known_eye, known_eye_options
from scleraforce.cli.output import print_json, progress_bar
from scleraforce.units import n_to_mn

if TYPE_CHECKING:
    from scleraforce.imaging.segmentation import PixelScale
    from scleraforce.reader import ForceReader, WallReader
    from scleraforce.reader.answers import Answer
    from scleraforce.reader.known import Known
    from scleraforce.recording.images import FrameImage
    from scleraforce.study import OctStudy

__all__ = ["classify"]

LENGTH = click.FloatRange(0.01, 100.0)


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--width-mm", type=LENGTH, help="Width of the frames; by default their own (DICOM), or the model's study."
)
@click.option("--depth-mm", type=LENGTH, help="Depth of the frames, as stored; by default likewise.")
@click.option("--refractive-index", type=click.FloatRange(1.0, 2.0),
              help="By which depth is stretched (1: corrected already); by default the study's.")  # fmt: skip
@known_eye_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def classify(
    model: Path,
    frames: tuple[Path, ...],
    width_mm: float | None,
    depth_mm: float | None,
    refractive_index: float | None,
    youngs_modulus_mpa: float | None,
    iop_mmhg: float | None,
    thickness_um: float | None,
    gap_mm: float | None,
    as_json: bool,
) -> None:
    """Read the force class of raw frames (PNG, TIFF, JPEG, DICOM) with MODEL.

    A model of kind "reader" reads the force as well, the better the more is
    known of the eye; one of kind "classifier" knows one modulus only. A frame
    that cannot be judged is class 2 (withdraw) and not usable.

    Example: scleraforce classify reader frames/0001.png
    --youngs-modulus-mpa 0.27 --iop-mmhg 2 --thickness-um 650 --gap-mm 0.5
    """
    from scleraforce.imaging.segmentation import Segmenter
    from scleraforce.reader import load_model
    from scleraforce.reader.answers import answer_frame
    from scleraforce.recording.images import read_frame_image

    reader = load_model(model)
    index = reader.study.oct.refractive_index if refractive_index is None else refractive_index
    segmenter = Segmenter(index)
    known = known_eye(youngs_modulus_mpa, iop_mmhg, thickness_um, gap_mm)
    answers = []
    for path in progress_bar(frames, "frames"):
        image = read_frame_image(path)
        scale = _scale(image, reader.study.oct, width_mm, depth_mm)
        answers.append((path, answer_frame(reader, segmenter, image.pixels, scale, index, known)))
    notes = _notes(reader, known)
    if as_json:
        entries = [_entry(path, answer) for path, answer in answers]
        print_json({"model": str(model), "kind": reader.kind, "notes": notes, "frames": entries})
    else:
        click.echo("\n".join([*(_line(path, answer) for path, answer in answers), *notes]))


def _notes(reader: "ForceReader | WallReader", known: "Known") -> list[str]:
    """Return what was told and not used."""
    from scleraforce.reader.known import Known

    if reader.kind == "reader" or known == Known():
        return []
    modulus_mpa = reader.study.eye.youngs_modulus_pa / 1e6
    return [
        f"note: a classifier takes no notice of what is known of an eye; it reads each as one of {modulus_mpa:g} MPa"
    ]


def _scale(image: "FrameImage", oct_study: "OctStudy", width_mm: float | None, depth_mm: float | None) -> "PixelScale":
    """Return the size of a pixel: as given, else as the file says, else as the model's study says."""
    from scleraforce.imaging.segmentation import PixelScale

    rows, columns = image.pixels.shape
    lateral_m = image.lateral_pixel_m or oct_study.width_m / columns
    depth_m = image.depth_pixel_m or oct_study.depth_m / rows
    return PixelScale(
        lateral_m if width_mm is None else width_mm / 1e3 / columns,
        depth_m if depth_mm is None else depth_mm / 1e3 / rows,
    )


def _entry(path: Path, answer: "Answer") -> dict[str, Any]:
    return {
        "file": str(path),
        "predicted": answer.predicted,
        "probabilities": answer.probabilities,
        "predicted_force_mn": None if answer.force_n is None else n_to_mn(answer.force_n),
        "interval_mn": None if answer.interval_n is None else [n_to_mn(end) for end in answer.interval_n],
        "contact_mm": None if answer.contact_m is None else answer.contact_m * 1e3,
        "usable": answer.usable,
        "reason": answer.reason,
        "warnings": answer.warnings,
        "can_calibrate": answer.can_calibrate,
    }


def _line(path: Path, answer: "Answer") -> str:
    if answer.probabilities is None:
        return f"{path}: class {answer.predicted} (withdraw): not usable: {answer.reason}"
    shares = ", ".join(f"{share:.3f}" for share in answer.probabilities)
    force = (
        "" if answer.force_n is None or answer.interval_n is None else f", {_force(answer.force_n, answer.interval_n)}"
    )
    lines = [f"{path}: class {answer.predicted} (probabilities {shares}){force}"]
    return "\n".join([*lines, *(f"  warning: {warning}" for warning in answer.warnings)])


def _force(force_n: float, interval_n: tuple[float, float]) -> str:
    low, high = (f"{n_to_mn(end):.1f}" for end in interval_n)
    return f"{n_to_mn(force_n):.1f} mN (90 %: {low} to {high})"
