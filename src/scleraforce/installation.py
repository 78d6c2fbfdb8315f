"""What an installation has, lacks and can do: packages, the machine, small runs with known results."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
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

from scleraforce.errors import InputError
from scleraforce.known import OPEN, Known, Modulus
from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.light import Pose, sample_optics
from scleraforce.library.sections import cut_surfaces
from scleraforce.mechanics.axisymmetric import AxisymmetricPath, axisymmetric_path
from scleraforce.models import SHIPPED_READER
from scleraforce.processes import available_cores
from scleraforce.reader import ForceReader, load_force_reader
from scleraforce.recording.pixels import PixelScale
from scleraforce.study import Study
from scleraforce.units import from_si


@dataclass(frozen=True)
class Finding:
    """What was found of one thing.

    Attributes:
        name: of the thing.
        state: "missing" is what one can do without, "failed" what one cannot.
        found: in a few words.
        remedy: what to do where it is not "ok"; may be empty.
    """

    name: str
    state: Literal["ok", "missing", "failed"]
    found: str
    remedy: str = ""


DISTRIBUTION = "scleraforce"
FOR_DEVELOPERS = {"dev", "docs"}


def packages() -> Iterator[Finding]:
    """Yield what was found of the required packages together, then of each extra."""
    stated = [Requirement(line) for line in requires(DISTRIBUTION) or ()]
    needed = [requirement for requirement in stated if _wanted(requirement, "")]
    lacking = [words for requirement in needed if (words := _lacking(requirement))]
    if lacking:
        yield Finding("packages", "failed", ", ".join(lacking), f"pip install --upgrade {DISTRIBUTION}")
    else:
        yield Finding("packages", "ok", ", ".join(f"{one.name} {version(one.name)}" for one in needed))
    for extra in sorted({name for requirement in stated for name in _extras(requirement)} - FOR_DEVELOPERS):
        of_extra = [requirement for requirement in stated if requirement not in needed and _wanted(requirement, extra)]
        lacking = [words for requirement in of_extra if (words := _lacking(requirement))]
        name, remedy = f"extra [{extra}]", f"pip install '{DISTRIBUTION}[{extra}]'"
        if lacking:
            yield Finding(name, "missing", ", ".join(lacking), remedy)
        else:
            yield Finding(name, "ok", ", ".join(f"{one.name} {version(one.name)}" for one in of_extra))


def _wanted(requirement: Requirement, extra: str) -> bool:
    """Whether a package is needed here with an extra; "" is none."""
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


def _extras(requirement: Requirement) -> list[str]:
    """Return the extras that a requirement's marker names."""
    if requirement.marker is None:
        return []
    words = str(requirement.marker).split('extra == "')[1:]
    return [word.split('"')[0] for word in words]


def _lacking(requirement: Requirement) -> str:
    """Return what is wrong with a package; nothing where it is there and new enough."""
    try:
        found = version(requirement.name)
    except PackageNotFoundError:
        return f"no {requirement.name}"
    return "" if requirement.specifier.contains(found, prereleases=True) else f"{requirement.name} {found} is too old"


GIB = 2**30
LEAST_CORES, LEAST_MEMORY_GIB, LEAST_DISK_GIB = 2, 4, 1
REAL_TIME = (
    "import sys; from scleraforce.service.watchdog import MONITOR_PRIORITY, run_in_real_time; "
    "sys.exit(not run_in_real_time(MONITOR_PRIORITY))"
)
LIMITS = "/etc/security/limits.conf"


def machine() -> Iterator[Finding]:
    """Yield what was found of the machine."""
    yield _cores(available_cores())
    yield _memory(_memory_bytes())
    yield _graphics()
    yield _real_time()
    yield _kept(user_cache_path("scleraforce"))


def _cores(count: int) -> Finding:
    if count < LEAST_CORES:
        return Finding("cores", "missing", f"{count}", "the monitor wants two: one for itself, one for what checks it")
    return Finding("cores", "ok", f"{count} that this process may use")


def _memory(found: int | None) -> Finding:
    if found is None:
        return Finding("memory", "ok", "not known on this system")
    words = f"{found / GIB:.0f} GiB"
    if found < LEAST_MEMORY_GIB * GIB:
        return Finding("memory", "missing", words, f"libraries and training take up to {LEAST_MEMORY_GIB} GiB")
    return Finding("memory", "ok", words)


def _memory_bytes() -> int | None:
    """Return the machine's memory; None where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return None


def _graphics() -> Finding:
    """Return which GPUs there are: none is used, and users ask."""
    asked = shutil.which("nvidia-smi")
    if asked is None:
        return Finding("GPU", "ok", "no NVIDIA driver; none is needed, all is computed on the CPU")
    words = [asked, "--query-gpu=name", "--format=csv,noheader"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    names = ", ".join(done.stdout.splitlines()) or "none answers"
    return Finding("GPU", "ok", f"{names}; not used, all is computed on the CPU")


def _real_time() -> Finding:
    """Try real-time priority in a process of its own."""
    if not sys.platform.startswith("linux"):
        return Finding("real time", "missing", f"not on {sys.platform}", "the monitor runs on Linux only")
    done = subprocess.run([sys.executable, "-c", REAL_TIME], capture_output=True, check=False)
    if done.returncode:
        remedy = f"for the monitor: a line `USER - rtprio 20` in {LIMITS}, then log in again"
        return Finding("real time", "missing", "no right to SCHED_FIFO", remedy)
    return Finding("real time", "ok", "SCHED_FIFO is allowed")


def _kept(folder: Path) -> Finding:
    """Look whether libraries can be kept in the user's cache."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            free = shutil.disk_usage(folder).free
    except OSError as fault:
        return Finding("cache", "failed", f"{folder}: {fault.strerror}", "set XDG_CACHE_HOME to a folder of yours")
    words = f"{folder}, {free / GIB:.0f} GiB free"
    if free < LEAST_DISK_GIB * GIB:
        return Finding("cache", "missing", words, f"make room: libraries and data sets take up to {LEAST_DISK_GIB} GiB")
    return Finding("cache", "ok", words)


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


def compile_loops() -> None:
    """Run what frames and load paths need once, so that no later process has to compile it."""
    _path()
    frame, scale, known = _frame()
    for reading in (_reader().read, _reader().read_live):
        for eye in (known, Known()):
            reading(frame, scale, eye)


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
    """Read a frame of that wall."""
    answer, true_n = _reader().read(*_frame()), float(_path().force_ratio_m2[-1]) * MODULUS_PA
    if answer.force_n is None:
        return Finding(READ, "failed", f"a frame of {from_si(true_n, 'mn'):.1f} mN: {answer.reason}", AGAIN)
    words = f"{from_si(answer.force_n, 'mn'):.1f} mN read of {from_si(true_n, 'mn'):.1f} mN"
    if abs(answer.force_n - true_n) > READ_WITHIN_N:
        return Finding(READ, "failed", words, AGAIN)
    return Finding(READ, "ok", words)


def _train() -> Finding:
    """Train a reader for one short epoch: it is worth nothing, but all that trains has run."""
    try:
        from scleraforce.learning.train import train_reader
    except InputError as fault:
        return Finding(TRAIN, "missing", str(fault))
    study = Study()
    small = replace(
        study.reader, epochs=1, samples_per_epoch=200, validation_samples=50, interval_eyes=0, channels=(4, 4),
        hidden=(8,),
    )  # fmt: skip
    with TemporaryDirectory(prefix="scleraforce-doctor-") as folder:
        record = train_reader(_reader().library, replace(study, reader=small), Path(folder) / "model", workers=1)
    return Finding(TRAIN, "ok", f"{record['samples']['training']} samples")


@cache
def _reader() -> ForceReader:
    return load_force_reader(SHIPPED_READER)


@cache
def _frame() -> tuple[NDArray[np.uint16], PixelScale, Known]:
    """Draw a frame of the wall of the load path; return what is known of its eye, too."""
    study, path, rng = Study(), _path(), np.random.default_rng(0)
    section = Pose(lateral_m=0.0, depth_m=DEPTH_M, tilt_rad=0.0).place(cut_surfaces(path.curves_sbnc[-1], GAP_M))
    frame = render_bscan(section, study.oct, sample_optics(study.phantom, study.oct, rng), rng).frame
    scale = PixelScale(lateral_m=study.oct.width_m / study.oct.columns, depth_m=study.oct.depth_m / study.oct.rows)
    known = Known(modulus=Modulus.stated(MODULUS_PA), iop_pa=IOP_PA, thickness_m=THICKNESS_M, gap_m=GAP_M, globe=OPEN)
    return frame, scale, known


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
