"""The machine: cores, memory, graphics, real-time rights, room for what is kept."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile

from platformdirs import user_cache_path

from scleraforce.installation.finding import Finding
from scleraforce.processes import available_cores

GIB = 2**30
LEAST_CORES, LEAST_MEMORY_GIB, LEAST_DISK_GIB = 2, 4, 1
REAL_TIME = (
    "import sys; from scleraforce.service.priority import MONITOR_PRIORITY, run_in_real_time; "
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
