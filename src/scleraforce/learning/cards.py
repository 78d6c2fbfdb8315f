"""Model cards: what a network was made from, what it reaches, and what it must not be used for (Markdown)."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from scleraforce.reader.metrics import Proportion
from scleraforce.study import Choice, Range, Study
from scleraforce.study.fields import field_key, field_unit, map_numbers
from scleraforce.units import from_si

INTENDED = "Research on force reading from OCT. Not a medical device; not for use on patients."
RANGES = "Keys of `study.toml` and their values; of several, or between two, one is drawn for each sample."


def classifier_card(
    study: Study, record: Mapping[str, Any], samples: tuple[int, int], shares: Sequence[Proportion]
) -> str:
    """Return the card of a classifier."""
    metrics, low, high = record["metrics"], *_bounds_mn(study)
    network = study.network
    mirrored = ";\nhalf of the slices shown with left and right exchanged" if network.mirror else ""
    sizes = (study.slice.rows * study.slice.columns, *network.hidden, len(study.classes.bounds_n) + 1)
    walls = {
        f"wall of {from_si(group.thickness_m, 'um'):g} µm": f"{group.images} images, "
        f"0 to {from_si(group.max_force_n, 'mn'):g} mN"
        for group in study.dataset.group
    }
    ranges = {**_ranges(study.eye), **_ranges(study.needle), **_ranges(study.dataset)}
    ranges.pop("`thickness_um`")  # of the groups' walls
    least, most = metrics["validation_interval"]
    return _card(
        "Force class of a needle on the sclera, from one OCT slice",
        f"""Reads a slice of the scleral wall ({_pixels(study)}) and answers with the probability of three \
classes:
0 below {low:g} mN, 1 from {low:g} to {high:g} mN, 2 above {high:g} mN.""",
        {
            "What it learned from": f"""{samples[0]} simulated slices; {samples[1]} more, of contacts that it never \
saw, to validate. All are computed: a linear
elastic half-sphere, no real eye. Data set SHA-256 `{record["provenance"]["dataset_sha256"]}`.
{RANGES}

{_table({**walls, **ranges})}""",
            "Network": f"""{"-".join(map(str, sizes))}, ReLU, dropout {network.dropout:g} (fraction dropped), softmax; \
{network.epochs} epochs of
gradient descent on the cross-entropy, seed {network.seed}{mirrored}.""",
            "What it reaches": f"""Validation accuracy {_percent(metrics["validation_accuracy"])} (95 % Wilson interval
{_percent(least)} to {_percent(most)}), cross-entropy {metrics["validation_loss"]:.4f}; recall of class 0, 1, 2: \
{", ".join(_percent(share.value) for share in shares)}.
On simulated slices: `scleraforce evaluate` measures it on recordings.""",
            "Limits": """- It knows one Young's modulus. A stiffer eye is read as less force, a softer one as more.
- The simulation is linear; real walls soften, then stiffen, as the dent grows beyond their thickness.
- Outside the ranges above it still answers, and can be wrong with high probabilities. A dent that leaves the window can
  look like no force.
- A frame whose segmentation is not usable must not be shown to it: count it as class 2 (withdraw).""",
            "Intended use": INTENDED,
        },
    )


def reader_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card of a reader, from its study and what `model.json` keeps."""
    reader, metrics, samples, errors = study.reader, record["metrics"], record["samples"], record["library"]
    low, high = _bounds_mn(study)
    least, most = metrics["validation_interval"]
    intervals = record.get("intervals")
    measured = (
        "Its intervals are as its methods say: they were not measured on whole eyes."
        if intervals is None
        else f"Its intervals were measured on {intervals['eyes']} eyes: {intervals['source']}."
    )
    return _card(
        "Force of a needle on the sclera, from one OCT slice",
        f"""Reads a binary slice of the scleral wall ({_pixels(study)}) and, where they are known, Young's modulus \
(with its uncertainty), IOP, wall thickness
and the gap between B-scan and needle. It answers with a histogram of F/E ({reader.bins} bins): the force with a 90 %
interval and the probability of three classes (below {low:g} mN, {low:g} to {high:g} mN, above {high:g} mN) follow from
it. And with the contact's place along the slice. `library.npz` holds the computed walls, for the fit beside it, in a
reduced basis: their points are off by at most {from_si(errors["curves_m"], "um"):.2g} µm, forces by a share of \
{errors["stiffness"]:.1g}.""",
        {
            "What it learned from": f"""{samples["training"]} computed slices, each seen once; \
{samples["validation"]} others to validate. All are computed with
finite strain (compressible neo-Hookean sphere, axisymmetric about the needle, moved with the base beside it): \
no real eye. Library SHA-256
`{record["provenance"]["library_sha256"]}`.
{RANGES}

{_table(_ranges(reader))}""",
            "What it reaches": f"""On validation samples with all of the above, missing values included: mean force \
error {metrics["mae_mn"]:.2f} mN,
{metrics["coverage"]:.1%} of the 90 % intervals hold the force, {metrics["validation_accuracy"]:.2%} of classes right
(95 % Wilson interval {least:.2%} to {most:.2%}), contact {metrics["lateral_mae_mm"]:.2f} mm off in the mean.
On simulated slices: `scleraforce evaluate` measures it on recordings.""",
            "Limits": f"""- Its answer scales with the modulus that is stated: one that is 10 % too large reads forces \
10 % too large.
- The forces of its training are even: where a slice says little, its answer leans to the middle of the range.
- Eyes are spheres of one material; of others the form at rest is known, not how they bend.
- {measured}
- Outside the ranges above it still answers, and can be wrong with narrow intervals.""",
            "Intended use": INTENDED,
        },
    )


def raw_reader_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card of a raw reader, from its study and what `model.json` keeps."""
    raw, metrics, samples = study.raw_reader, record["metrics"], record["samples"]
    intervals = record.get("intervals")
    measured = (
        "Its intervals are as the network says, and were measured on no eye."
        if intervals is None
        else f"Its intervals were stretched to hold on {intervals['eyes']} {intervals['source']}, calibrated before."
    )
    return _card(
        "Force of a needle on the sclera, from a raw B-scan",
        f"""Sees {from_si(raw.rows * raw.row_m, "mm"):g} x {from_si(raw.columns * raw.column_m, "mm"):g} mm of a raw \
frame as {raw.rows} x {raw.columns} pixels and, where they are known, Young's modulus (with its
uncertainty), IOP, wall thickness, gap, globe, polar angle and direction. It answers with a histogram of F/E \
({study.reader.bins} bins) and the contact's place,
as the slice reader does. No boundary is decided on the way. It has no library and no fit: nothing checks its force.""",
        {
            "What it learned from": f"""{samples["slices"]} computed slices, then {samples["training"]} drawn raw \
frames of other computed walls, each seen once; {samples["validation"]} more to validate. No real
eye and no real scan is among them. Library SHA-256 `{record["provenance"]["library_sha256"]}`.
The eyes, and their stated values, are `[reader]` in `study.toml`, with gaps from 0; the scanner is `[phantom]` and
`[oct]`, changed by `[raw_reader]`. {RANGES}

{_table(_ranges(raw))}""",
            "What it reaches": f"""On drawn frames of all that: mean force error {metrics["mae_mn"]:.2f} mN, \
{metrics["coverage"]:.1%} of the 90 % intervals hold, {metrics["validation_accuracy"]:.2%} of the classes
are right, contact {metrics["lateral_mae_mm"]:.2f} mm off in the mean. `scleraforce evaluate` measures it on \
recordings.""",
            "Limits": f"""- {measured}
- It knows the scanners and the eyes above. What nobody drew (a cornea, a lid, another layer) may be read with a force.
- Its answer scales with the modulus that is stated.
- Where a slice says little, its answer leans to the middle of the forces of its training.""",
            "Intended use": f"{INTENDED}\n\n{_made(record, raw.seed, 'LIBRARY --kind raw-reader')}",
        },
    )


def finder_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card of a wall finder, from its study and what `model.json` keeps."""
    finder, metrics, scenes = study.wall_finder, record["metrics"], record["scenes"]
    reached = {
        "Dice: mean, median, 5th percentile": f"{metrics['dice_mean']:.3f}, {metrics['dice_median']:.3f}, "
        f"{metrics['dice_low']:.3f}",
        "median error of the upper and the lower boundary": f"{metrics['outer_rows']:.2f} and "
        f"{metrics['inner_rows']:.2f} rows of {finder.rows}",
        "boundaries within 1.645 of their standard deviations": f"{metrics['coverage']:.1%}",
        "columns for which it is right whether there is wall": f"{metrics['found']:.1%}",
    }
    return _card(
        "The corneoscleral wall in a raw B-scan of a front eye",
        f"""Sees a frame reduced to {finder.rows} x {finder.columns} pixels, without its scale, and answers for every \
second column
with the rows of the wall's upper and lower boundary as distributions, and with the probability that there is wall.
`scleraforce segment` refines its wall on the full frame and checks it against the wall of the other method.""",
        {
            "What it learned from": f"""{scenes["training"]} drawn scenes, each seen once, and {scenes["validation"]} \
others to validate. No real scan is among them. `[scenes]` in `study.toml`
has the range of everything that is drawn: cornea, limbus and sclera or half-spheres, dents, what lies over and below
the wall, and the scanner. {RANGES}

{_table(_ranges(study.scenes.window))}""",
            "What it reaches on drawn scenes": _table(reached),
            "What it must not be used for": f"""- Not for patients: a research tool, validated on drawings, and on \
real scans by eye only.
- Not alone: its boundaries are a row of {finder.rows} fine, and its uncertainty is that of drawings. Where light does
  not reach the wall it says where the wall would be.
- Scenes that nobody drew - other tissues, a lid that closes the eye, a scan from below - may be answered with a wall.

{_made(record, finder.seed, "--kind wall-finder")}""",
        },
    )


def _card(title: str, does: str, sections: Mapping[str, str]) -> str:
    return "\n\n".join([f"# {title}", does, *(f"## {name}\n{text}" for name, text in sections.items())]) + "\n"


def _table(rows: Mapping[str, str]) -> str:
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())])


def _made(record: Mapping[str, Any], seed: int, what: str) -> str:
    made = record["provenance"]
    return (
        f"Made by scleraforce {made['scleraforce']}, PyTorch {made['torch']}, seed {seed}. `scleraforce train {what} "
        "--study study.toml --out MODEL` makes it again."
    )


def _pixels(study: Study) -> str:
    return f"{study.slice.rows} x {study.slice.columns} pixels of {from_si(study.slice.pixel_m, 'mm'):g} mm"


def _bounds_mn(study: Study) -> tuple[float, ...]:
    return tuple(from_si(bound, "mn") for bound in study.classes.bounds_n)


def _ranges(section: Any) -> dict[str, str]:
    """Return the values of a study's section, in its keys' units, by key; without sections within it."""
    found = {}
    for item in fields(section):
        value = map_numbers(getattr(section, item.name), field_unit(item).from_si)
        values = value.values if isinstance(value, Choice) else value if isinstance(value, tuple) else (value,)
        if isinstance(value, Range):
            found[f"`{field_key(item)}`"] = " to ".join(dict.fromkeys(f"{end:.6g}" for end in value.bounds))
        elif all(isinstance(each, int | float) for each in values):
            found[f"`{field_key(item)}`"] = ", ".join(f"{each:.6g}" for each in values)
    return found


def _percent(share: float) -> str:
    return f"{from_si(share, 'percent'):.2f} %"
