"""The machine in words: what a time of it is worth to somebody else."""

import os
import platform
import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from scleraforce.base.worker_processes import available_cores

GIB = 2**30
PACKAGES = (
    "scleraforce",
    "numpy",
    "scipy",
    "numba",
    "opencv-python-headless",
    "onnxruntime",
    "torch",
    "scikit-fem",
    "scikit-learn",
    "pyigtl",
)


def machine_in_words() -> dict[str, str]:
    """Return processor, cores, memory, load, system and versions."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GIB
    return {
        "processor": _processor(),
        "cores": f"{available_cores()} that this process may use",
        "memory": f"{memory:.0f} GiB",
        "load when it began": (
            ", ".join(f"{load:.2f}" for load in os.getloadavg()) + " (1, 5, 15 minutes)"
        ),
        "system": (
            f"{platform.system()} {platform.release()}, {platform.machine()}, Python"
            f" {platform.python_version()}"
        ),
        "packages": ", ".join(_version(name) for name in PACKAGES),
    }


def _processor() -> str:
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    model = re.search(r"^model name\s*: (.*)$", text, re.MULTILINE)
    clock = re.search(r"^cpu MHz\s*: (\d+)", text, re.MULTILINE)
    found = model[1] if model else platform.processor() or "not named by the system"
    return f"{found}, {int(clock[1]) / 1000:.1f} GHz" if clock else found


def _version(package: str) -> str:
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return f"no {package}"
