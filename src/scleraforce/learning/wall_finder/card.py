"""The model card of a wall finder: what it was made from, what it reaches, and what it must not be used for."""

from collections.abc import Mapping
from typing import Any

from scleraforce.study import Study
from scleraforce.units import from_si


def finder_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card, in Markdown.

    Args:
        study: of the training.
        record: what `model.json` keeps.
    """
    finder, window, metrics, scenes = study.wall_finder, study.scenes.window, record["metrics"], record["scenes"]
    made = record["provenance"]
    narrowest, widest = (from_si(bound, "mm") for bound in window.width_m.bounds)
    return f"""# The corneoscleral wall in a raw B-scan of a front eye

Sees a frame reduced to {finder.rows} x {finder.columns} pixels, without its scale, and answers for every second column
with the rows of the wall's upper and lower boundary as distributions, and with the probability that there is wall.
`scleraforce segment` refines its wall on the full frame and checks it against the other way to find it.

## What it learned from
{scenes["training"]} drawn scenes, each seen once, and {scenes["validation"]} others to validate. No real scan is \
among them. `[scenes]` in `study.toml`
has the range of everything that is drawn: frames of {narrowest:g} to {widest:g} mm, cornea, limbus and
sclera or half-spheres, dents, what lies over and below the wall, and the scanner.

## What it reaches on drawn scenes
| | |
|---|---|
| Dice: mean, median, 5th percentile | {metrics["dice_mean"]:.3f}, {metrics["dice_median"]:.3f}, \
{metrics["dice_low"]:.3f} |
| median error of the upper and the lower boundary | {metrics["outer_rows"]:.2f} and {metrics["inner_rows"]:.2f} rows \
of {finder.rows} |
| boundaries within 1.645 of their standard deviations | {metrics["coverage"]:.1%} |
| columns for which it is right whether there is wall | {metrics["found"]:.1%} |

## What it must not be used for
- Not for patients: a research tool, validated on drawings, and on real scans by eye only.
- Not alone: its boundaries are a row of {finder.rows} fine, and its uncertainty is that of drawings. Where light does
  not reach the wall it says where the wall would be.
- Scenes that nobody drew - other tissues, a lid that closes the eye, a scan from below - may be answered with a wall.

Made by scleraforce {made["scleraforce"]}, PyTorch {made["torch"]}, seed {finder.seed}. `scleraforce train --kind
wall-finder --study study.toml --out MODEL` makes it again.
"""
