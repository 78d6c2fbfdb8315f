"""Fingerprints of behaviour: a few numbers that move when the training of a model
would.

PYTHONPATH=benchmarks python -m provenance.fingerprint FOLDER     (`make model`, ...)

Parts of a training are computed at small size, and each result is reduced to at most 64
numbers, which `model.json` keeps. Code that only runs in cases that the small size
lacks is not covered.

How far an entry may move is decided by today's code: the tolerance in `model.json` only
shows what it was when the model was made. There are two sorts. Load paths, samples,
scenes and the steps of a descent follow from the study and its seeds, so their
tolerance is numerical: what other processors change. The results of calibrations and
fits, which the intervals rest on, depend on where a search starts and ends. Their
tolerance is a share of what is claimed: a tenth of half an interval, or of the stated
standard deviation.
"""

import json
import sys
from dataclasses import asdict, dataclass, replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scleraforce.base.errors import CalibrationError
from scleraforce.base.units import from_si
from scleraforce.lab.training.classifier_training import (
    Samples,
    classes_at_modulus,
    fit_classifier,
    with_half_weights,
)
from scleraforce.lab.training.force_reader_training import fit_reader
from scleraforce.lab.training.gradient_descent import torch
from scleraforce.lab.training.interval_measurement import (
    STREAM,
    calibrated,
    draw_eye,
    draw_frames,
    measuring,
    trait_factors,
)
from scleraforce.lab.training.reader_samples import (
    CHUNK,
    VALIDATION_CHUNK,
    ReaderSamples,
    SampleSource,
    draw_seen,
)
from scleraforce.lab.training.slice_dataset import SampleSimulator, plan_dataset
from scleraforce.lab.training.wall_network_training import (
    VALIDATION_SCENES,
    fit_wall_finder,
    scene_batch,
)
from scleraforce.library import Library, load_library, save_library
from scleraforce.library.library_plan import plan_library
from scleraforce.library.library_store import (
    create_library,
    open_library,
    solve_path,
    write_library_unit,
)
from scleraforce.library.stiffened_walls import ReducedCurves, StiffenedWalls
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.graded_mesh import study_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.records.model_folder import (
    LIBRARY_FILE,
    NETWORK_FILE,
    RECORD_FILE,
    folder_study,
    read_folder,
)
from scleraforce.records.study import Study

# name of a result -> its "tolerance" and "values", as in `model.json`
Fingerprint = dict[str, dict[str, Any]]

# maximum numbers of means and of single values in an entry
MEANS = 32
PICKS = 31


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """How far the numbers of an entry may be from the recorded ones.

    Limits add up: `of_largest` is a share of the entry's largest number, `of_each` a
    share of each number, `absolute` in the entry's unit. `strays`: the share of numbers
    that may be beyond the limit. `sort`: compare the smallest number with the smallest
    one, and so on.
    """

    of_largest: float = 0.0
    of_each: float = 0.0
    absolute: float = 0.0
    strays: float = 0.0
    sort: bool = False


# Numerical tolerances. Other BLAS kernels and processors (Prescott, Haswell, without
# AVX) move doubles by less than 1e-9 of the largest number, network inputs by 3e-8, the
# numbers of a descent by 5e-4; a pixel may turn.
SAME = Tolerance()
DOUBLE = Tolerance(of_largest=1e-6)
SINGLE = Tolerance(of_largest=1e-5)
PIXELS = Tolerance(of_largest=1e-3)
DESCENT = Tolerance(of_largest=1e-2)

# Tolerances of claims, as a share of half an interval. Where errors are normal, 89.5 %
# of the readings stay within intervals of 90 % if all are off by a tenth, and 86 % if
# the intervals are a tenth narrower; 210 eyes show 90 % to 4 % (two standard
# deviations).
CLAIMED = 0.1
# Scores are distances in half intervals. The factors of intervals follow from their
# distribution, so it does not matter which reading has which score: a search that stops
# elsewhere exchanges them. A better start may take one of the 102 readings to another
# minimum, which moves two of the 63 numbers: a mean and a value. Other starts move none
# or one by more than a tenth, a library that is 2 % stiffer nine.
SCORES = Tolerance(absolute=CLAIMED, strays=2 / 63, sort=True)
# A reading at the edge of a trait, such as 10 mN, may have one trait more or less.
TRAITS = Tolerance(of_largest=1e-6, strays=0.05)
# Factors multiply half intervals.
FACTORS = Tolerance(of_each=CLAIMED)

PATHS = (0.0, 0.5, 1.0)  # the first load path, one in the middle, the last
SAMPLES = 450  # samples of two tissues
# numbers of the virtual eyes tried for scores: the library may lack one
EYE = 1
LAST_EYE = 9
EYES = 30  # eyes that the scores are shared among
# slices and contacts of each of the first two groups of a data set
SLICES = 24
CONTACTS = 3


def item(values: ArrayLike, tolerance: Tolerance = DOUBLE) -> dict[str, Any]:
    """Return an array as an entry of a fingerprint: share of numbers, means of even
    parts, values at even places.
    """
    limits = {name: limit for name, limit in asdict(tolerance).items() if limit}
    flat = np.asarray(values, dtype=np.float64).ravel()
    if not flat.size:
        return {"tolerance": limits, "values": "0"}

    known = np.isfinite(flat)
    filled = np.where(known, flat, 0.0)
    means = [part.mean() for part in np.array_split(filled, min(MEANS, flat.size))]
    picks = filled[np.linspace(0, flat.size - 1, min(PICKS, flat.size)).astype(np.intp)]

    return {
        "tolerance": limits,
        "values": " ".join(f"{value:.9g}" for value in [known.mean(), *means, *picks]),
    }


def moved(before: Fingerprint, now: Fingerprint) -> list[str]:
    """Return the names of the entries that differ by more than the tolerance of `now`,
    or that only one of both has.
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
    if len(old) == 1:
        return True

    tolerance = _tolerance_of(now)
    old = old[1:]
    new = new[1:]
    if tolerance.sort:
        old = np.sort(old)
        new = np.sort(new)

    size = np.abs(old)
    limits = tolerance.of_largest * size.max() + tolerance.of_each * size
    beyond = np.abs(new - old) > limits + tolerance.absolute

    return bool(beyond.mean() <= tolerance.strays)


def _tolerance_of(entry: dict[str, Any]) -> Tolerance:
    """Return the tolerance of an entry; a number, of older models, is a share of the
    largest.
    """
    limits = entry["tolerance"]
    if isinstance(limits, float):
        return Tolerance(of_largest=limits)
    return Tolerance(**limits)


def reader_fingerprint(study: Study, library: Library) -> Fingerprint:
    """Return the fingerprint of a reader's network: load paths, a small library,
    samples, first steps of a descent.
    """
    reader = study.reader
    source = SampleSource(library, study.reader, study.slice)
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
        # the pressure of a sealed eye is found within 1e-5
        "seen boundaries": item(seen, Tolerance(of_largest=1e-5)),
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

    tissue = _calibrated_tissue(study, library)
    of_sd = Tolerance(absolute=CLAIMED * tissue[-1] if tissue else 0.0)

    return {
        "calibrated tissue": item(tissue, of_sd),
        "scores": item([entry.score for entry in scores], SCORES),
        "traits": item([len(entry.traits) for entry in scores], TRAITS),
        "factors": item(
            [factor for traits in values for _, factor in sorted(traits.items())],
            FACTORS,
        ),
    }


def _calibrated_tissue(study: Study, library: Library) -> list[float]:
    """Return the stiffening, the modulus and its standard deviation, MPa, found from
    one frame; nothing if the library lacks them.
    """
    rng = np.random.default_rng([study.reader.seed, STREAM])
    try:
        eye = draw_eye(study, library, EYE, rng)
        known, _ = calibrated(
            eye, draw_frames(eye, study, 2, rng), study, library, rng, range(1)
        )
    except CalibrationError:
        return []

    if known.eye.modulus is None:
        return []

    return [
        known.eye.stiffening or 0.0,
        *(
            from_si(each, "mpa")
            for each in (known.eye.modulus.mean_pa, known.eye.modulus.sd_pa)
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
    fitted = fit_classifier(
        small.network, seen, unseen, len(study.classes.bounds_n) + 1
    )
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
        # a folder's file has single precision
        "walls of a small library": item(walls.curves_sbnc, SINGLE),
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
