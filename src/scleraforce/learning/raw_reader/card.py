"""The model card of a raw reader: what it was made from, what it reaches, and what it must not be used for."""

from collections.abc import Mapping
from typing import Any

from scleraforce.study import Sampled, Study
from scleraforce.units import HumanUnit, from_si


def raw_reader_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card, in Markdown.

    Args:
        study: of the training.
        record: what `model.json` keeps.
    """
    raw, reader, metrics, samples = study.raw_reader, study.reader, record["metrics"], record["samples"]
    made = record["provenance"]
    return f"""# Force of a needle on the sclera, from a raw B-scan

Sees {from_si(raw.rows * raw.row_m, "mm"):g} x {from_si(raw.columns * raw.column_m, "mm"):g} mm of a raw frame as \
{raw.rows} x {raw.columns} pixels and, where they are known, Young's modulus (with its
uncertainty), IOP, wall thickness, gap, globe, polar angle and direction. It answers with a histogram of F/E \
({reader.bins} bins) and the contact's place,
as the slice reader does. No boundary is decided on the way. It has no library and no fit: nothing checks its force.

## What it learned from
{samples["slices"]} computed slices, then {samples["training"]} drawn raw frames of other computed walls, each seen \
once; {samples["validation"]} more to validate. No real
eye and no real scan is among them. Library SHA-256 `{made["library_sha256"]}`.

| | |
|---|---|
| eyes, and what is told of them | `[reader]` in `study.toml`, gaps from 0 |
| scanner | `[phantom]` and `[oct]`; {_spread(raw.snr_loss_db)} dB less signal, speckle {_spread(raw.speckle_factor)} \
times as large |
| conjunctiva | {raw.conjunctiva_share:.0%} of the frames, {_spread(raw.conjunctiva_thickness_m, "um")} µm |
| needle in the picture | {raw.needle_share:.0%} of the frames, {_spread(raw.needle_diameter_m, "um")} µm |

## What it reaches
On drawn frames of all that: mean force error {metrics["mae_mn"]:.2f} mN, {metrics["coverage"]:.1%} of the 90 % \
intervals hold, {metrics["validation_accuracy"]:.2%} of the classes
are right, contact {metrics["lateral_mae_mm"]:.2f} mm off in the mean. On recordings `scleraforce evaluate` tells.

## Limits
- {_intervals(record)}
- It knows the scanners and the eyes above. What nobody drew (a cornea, a lid, another layer) may be read with a force.
- Its answer scales with the modulus that it is told.
- Where a slice says little, its answer leans to the middle of the forces of its training.

## Intended use
Research on force reading from OCT. Not a medical device; not for use on patients.

Made by scleraforce {made["scleraforce"]}, PyTorch {made["torch"]}, seed {raw.seed}. `scleraforce train LIBRARY --kind \
raw-reader --study study.toml --out MODEL` makes it again.
"""


def _spread(values: Sampled, unit: HumanUnit | None = None) -> str:
    low, high = (bound if unit is None else from_si(bound, unit) for bound in values.bounds)
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _intervals(record: Mapping[str, Any]) -> str:
    intervals = record.get("intervals")
    if intervals is None:
        return "Its intervals are as the network says, and were measured on no eye."
    return f"Its intervals were stretched to hold on {intervals['eyes']} {intervals['source']}, calibrated before."
