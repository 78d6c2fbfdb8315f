"""Fingerprints of behaviour: a few numbers that move when the training of a model
would.

PYTHONPATH=benchmarks python -m provenance.fingerprint FOLDER     (`make model`, ...)

Parts of a training are computed at small size, and each result is reduced to at most 64
numbers, which `model.json` keeps with a tolerance. Code that only runs in cases that
the small size lacks is not covered.
"""

import json
import sys
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scleraforce.errors import CalibrationError
from scleraforce.learning.classifier import (
    Samples,
    classes_at_modulus,
    fit,
    with_half_weights,
)
from scleraforce.learning.dataset import SampleSimulator, plan_dataset
from scleraforce.learning.descent import torch
from scleraforce.learning.reader import fit_reader
from scleraforce.learning.samples import (
    CHUNK,
    VALIDATION_CHUNK,
    ReaderSamples,
    Source,
    draw_seen,
)
from scleraforce.learning.virtual_eyes import (
    STREAM,
    calibrated,
    draw_eye,
    draw_frames,
    measuring,
    trait_factors,
)
from scleraforce.learning.wall_finder import (
    VALIDATION_SCENES,
    fit_wall_finder,
    scene_batch,
)
from scleraforce.library import Library, load_library, save_library
from scleraforce.library.plan import plan_library
from scleraforce.library.stiffened import ReducedCurves, StiffenedWalls
from scleraforce.library.store import (
    create_library,
    open_library,
    solve_path,
    write_library_unit,
)
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.graded import study_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.models import (
    LIBRARY_FILE,
    NETWORK_FILE,
    RECORD_FILE,
    folder_study,
    read_folder,
)
from scleraforce.study import Study
from scleraforce.units import from_si

# name of a result -> its "tolerance" and "values", as in `model.json`
Fingerprint = dict[str, dict[str, Any]]

# of an item, at most
MEANS = 32
PICKS = 31
# Relative to an item's largest number. Other BLAS kernels and processors (Prescott,
# Haswell, without AVX) move doubles by less than 1e-9, network inputs by 3e-8, scores
# of fits by 2e-4, a descent by 5e-4; a pixel may turn.
DOUBLE = 1e-6
SINGLE = 1e-5
PIXELS = 1e-3
SCORES = 3e-3
DESCENT = 1e-2

PATHS = (0.0, 0.5, 1.0)  # of the load paths: the first, one in the middle, the last
SAMPLES = 450  # of two tissues
# virtual eyes that are tried for scores: the library may lack one
EYE = 1
LAST_EYE = 9
EYES = 30  # that scores are shared among
# of each of the first two groups
SLICES = 24
CONTACTS = 3


def item(values: ArrayLike, tolerance: float = DOUBLE) -> dict[str, Any]:
    """Return an array as an entry of a fingerprint: share of numbers, means of even
    parts, values at even places.
    """
    flat = np.asarray(values, dtype=np.float64).ravel()
    if not flat.size:
        return {"tolerance": tolerance, "values": "0"}

    known = np.isfinite(flat)
    filled = np.where(known, flat, 0.0)
    means = [part.mean() for part in np.array_split(filled, min(MEANS, flat.size))]
    picks = filled[np.linspace(0, flat.size - 1, min(PICKS, flat.size)).astype(np.intp)]

    return {
        "tolerance": tolerance,
        "values": " ".join(f"{value:.9g}" for value in [known.mean(), *means, *picks]),
    }


def moved(before: Fingerprint, now: Fingerprint) -> list[str]:
    """Return the names of the entries that differ by more than their tolerance, or that
    only one of both has.
    """
    both = before.keys() & now.keys()
    return sorted(
        {*before, *now} - {name for name in both if _agree(before[name], now[name])}
    )


def _agree(before: dict[str, Any], now: dict[str, Any]) -> bool:
    old, new = (
        np.array(entry["values"].split(), dtype=np.float64) for entry in (before, now)
    )
    if old.shape != new.shape or old[0] != new[0]:  # the first value is a share
        return False

    scale = np.abs(old[1:]).max(initial=0.0)
    return bool(np.abs(new[1:] - old[1:]).max(initial=0.0) <= now["tolerance"] * scale)


def reader_fingerprint(study: Study, library: Library) -> Fingerprint:
    """Return the fingerprint of a reader's network: load paths, a small library,
    samples, first steps of a descent.
    """
    reader = study.reader
    source = Source(library, study.reader, study.slice)
    samples = source.chunk(1, SAMPLES)
    rng = np.random.default_rng(reader.seed)
    _, _, seen = draw_seen(source.library, reader, study.slice, SAMPLES, rng)
    few = replace(study, reader=replace(reader, epochs=1, samples_per_epoch=CHUNK))
    fitted = fit_reader(few, lambda _: samples, 0)
    network = fitted.network
    slices = torch.from_numpy((samples.slices > 0).astype(np.float32))

    with torch.inference_mode():
        inputs = network.features(slices)
        forces, places = network(slices, torch.from_numpy(samples.given))

    return {
        **_library_items(study),
        **_sample_items("training", samples),
        **_sample_items("validation", source.chunk(VALIDATION_CHUNK, 50)),
        "seen boundaries": item(
            seen, 1e-5
        ),  # the pressure of a sealed eye is found within 1e-5
        "network inputs": item(inputs, SINGLE),
        "training loss": item(fitted.training_loss, DESCENT),
        "trained forces": item(forces, DESCENT),
        "trained places": item(places, DESCENT),
    }


def interval_fingerprint(study: Study, library: Library, network: bytes) -> Fingerprint:
    """Return the fingerprint of a reader's intervals: the tissue that a calibration
    finds, an eye's scores, factors.
    """
    walls = library.walls
    curves = library.walls.curves
    assert isinstance(curves, ReducedCurves)  # of a model folder
    softest = ReducedCurves(
        curves.rows.share(0, curves.shape[0]), (1, *curves.shape[1:])
    )
    of_one = StiffenedWalls(
        stiffening=walls.stiffening[:1],
        force_ratio_btpd=walls.force_ratio_btpd[:1],
        displaced_btpd=walls.displaced_btpd[:1],
        undented_btpbnc=walls.undented_btpbnc[:1],
        curves=softest,
    )
    scores_of = measuring(study, replace(library, walls=of_one), network)
    scores = next(filter(None, map(scores_of, range(EYE, LAST_EYE))), [])
    # one eye makes no factors: scores of its traits are drawn for many
    rng = np.random.default_rng(0)
    many = [
        replace(entry, eye=str(n % EYES), score=rng.lognormal())
        for n, entry in enumerate(scores)
    ]
    factors = trait_factors(many)
    values = [
        factors[method][modulus]
        for method in sorted(factors)
        for modulus in sorted(factors[method])
    ]

    return {
        "calibrated tissue": item(_calibrated_tissue(study, library), SCORES),
        "scores": item([entry.score for entry in scores], SCORES),
        "traits": item([len(entry.traits) for entry in scores]),
        "factors": item(
            [factor for traits in values for _, factor in sorted(traits.items())],
            SCORES,
        ),
    }


def _calibrated_tissue(study: Study, library: Library) -> list[float]:
    """Return the tissue and the modulus, MPa, found from one frame; nothing if the
    library lacks them.
    """
    rng = np.random.default_rng([study.reader.seed, STREAM])
    try:
        eye = draw_eye(study, library, EYE, rng)
        known, _ = calibrated(
            eye, draw_frames(eye, study, 2, rng), study, library, rng, range(1)
        )
    except CalibrationError:
        return []

    if known.modulus is None:
        return []

    return [
        known.stiffening or 0.0,
        *(
            from_si(each, "mpa")
            for each in (known.modulus.mean_pa, known.modulus.sd_pa)
        ),
    ]


def classifier_fingerprint(study: Study) -> Fingerprint:
    """Return the fingerprint of a classifier of a study: slices of linear walls, on a
    coarse mesh, and a descent.

    Slices of finite strain come from a library, whose behaviour `reader_fingerprint`
    covers.
    """
    groups = tuple(replace(group, images=SLICES) for group in study.dataset.group[:2])
    small = replace(
        study,
        mesh=replace(study.mesh, core=4, rings=8),
        dataset=replace(study.dataset, contacts=CONTACTS, group=groups),
        network=replace(study.network, epochs=1, batch_size=SLICES // 2),
    )
    wall = LinearWall(study_mesh(small, groups[0].thickness_m), study.eye.poisson_ratio)
    needle = wall.needle_cnc(
        [Contact(polar_rad=0.3, azimuth_rad=0.2)], 0.5 * study.needle.outer_diameter_m
    )
    plan = plan_dataset(small)
    slices = SampleSimulator(small, study.eye.youngs_modulus_pa).slices(plan)
    samples = Samples(slices, classes_at_modulus(plan.force_n, 1.1, study.classes))
    seen, unseen = (
        Samples(slices[part], samples.target[part])
        for part in (~plan.validation, plan.validation)
    )
    fitted = fit(small.network, seen, unseen, len(study.classes.bounds_n) + 1)
    answers = with_half_weights(fitted).probabilities(slices)

    return {
        "resting wall": item([wall.pressure_nc, wall.gravity_nc]),
        "wall under a needle": item(needle),
        **{f"plan {name}": item(column) for name, column in vars(plan).items()},
        **_slice_items("slices", slices),
        "classes": item(samples.target),
        "training loss": item(
            [*fitted.curves.training_loss, *fitted.curves.validation_loss], DESCENT
        ),
        "answers": item(answers, DESCENT),
    }


def finder_fingerprint(study: Study) -> Fingerprint:
    """Return the fingerprint of a wall finder of a study: drawn scenes, and the first
    steps of a descent.
    """
    few = replace(
        study, wall_finder=replace(study.wall_finder, batch_size=4, batches=3)
    )
    batches = [scene_batch(few, number) for number in range(3)]
    unseen = scene_batch(few, 0, VALIDATION_SCENES)
    fitted = fit_wall_finder(few, 0)

    with torch.inference_mode():
        inputs = fitted.network.inputs(torch.from_numpy(unseen.frames))
        rows, wall = fitted.network(torch.from_numpy(unseen.frames))

    return {
        **{
            name: item(np.stack([getattr(batch, name) for batch in batches]), PIXELS)
            for name in ("frames", "boundaries", "weight")
        },
        "network inputs": item(inputs, SINGLE),
        "training loss": item(fitted.training_loss, DESCENT),
        "trained rows": item(rows, DESCENT),
        "trained wall": item(wall, DESCENT),
    }


def _library_items(study: Study) -> Fingerprint:
    """Return entries of load paths of the study's own plan, and of a small library as a
    model folder has it.
    """
    plan = plan_library(study)
    units = [round(share * (plan.paths - 1)) for share in PATHS]
    paths: Fingerprint = {
        f"{what} of path {number}": item(values)
        for number, unit in enumerate([*units, plan.paths])
        for what, values in solve_path(plan, unit)._asdict().items()
    }
    grid = replace(
        study.library, thicknesses=4, tensions=4, stiffenings=1, tips=6, elements=8
    )
    small = plan_library(replace(study, library=grid))

    with TemporaryDirectory() as folder:
        path = Path(folder) / "library.zarr"
        store = create_library(path, small)
        for unit in range(small.units):
            write_library_unit(store, unit, *solve_path(small, unit))

        store.finish()
        file = BytesIO()
        save_library(open_library(path), file)

    library = load_library("library.npz", file.getvalue())
    ratio = library.tension[1] * library.thickness_m[1:3] / library.radius_m
    walls = library.curves(
        library.thickness_m[1:3], ratio, np.array([0.1, 0.3]) * library.max_force_ratio
    )

    return {
        **paths,
        "stiffenings and tensions": item([*plan.stiffening, *plan.tension]),
        "thicknesses and tips": item([*plan.thickness_m, *plan.tip_m]),
        "base of a small library": item(library.stiffness_atpd),
        "walls of a small library": item(
            walls.curves_sbnc, SINGLE
        ),  # within what a folder's file may be off by
    }


def _sample_items(name: str, samples: ReaderSamples) -> Fingerprint:
    return {
        **_slice_items(f"{name} slices", samples.slices),
        f"{name} given": item(samples.given, SINGLE),
        f"{name} forces": item(samples.force_n),
        f"{name} moduli": item(samples.modulus_pa),
        f"{name} places": item(samples.lateral_m),
    }


def _slice_items(name: str, slices: NDArray[np.uint8]) -> Fingerprint:
    """Return entries of the amount of wall in the columns of slices (slice, row,
    column), and of its depth.
    """
    wall = slices / 255.0
    depth = np.arange(slices.shape[1]) @ wall
    return {name: item(wall.sum(axis=1), PIXELS), f"{name}, depth": item(depth, PIXELS)}


def fingerprint_of(path: Path) -> Fingerprint:
    """Return the fingerprint of a model folder's training."""
    folder = read_folder(path)
    study = folder_study(folder)

    kind = folder.record["kind"]
    if kind != "reader":
        return {
            "classifier": classifier_fingerprint,
            "wall-finder": finder_fingerprint,
        }[kind](study)

    library = load_library(LIBRARY_FILE, folder.files[LIBRARY_FILE])
    return reader_fingerprint(study, library) | interval_fingerprint(
        study, library, folder.files[NETWORK_FILE]
    )


if __name__ == "__main__":
    place = Path(sys.argv[1]) / RECORD_FILE
    record = json.loads(place.read_text(encoding="utf-8")) | {
        "fingerprint": fingerprint_of(Path(sys.argv[1]))
    }
    place.write_text(
        json.dumps(record, indent=2, allow_nan=False) + "\n", encoding="utf-8"
    )
