"""Checks of an installation: packages, the machine, and small runs with known
results.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from time import perf_counter
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from packaging.requirements import Requirement
from platformdirs import user_cache_path

from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si, to_si
from scleraforce.base.worker_processes import available_cores
from scleraforce.calibration.start_of_an_eye import first_fit
from scleraforce.fit.curve_placement import PlacesOnFrame, curve_depths
from scleraforce.fit.frames_of_an_eye import EyeToFit, ShownFrame, fit_forces
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.tissue_light import Pose, sample_optics
from scleraforce.lab.training.reader_samples import draw_samples
from scleraforce.library import OUTER
from scleraforce.library.plane_cut import cut_surfaces, highest_depths
from scleraforce.library.sealed_eye import iop_ratio_at_dent, iop_ratio_under_force
from scleraforce.live.repeated_pictures import warm_pictures
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricPath,
    EvenWall,
    axisymmetric_path,
)
from scleraforce.mechanics.elastic_force import driven_back
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.small_matrices import dilatations, inverses
from scleraforce.mechanics.summed_elements import sum_elements
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.recordings.clock_offsets import estimate_clocks
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, sealed_law
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale, Plane
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study


@dataclass(frozen=True)
class Finding:
    """One check: its name, its state ("missing" is optional, "failed" is not), the
    result in words, a remedy.
    """

    name: str
    state: Literal["ok", "missing", "failed"]
    found: str
    remedy: str = ""


DISTRIBUTION = "scleraforce"
FOR_DEVELOPERS = {"dev", "docs"}


def packages() -> Iterator[Finding]:
    """Check the required packages together, then each extra."""
    stated = [Requirement(line) for line in requires(DISTRIBUTION) or ()]
    needed = [requirement for requirement in stated if _wanted(requirement, "")]
    yield _installed(
        "packages", needed, "failed", f"pip install --upgrade {DISTRIBUTION}"
    )
    extras = {
        extra
        for requirement in stated
        for extra in re.findall(r'extra == "([^"]+)', str(requirement.marker))
    }

    for extra in sorted(extras - FOR_DEVELOPERS):
        of_extra = [
            requirement
            for requirement in stated
            if requirement not in needed and _wanted(requirement, extra)
        ]
        yield _installed(
            f"extra [{extra}]",
            of_extra,
            "missing",
            f"pip install '{DISTRIBUTION}[{extra}]'",
        )


def _wanted(requirement: Requirement, extra: str) -> bool:
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


def _installed(
    name: str,
    wanted: Sequence[Requirement],
    otherwise: Literal["missing", "failed"],
    remedy: str,
) -> Finding:
    faults = [fault for requirement in wanted if (fault := _fault(requirement))]
    if faults:
        return Finding(name, otherwise, ", ".join(faults), remedy)

    return Finding(
        name,
        "ok",
        ", ".join(
            f"{requirement.name} {version(requirement.name)}" for requirement in wanted
        ),
    )


def _fault(requirement: Requirement) -> str:
    try:
        found = version(requirement.name)
    except PackageNotFoundError:
        return f"no {requirement.name}"
    return (
        ""
        if requirement.specifier.contains(found, prereleases=True)
        else f"{requirement.name} {found} is too old"
    )


GIB = 2**30
LEAST_CORES = 2
LEAST_MEMORY_GIB = 4
LEAST_DISK_GIB = 1
REAL_TIME = (
    "import sys; from scleraforce.live.companions.watchdog import MONITOR_PRIORITY,"
    " run_in_real_time; sys.exit(not run_in_real_time(MONITOR_PRIORITY))"
)


def machine() -> Iterator[Finding]:
    """Check cores, memory, real-time priority, and the user's cache, which stores
    libraries.
    """
    cores = available_cores()
    memory = _memory_bytes()
    remedy = "the monitor wants two: one for itself, one for what checks it"
    yield _enough(
        "cores", f"{cores} that this process may use", cores >= LEAST_CORES, remedy
    )
    words = "not known on this system" if memory is None else f"{memory / GIB:.0f} GiB"
    remedy = f"libraries and training take up to {LEAST_MEMORY_GIB} GiB"
    yield _enough(
        "memory", words, memory is None or memory >= LEAST_MEMORY_GIB * GIB, remedy
    )

    if sys.platform.startswith("linux"):  # tried in a process of its own
        allowed = (
            subprocess.run(
                [sys.executable, "-P", "-c", REAL_TIME],
                capture_output=True,
                check=False,
            ).returncode
            == 0
        )
        words = "SCHED_FIFO is allowed" if allowed else "no right to SCHED_FIFO"
        remedy = (
            "for the monitor: a line `USER - rtprio 20` in /etc/security/limits.conf,"
            " then log in again"
        )
        yield _enough("real time", words, allowed, remedy)
    else:
        yield Finding(
            "real time",
            "missing",
            f"not on {sys.platform}",
            "the monitor runs on Linux only",
        )

    folder = user_cache_path("scleraforce")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            free = shutil.disk_usage(folder).free
    except OSError as fault:
        remedy = "set XDG_CACHE_HOME to a folder of yours"
        yield Finding("cache", "failed", f"{folder}: {fault.strerror}", remedy)
    else:
        remedy = f"make room: libraries and data sets take up to {LEAST_DISK_GIB} GiB"
        yield _enough(
            "cache",
            f"{folder}, {free / GIB:.0f} GiB free",
            free >= LEAST_DISK_GIB * GIB,
            remedy,
        )


def _enough(name: str, found: str, enough: bool, remedy: str) -> Finding:
    return (
        Finding(name, "ok", found)
        if enough
        else Finding(name, "missing", found, remedy)
    )


def _memory_bytes() -> int | None:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


SOLVE = "a solve"
READ = "a reading"
TRAIN = "a training"
THICKNESS_M = 0.6e-3
MODULUS_PA = 0.3e6
IOP_PA = 270.0
GAP_M = 0.6e-3
DEPTH_M = 0.5e-3
TIP_M = 1.5e-3
COLUMNS = 128  # of a frame
FORCES_AGREE = 2e-3  # of a path and of the library between its paths
READ_WITHIN_N = 1e-3
AGAIN = (
    "install anew in a fresh environment; if it stays, report it with the output of"
    " `scleraforce doctor --json`"
)


def tried(name: str) -> Finding:
    """Run a trial; whatever it raises is a finding, too."""
    start = perf_counter()
    try:
        found = TRIALS[name]()
    except Exception as fault:
        return Finding(name, "failed", f"{type(fault).__name__}: {fault}", AGAIN)

    return (
        replace(found, found=f"{found.found}, {perf_counter() - start:.1f} s")
        if found.state == "ok"
        else found
    )


def compile_loops() -> None:
    """Compile all loops for all later processes."""
    resting = _path().curves_sbnc[:1, OUTER]
    highest_depths(resting, np.array([GAP_M]), np.zeros(1))
    build_mesh(12e-3, THICKNESS_M, divisions=2).locator.locate(
        np.tile([0.0, 0.1, 1.0], (2, 1))
    )
    for kind in (np.float32, np.float64):
        pair = np.zeros((1, 1, 1), np.int32)
        places = np.full((1, 3, 3), -1, np.int32)
        sum_elements(np.zeros((1, 3, 1, 3, 1), kind), pair, places, np.zeros(1))
    inverses(np.zeros((1, 3, 3)))
    dilatations(np.zeros((1, 3, 3)))
    globe = sealed_law(to_si(0.02, "mmhg13_per_ul")).over(MODULUS_PA)
    walls = np.array([THICKNESS_M]), np.array([IOP_PA / MODULUS_PA])
    library = _reader().library
    iop_ratio_under_force(
        library, *walls, np.array([to_si(10.0, "mn") / MODULUS_PA]), globe
    )
    library.covers(*walls, np.array([0.0]))
    iop_ratio_at_dent(library, *walls, np.zeros(1), globe)
    frame, scale, known = _frame()
    warm_pictures()

    for reading in (_reader().read, _reader().read_live):
        for eye in (known, Setup()):
            reading(frame, scale, eye)

    cross = Plane("along", 0.0, 0.0), Plane("across", 0.0, np.pi / 2.0)
    _reader().read_together(
        [frame, frame],
        scale,
        replace(known, needle=replace(known.needle, gap_m=None)),
        cross,
    )
    time_s = np.arange(0.0, 20.0, 0.1)
    force_n = to_si(10.0, "mn") * (1.0 - np.cos(time_s))
    driven_back(force_n, time_s, force_n > 0.0, np.full((1, 1), 0.1), (1.0,))
    estimate_clocks(time_s[::5], force_n[None, ::5], time_s, force_n)
    _fit_known_force()
    study = Study()
    draw_samples(library, study.reader, study.slice, 2, np.random.default_rng(0))


def _fit_known_force() -> None:
    """Fit the boundaries of a frame of known force, as a calibration does."""
    path = _path()
    study = Study()
    _, _, known = _frame()
    section = cut_surfaces(path.curves_sbnc[-1], GAP_M).shifted(0.0, DEPTH_M)
    # a curve that loses its last points ends far beyond the frame
    points = min(len(section.outer), len(section.inner))
    curves = np.stack([section.outer[:points], section.inner[:points]])
    lateral_m = np.linspace(-3e-3, 3e-3, COLUMNS)
    places = PlacesOnFrame(
        lateral_m=np.tile(lateral_m, 2), boundary=np.repeat([0, 1], COLUMNS)
    )
    depth_m, _, _ = curve_depths(curves, places)
    frame = ShownFrame(
        lateral_m=lateral_m,
        depth_bc=depth_m.reshape(2, COLUMNS),
        force_n=float(path.force_ratio_m2[-1]) * MODULUS_PA,
    )
    library = _reader().library
    alone = first_fit(frame, known, library, study)
    assert alone is not None  # its wall is one of the library's
    eye = EyeToFit(
        library=library,
        frames=[frame],
        setup=known,
        trained=study.reader,
        smoothing_m=0.0,
        begun_fn=alone.unknown[None],
    )
    fit_forces(eye, {})


def _solve() -> Finding:
    walls = np.array([THICKNESS_M]), np.array([IOP_PA / MODULUS_PA])
    expected = float(_reader().library.forces(*walls, np.array([TIP_M]))[0])
    solved = float(_path().force_ratio_m2[-1])
    words = (
        f"{from_si(solved * MODULUS_PA, 'mn'):.2f} mN at a dent of"
        f" {from_si(TIP_M, 'mm'):g} mm"
    )

    if abs(solved / expected - 1.0) > FORCES_AGREE:
        return Finding(
            SOLVE,
            "failed",
            f"{words}, {from_si(expected * MODULUS_PA, 'mn'):.2f} are right",
            AGAIN,
        )

    return Finding(SOLVE, "ok", words)


def _read() -> Finding:
    answer = _reader().read(*_frame())
    true_n = float(_path().force_ratio_m2[-1]) * MODULUS_PA

    if answer.force_n is None:
        return Finding(
            READ,
            "failed",
            f"a frame of {from_si(true_n, 'mn'):.1f} mN: {answer.reason}",
            AGAIN,
        )

    words = (
        f"{from_si(answer.force_n, 'mn'):.1f} mN read of {from_si(true_n, 'mn'):.1f} mN"
    )
    right = abs(answer.force_n - true_n) <= READ_WITHIN_N

    return (
        Finding(READ, "ok", words) if right else Finding(READ, "failed", words, AGAIN)
    )


def _train() -> Finding:
    """Train a reader for one short epoch: it is worth nothing, but all training code
    has run.
    """
    try:
        # 1,500 ms: PyTorch, an extra that may be missing
        from scleraforce.lab.training.trained_models import train_reader
    except InputError as fault:
        return Finding(TRAIN, "missing", str(fault))

    study = Study()
    small = replace(
        study.reader,
        epochs=1,
        samples_per_epoch=200,
        validation_samples=50,
        interval_eyes=0,
        channels=(4, 4),
        hidden=(8,),
    )

    with TemporaryDirectory(prefix="scleraforce-doctor-") as folder:
        record = train_reader(
            _reader().library,
            replace(study, reader=small),
            Path(folder) / "model",
            workers=1,
        )

    return Finding(TRAIN, "ok", f"{record['samples']['training']} samples")


@cache
def _reader() -> ForceReader:
    return load_force_reader(SHIPPED_READER)


@cache
def _frame() -> tuple[NDArray[np.uint16], PixelScale, Setup]:
    study = Study()
    path = _path()
    rng = np.random.default_rng(0)
    section = Pose(lateral_m=0.0, depth_m=DEPTH_M, tilt_rad=0.0).place(
        cut_surfaces(path.curves_sbnc[-1], GAP_M)
    )
    frame = render_bscan(
        section, study.oct, sample_optics(study.phantom, study.oct, rng), rng
    ).frame
    scale = PixelScale(
        lateral_m=study.oct.width_m / study.oct.columns,
        depth_m=study.oct.depth_m / study.oct.rows,
    )
    known = Setup(
        eye=Eye(
            modulus=Modulus.stated(MODULUS_PA),
            iop_pa=IOP_PA,
            thickness_m=THICKNESS_M,
            globe=OPEN,
        ),
        needle=Needle(gap_m=GAP_M),
    )

    return frame, scale, known


@cache
def _path() -> AxisymmetricPath:
    library = _reader().library
    wall = EvenWall(
        library.radius_m, THICKNESS_M, library.poisson_ratio, library.needle_radius_m
    )
    end = PathEnd(tips_m=np.linspace(0.0, TIP_M, 5)[1:])

    return axisymmetric_path(wall, IOP_PA / MODULUS_PA, end)


TRIALS: Mapping[str, Callable[[], Finding]] = {
    SOLVE: _solve,
    READ: _read,
    TRAIN: _train,
}
