"""Model cards: what a network was made from, what it reaches, and what it must not be used for (cards.toml)."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib.resources import files
from typing import Any

from scleraforce.reader.metrics import Proportion
from scleraforce.study import Choice, Range, Study
from scleraforce.study.fields import field_key, field_unit, map_numbers
from scleraforce.units import from_si

INTENDED = "Research on force reading from OCT. Not a medical device; not for use on patients."
RANGES = "Keys of `study.toml` and their values; of several, or between two, one is drawn for each sample."


def classifier_card(study: Study, record: Mapping[str, Any], shares: Sequence[Proportion]) -> str:
    """Return the card of a classifier with its recall of each class, from its study and what `model.json` keeps."""
    metrics, network = record["metrics"], study.network
    sizes = (study.slice.rows * study.slice.columns, *network.hidden, len(study.classes.bounds_n) + 1)
    walls = {
        f"wall of {from_si(group.thickness_m, 'um'):g} µm": f"{group.images} images, "
        f"0 to {from_si(group.max_force_n, 'mn'):g} mN"
        for group in study.dataset.group
    }
    ranges = {**_ranges(study.eye), **_ranges(study.needle), **_ranges(study.dataset)}
    ranges.pop("`thickness_um`")  # of the groups' walls
    accuracy, least, most = map(_percent, (metrics["validation_accuracy"], *metrics["validation_interval"]))
    return _card(
        study,
        record,
        {**walls, **ranges},
        **_of_slices(study),
        sizes="-".join(map(str, sizes)),
        mirrored=";\nhalf of the slices shown with left and right exchanged" if network.mirror else "",
        accuracy=accuracy,
        least=least,
        most=most,
        recall=", ".join(_percent(share.value) for share in shares),
    )


def reader_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card of a reader, from its study and what `model.json` keeps."""
    intervals, (least, most) = record.get("intervals"), record["metrics"]["validation_interval"]
    measured = "Its intervals are as its methods say: they were not measured on whole eyes."
    if intervals is not None:
        measured = f"Its intervals were measured on {intervals['eyes']} eyes: {intervals['source']}."
    more = {
        "measured": measured,
        "curves_um": from_si(record["library"]["curves_m"], "um"),
        "least": least,
        "most": most,
    }
    return _card(study, record, _ranges(study.reader), **more, **_of_slices(study))


def raw_reader_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card of a raw reader, from its study and what `model.json` keeps."""
    raw, intervals = study.raw_reader, record.get("intervals")
    measured = "Its intervals are as the network says, and were measured on no eye."
    if intervals is not None:
        held_on = f"{intervals['eyes']} {intervals['source']}"
        measured = f"Its intervals were stretched to hold on {held_on}, calibrated before."
    width_mm, depth_mm = from_si(raw.rows * raw.row_m, "mm"), from_si(raw.columns * raw.column_m, "mm")
    again = _made(record, raw.seed, "LIBRARY --kind raw-reader")
    return _card(study, record, _ranges(raw), width_mm=width_mm, depth_mm=depth_mm, measured=measured, again=again)


def finder_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card of a wall finder, from its study and what `model.json` keeps."""
    again = _made(record, study.wall_finder.seed, "--kind wall-finder")
    return _card(study, record, _ranges(study.scenes.window), again=again)


def _card(study: Study, record: Mapping[str, Any], rows: Mapping[str, str], **fields_of_kind: Any) -> str:
    """Return the card of a kind: its template, filled from the study, the record, and fields of its own."""
    templates = tomllib.loads(files("scleraforce.learning").joinpath("cards.toml").read_text(encoding="utf-8"))
    table = "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows.items())])
    template: str = templates[record["kind"]]
    common = {**record, "study": study, "table": table, "keys": RANGES, "intended": INTENDED}
    return template.format(**common, **fields_of_kind)


def _of_slices(study: Study) -> dict[str, Any]:
    """Return the fields of a kind that sees slices and answers with classes."""
    low_mn, high_mn = (from_si(bound, "mn") for bound in study.classes.bounds_n)
    cut = study.slice
    pixels = f"{cut.rows} x {cut.columns} pixels of {from_si(cut.pixel_m, 'mm'):g} mm"
    return {"pixels": pixels, "low_mn": low_mn, "high_mn": high_mn}


def _made(record: Mapping[str, Any], seed: int, what: str) -> str:
    made = record["provenance"]
    return (
        f"Made by scleraforce {made['scleraforce']}, PyTorch {made['torch']}, seed {seed}. `scleraforce train {what} "
        "--study study.toml --out MODEL` makes it again."
    )


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
