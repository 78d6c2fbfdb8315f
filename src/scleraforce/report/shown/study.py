"""A study in a few lines: its eyes, its needle, its scanner, and in which keys it is not the paper's."""

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from scleraforce.report.model_figures import draw_model
from scleraforce.report.shown.kinds import Thing, span
from scleraforce.study import Study, format_study, read_study, study_hash
from scleraforce.units import from_si

RANGE = {"min", "max"}  # a value, not a table of keys


def show_study(path: Path) -> Thing:
    """Look at a study file.

    Raises:
        StudyError: it cannot be used.
    """
    study = read_study(path)
    eye, needle, scan = study.eye, study.needle, study.oct
    changed = changed_keys(study)
    bounds_mn = [from_si(bound, "mn") for bound in study.classes.bounds_n]
    images = sum(group.images for group in study.dataset.group)
    rows = (
        ("eye", f"radius {from_si(eye.radius_m, 'mm'):g} mm, wall of {span(eye.thickness_m.bounds, 'um', 'µm')}, "
                f"{span([eye.youngs_modulus_pa], 'mpa', 'MPa')} at {span([eye.iop_pa], 'mmhg', 'mmHg')}, "
                f"globe {study.globe.kind}"),
        ("needle", f"{from_si(needle.outer_diameter_m, 'mm'):g} mm thick, "
                   f"{span(needle.polar_angle_rad.bounds, 'deg', '°')} from the pole, "
                   f"up to {from_si(needle.max_force_n, 'mn'):g} mN"),
        ("scanner", f"{scan.columns} x {scan.rows} pixels of {scan.bits} bits over "
                    f"{from_si(scan.width_m, 'mm'):g} x {from_si(scan.depth_m, 'mm'):g} mm"),
        ("classes", f"bounds at {' and '.join(f'{bound:g}' for bound in bounds_mn)} mN"),
        ("mechanics", study.mechanics.kind),
        ("data set", f"{images} slices in {len(study.dataset.group)} groups, seed {study.dataset.seed}"),
        ("SHA-256", study_hash(study)),
        ("changed", f"{len(changed) or 'no'} keys, against the paper's study"),
    )  # fmt: skip
    lines = tuple(
        f"  {key} = {_words(value)} (the paper's: {_words(paper)})" for key, (value, paper) in changed.items()
    )
    facts = {
        "study_sha256": study_hash(study),
        "mechanics": study.mechanics.kind,
        "bounds_mn": bounds_mn,
        "images": images,
        "changed": {key: value for key, (value, _) in changed.items()},
    }
    return Thing(kind="study", facts=facts, rows=rows, lines=lines, draw=lambda: draw_model(study))


def changed_keys(study: Study) -> dict[str, tuple[Any, Any]]:
    r"""Return the keys in which a study is not the paper's: key to its own value and the paper's (None: not there).

    >>> from scleraforce.study import parse_study
    >>> changed_keys(parse_study("[eye]\nradius_mm = 11.0"))
    {'eye.radius_mm': (11.0, 12.0)}
    """
    own, paper = (dict(_keys(tomllib.loads(format_study(each)), "")) for each in (study, Study()))
    return {key: (own.get(key), paper.get(key)) for key in {**own, **paper} if own.get(key) != paper.get(key)}


def _keys(table: Mapping[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict) and value.keys() != RANGE:
            yield from _keys(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def _words(value: Any) -> str:
    if value is None:
        return "not there"
    return f"{value['min']} to {value['max']}" if isinstance(value, dict) else str(value)
