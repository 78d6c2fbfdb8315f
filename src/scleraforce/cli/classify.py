"""`scleraforce classify`: the force class of single frames."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.output import print_json, progress_bar

if TYPE_CHECKING:
    from scleraforce.imaging.segmentation import PixelScale
    from scleraforce.reader.answers import Answer
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
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def classify(
    model: Path,
    frames: tuple[Path, ...],
    width_mm: float | None,
    depth_mm: float | None,
    refractive_index: float | None,
    as_json: bool,
) -> None:
    """Read the force class of raw frames (PNG, TIFF, JPEG, DICOM) with MODEL.

    A frame that cannot be judged is class 2 (withdraw) and not usable.
    """
    from scleraforce.imaging.segmentation import Segmenter
    from scleraforce.reader import load_model
    from scleraforce.reader.answers import answer_frame
    from scleraforce.recording.images import read_frame_image

    reader = load_model(model)
    index = reader.study.oct.refractive_index if refractive_index is None else refractive_index
    segmenter = Segmenter(index)
    answers = []
    for path in progress_bar(frames, "frames"):
        image = read_frame_image(path)
        scale = _scale(image, reader.study.oct, width_mm, depth_mm)
        answers.append((path, answer_frame(reader, segmenter, image.pixels, scale, index)))
    if as_json:
        print_json({"model": str(model), "frames": [_entry(path, answer) for path, answer in answers]})
    else:
        click.echo("\n".join(_line(path, answer) for path, answer in answers))


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
        "usable": answer.usable,
        "reason": answer.reason,
    }


def _line(path: Path, answer: "Answer") -> str:
    if answer.probabilities is None:
        return f"{path}: class {answer.predicted} (withdraw): not usable: {answer.reason}"
    shares = ", ".join(f"{share:.3f}" for share in answer.probabilities)
    return f"{path}: class {answer.predicted} (probabilities {shares})"
