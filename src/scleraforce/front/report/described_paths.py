"""Descriptions of files and folders for `scleraforce show`: the kinds, how they are
recognised, and a study.
"""

import tomllib
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from scleraforce.base.errors import InputError
from scleraforce.base.plain_json import parse_json
from scleraforce.base.units import from_si
from scleraforce.base.whole_files import KINDS, read_bytes
from scleraforce.front.report.description import (
    LOG_FILES,
    RANGE,
    Description,
    range_text,
)
from scleraforce.front.report.model_figures import draw_model
from scleraforce.records.model_folder import (
    RECORD_FILE,
    SHIPPED,
    STUDY_FILE,
    path_or_bundled,
)
from scleraforce.records.study import Study, format_study, read_study, study_hash

KNOWN = (
    f"give a study, library, data set, model (or a bundled one: {', '.join(SHIPPED)}),"
    " recording, calibration or decision log"
)
RECORDING_FILE = "recording.toml"
STORE_FILE = "zarr.json"
# files of folders
PARTS = {
    RECORDING_FILE: "recording",
    RECORD_FILE: "model",
    STORE_FILE: "store",
}
ENDINGS = {
    ".toml": "study",
    ".json": "calibration",
    ".jsonl": "decision log",
    ".npz": "library",
}


def thing_at(path: Path, model: Path | None = None) -> Description:
    """Return the description of a file, folder or bundled model; `model`: checks its
    limits; raises `InputError`.
    """
    found = path_or_bundled(path)
    if found.name in PARTS and found.is_file():
        raise InputError(
            f"{found}: a part of a {PARTS[found.name]}; give its folder, {found.parent}"
        )

    kind = ENDINGS.get(found.suffix.lower()) if found.is_file() else None
    if found.is_dir():
        kind = _kind_of_folder(found)

    if kind is None:
        raise InputError(
            f"{found}: {'' if found.exists() else 'no such file or folder; '}{KNOWN}"
        )
    if model is not None and kind != "recording":
        raise InputError(f"`model`: {path} is a {kind}; a model reads recordings")
    if kind == "study":
        return show_study(found / STUDY_FILE if found.is_dir() else found)

    # with all packages that make or read them
    shown = import_module("scleraforce.front.report.described_artefacts")
    show: Callable[..., Description] = getattr(shown, f"show_{kind.replace(' ', '_')}")

    return show(found) if model is None else show(found, model)


def _kind_of_folder(path: Path) -> str | None:
    for name, kind in PARTS.items():
        if (path / name).exists():
            return _kind_of_store(path / name) if kind == "store" else kind
    if any(next(folder.glob(LOG_FILES), None) for folder in (path, path / "log")):
        return "decision log"
    return "study" if (path / STUDY_FILE).exists() else None


def _kind_of_store(file: Path) -> str:
    try:
        content = parse_json(read_bytes(file, KINDS["store metadata"]))
    except ValueError as fault:
        raise InputError(f"{file}: {fault}") from fault

    attributes = content.get("attributes") if isinstance(content, dict) else None
    schema = attributes.get("schema") if isinstance(attributes, dict) else None
    return "data set" if str(schema).startswith("scleraforce-dataset") else "library"


def show_study(path: Path) -> Description:
    """Describe a study file."""
    study = read_study(path)
    eye = study.eye
    needle = study.needle
    scan = study.oct
    changed = changed_keys(study)
    bounds_mn = [from_si(bound, "mn") for bound in study.classes.bounds_n]
    images = sum(group.images for group in study.dataset.group)
    rows = (
        (
            "eye",
            (
                f"radius {from_si(eye.radius_m, 'mm'):g} mm, wall of"
                f" {range_text(eye.thickness_m.bounds, 'um', 'µm')},"
                f" {range_text([eye.youngs_modulus_pa], 'mpa', 'MPa')} at"
                f" {range_text([eye.iop_pa], 'mmhg', 'mmHg')}, globe {study.globe.kind}"
            ),
        ),
        (
            "needle",
            (
                f"{from_si(needle.outer_diameter_m, 'mm'):g} mm thick, "
                f"{range_text(needle.polar_angle_rad.bounds, 'deg', '°')} from the pole"
                f", up to {from_si(needle.max_force_n, 'mn'):g} mN"
            ),
        ),
        (
            "scanner",
            (
                f"{scan.columns} x {scan.rows} pixels of {scan.bits} bits over "
                f"{from_si(scan.width_m, 'mm'):g} x {from_si(scan.depth_m, 'mm'):g} mm"
            ),
        ),
        (
            "classes",
            f"bounds at {' and '.join(f'{bound:g}' for bound in bounds_mn)} mN",
        ),
        ("mechanics", study.mechanics.kind),
        (
            "data set",
            (
                f"{images} slices in {len(study.dataset.group)} groups, seed"
                f" {study.dataset.seed}"
            ),
        ),
        ("SHA-256", study_hash(study)),
        ("changed", f"{len(changed) or 'no'} keys, against the paper's study"),
    )
    lines = tuple(
        f"  {key} = {_words(value)} (the paper's: {_words(paper)})"
        for key, (value, paper) in changed.items()
    )
    facts = {
        "study_sha256": study_hash(study),
        "mechanics": study.mechanics.kind,
        "bounds_mn": bounds_mn,
        "images": images,
        "changed": {key: value for key, (value, _) in changed.items()},
    }

    return Description(
        kind="study",
        facts=facts,
        rows=rows,
        lines=lines,
        draw=lambda: draw_model(study),
    )


def changed_keys(study: Study) -> dict[str, tuple[Any, Any]]:
    r"""Return the keys in which a study differs from the paper's, with both values
    (None: no such key).

    >>> from scleraforce.records.study import parse_study
    >>> changed_keys(parse_study("[eye]\nradius_mm = 11.0"))
    {'eye.radius_mm': (11.0, 12.0)}
    """
    own, paper = (
        dict(_keys(tomllib.loads(format_study(each)), "")) for each in (study, Study())
    )
    return {
        key: (own.get(key), paper.get(key))
        for key in {**own, **paper}
        if own.get(key) != paper.get(key)
    }


def _keys(table: Mapping[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict) and value.keys() != RANGE:
            yield from _keys(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _words(value: Any) -> str:
    if value is None:
        return "missing"
    return (
        f"{value['min']} to {value['max']}" if isinstance(value, dict) else str(value)
    )
