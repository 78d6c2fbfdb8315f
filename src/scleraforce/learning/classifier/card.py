"""The model card: what a network was made from, what it reaches, and what it must not be used for."""

from collections.abc import Mapping
from typing import Any

from scleraforce.reader.metrics import Proportion
from scleraforce.study import Choice, Sampled, Study
from scleraforce.units import HumanUnit, from_si


def model_card(
    study: Study, record: Mapping[str, Any], samples: tuple[int, int], shares: tuple[Proportion, ...]
) -> str:
    """Return the card, in Markdown.

    Args:
        study: the study of the data set.
        record: what `model.json` keeps.
        samples: numbers of training and validation samples.
        shares: recall of each class in the validation set.
    """
    metrics = record["metrics"]
    low_mn, high_mn = (from_si(bound, "mn") for bound in study.classes.bounds_n)
    mirrored = ";\nhalf of the slices shown with left and right exchanged" if study.network.mirror else ""
    return f"""# Force class of a needle on the sclera, from one OCT slice

Reads a binary slice of the scleral wall ({study.slice.rows} x {study.slice.columns} pixels of
{from_si(study.slice.pixel_m, "mm"):g} mm) and answers with the probability of three force classes:
0 below {low_mn:g} mN, 1 from {low_mn:g} to {high_mn:g} mN, 2 above {high_mn:g} mN.

## What it learned from
{samples[0]} simulated slices; {samples[1]} more, of contacts that it never saw, to validate. All are computed: a linear
elastic half-sphere, no real eye. Data set SHA-256 `{record["provenance"]["dataset_sha256"]}`.

| | |
|---|---|
| Young's modulus | {from_si(study.eye.youngs_modulus_pa, "mpa"):.4g} MPa |
| Poisson's ratio | {study.eye.poisson_ratio:g} |
| intraocular pressure | {study.eye.iop_pa:.0f} Pa |
| outer radius | {from_si(study.eye.radius_m, "mm"):g} mm |
{_groups(study)}
| polar angle of the contact | {_degrees(study.needle.polar_angle_rad)} |
| gap between B-scan and needle axis | {_millimetres(study.dataset.gap_m or Choice((study.needle.gap_m,)))} |
| shift of the window, lateral | {_millimetres(study.dataset.framing_lateral_m)} |
| shift of the window, in depth | {_millimetres(study.dataset.framing_depth_m)} |
| tilt of the B-scan | {_degrees(study.dataset.tilt_rad)} |
| direction of the B-scan | {_degrees(study.dataset.direction_rad)} |

## Network
{_sizes(study)}, ReLU, dropout {study.network.dropout:g} (fraction dropped), softmax; {study.network.epochs} epochs of
gradient descent on the cross-entropy, seed {study.network.seed}{mirrored}.

## What it reaches
Validation accuracy {_percent(metrics["validation_accuracy"])} (95 % Wilson interval
{_percent(metrics["validation_interval"][0])} to {_percent(metrics["validation_interval"][1])}), cross-entropy
{metrics["validation_loss"]:.4f}; recall of class 0, 1, 2: {", ".join(_percent(share.value) for share in shares)}.
On simulated slices: how it does on recordings, `scleraforce evaluate` tells.

## Limits
- It knows one Young's modulus. A stiffer eye is read as less force, a softer one as more.
- The simulation is linear; real walls soften, then stiffen, as the dent grows beyond their thickness.
- Outside the ranges above it still answers, and can be wrong with high probabilities. A dent that leaves the window can
  look like no force.
- A frame whose segmentation is not usable must not be shown to it: count it as class 2 (withdraw).

## Intended use
Research on force reading from OCT. Not a medical device; not for use on patients.
"""


def _groups(study: Study) -> str:
    return "\n".join(
        f"| wall of {from_si(group.thickness_m, 'um'):g} µm | {group.images} images, "
        f"0 to {from_si(group.max_force_n, 'mn'):g} mN |"
        for group in study.dataset.group
    )


def _sizes(study: Study) -> str:
    sizes = (study.slice.rows * study.slice.columns, *study.network.hidden, len(study.classes.bounds_n) + 1)
    return "-".join(str(size) for size in sizes)


def _millimetres(value: Sampled) -> str:
    return _spread(value, "mm", "mm")


def _degrees(value: Sampled) -> str:
    return _spread(value, "deg", "°")


def _spread(value: Sampled, unit: HumanUnit, printed: str) -> str:
    if isinstance(value, Choice):
        return ", ".join(f"{from_si(entry, unit):.4g}" for entry in value.values) + f" {printed}"
    return f"{from_si(value.min, unit):.4g} to {from_si(value.max, unit):.4g} {printed}"


def _percent(share: float) -> str:
    return f"{from_si(share, 'percent'):.2f} %"
