"""Small runs with known results: one load path, one frame read, one training."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from scleraforce.errors import InputError
from scleraforce.installation.finding import Finding
from scleraforce.known.eye import OPEN, Known, Modulus
from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.optics import Pose, sample_optics
from scleraforce.library.sections import cut_surfaces
from scleraforce.mechanics.axisymmetric.path import AxisymmetricPath, axisymmetric_path
from scleraforce.models.folder import SHIPPED_READER
from scleraforce.reader import ForceReader, load_force_reader
from scleraforce.recording.pixels import PixelScale
from scleraforce.study import Study
from scleraforce.units import from_si

SOLVE, READ, TRAIN = "a solve", "a reading", "a training"
THICKNESS_M, MODULUS_PA, IOP_PA, GAP_M, DEPTH_M = 0.6e-3, 0.3e6, 270.0, 0.6e-3, 0.5e-3
TIP_M = 1.5e-3
FORCES_AGREE = 2e-3  # of a path and of the library between its paths
READ_WITHIN_N = 1e-3
AGAIN = "install anew in a fresh environment; if it stays, report it with the output of `scleraforce doctor --json`"


def tried(name: str) -> Finding:
    """Return what became of a trial, and how long it took; whatever it raises is a finding, too."""
    start = perf_counter()
    try:
        found = TRIALS[name]()
    except Exception as fault:
        return Finding(name, "failed", f"{type(fault).__name__}: {fault}", AGAIN)
    return replace(found, found=f"{found.found}, {perf_counter() - start:.1f} s") if found.state == "ok" else found


def _solve() -> Finding:
    """Follow a load path and compare it with the library of the shipped reader, which other machines have solved."""
    walls = np.array([THICKNESS_M]), np.array([IOP_PA / MODULUS_PA])
    expected = float(_reader().library.forces(*walls, np.array([TIP_M]))[0])
    solved = float(_path().force_ratio_m2[-1])
    words = f"{from_si(solved * MODULUS_PA, 'mn'):.2f} mN at a dent of {from_si(TIP_M, 'mm'):g} mm"
    if abs(solved / expected - 1.0) > FORCES_AGREE:
        return Finding(SOLVE, "failed", f"{words}, {from_si(expected * MODULUS_PA, 'mn'):.2f} are right", AGAIN)
    return Finding(SOLVE, "ok", words)


def _read() -> Finding:
    """Draw a frame of that wall and read it."""
    study, path, rng = Study(), _path(), np.random.default_rng(0)
    section = Pose(lateral_m=0.0, depth_m=DEPTH_M, tilt_rad=0.0).place(cut_surfaces(path.curves_sbnc[-1], GAP_M))
    frame = render_bscan(section, study.oct, sample_optics(study.phantom, study.oct, rng), rng).frame
    scale = PixelScale(lateral_m=study.oct.width_m / study.oct.columns, depth_m=study.oct.depth_m / study.oct.rows)
    known = Known(modulus=Modulus.stated(MODULUS_PA), iop_pa=IOP_PA, thickness_m=THICKNESS_M, gap_m=GAP_M, globe=OPEN)
    answer, true_n = _reader().read(frame, scale, known), float(path.force_ratio_m2[-1]) * MODULUS_PA
    if answer.force_n is None:
        return Finding(READ, "failed", f"a frame of {from_si(true_n, 'mn'):.1f} mN: {answer.reason}", AGAIN)
    words = f"{from_si(answer.force_n, 'mn'):.1f} mN read of {from_si(true_n, 'mn'):.1f} mN"
    if abs(answer.force_n - true_n) > READ_WITHIN_N:
        return Finding(READ, "failed", words, AGAIN)
    return Finding(READ, "ok", words)


def _train() -> Finding:
    """Train a reader for one short epoch: it is worth nothing, but all that trains has run."""
    try:
        from scleraforce.learning.reader.train import train_reader
    except InputError as fault:
        return Finding(TRAIN, "missing", str(fault))
    study = Study()
    small = replace(
        study.reader, epochs=1, samples_per_epoch=200, validation_samples=50, interval_eyes=0, channels=(4, 4),
        hidden=(8,),
    )  # fmt: skip
    with TemporaryDirectory(prefix="scleraforce-doctor-") as folder:
        trained = train_reader(_reader().library, replace(study, reader=small), Path(folder) / "model", workers=1)
    return Finding(TRAIN, "ok", f"{trained.samples} samples")


@cache
def _reader() -> ForceReader:
    return load_force_reader(SHIPPED_READER)


@cache
def _path() -> AxisymmetricPath:
    library = _reader().library
    return axisymmetric_path(
        library.radius_m,
        THICKNESS_M,
        library.poisson_ratio,
        library.needle_radius_m,
        IOP_PA / MODULUS_PA,
        tips_m=np.linspace(0.0, TIP_M, 5)[1:],
    )


TRIALS: Mapping[str, Callable[[], Finding]] = {SOLVE: _solve, READ: _read, TRAIN: _train}
