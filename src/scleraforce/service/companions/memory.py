"""How much memory a process may still take: of the machine, and of its control groups (Linux)."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["available_bytes"]

PROC, GROUPS = Path("/proc"), Path("/sys/fs/cgroup")
LIMITS = (("", "memory.max", "memory.current"), ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes"))


def available_bytes(proc: Path = PROC, groups: Path = GROUPS) -> int | None:
    """Return the least of what the machine and the control groups of this process leave; None where none tells.

    Args:
        proc: where the kernel tells of processes.
        groups: where it tells of control groups, of version 2 or 1.
    """
    left = list(_group_bytes(proc, groups))
    with suppress(OSError, ValueError):
        lines = (proc / "meminfo").read_text("ascii").splitlines()
        left += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    return max(0, min(left)) if left else None


def _group_bytes(proc: Path, groups: Path) -> Iterator[int]:
    """Yield what each control group above this process leaves; a file cache is given back when memory is asked for."""
    with suppress(OSError):
        for line in (proc / "self" / "cgroup").read_text("utf-8").splitlines():
            _, controllers, path = line.split(":", 2)
            for name, limit, usage in LIMITS:
                if controllers != name:
                    continue
                place = Path(path.strip("/"))
                for group in (place, *place.parents):
                    with suppress(OSError, ValueError):  # "max": there is no limit
                        folder = groups / name / group
                        most = int((folder / limit).read_text("ascii"))
                        yield most - int((folder / usage).read_text("ascii")) + _cache_bytes(folder)


def _cache_bytes(folder: Path) -> int:
    with suppress(OSError, ValueError):
        for line in (folder / "memory.stat").read_text("ascii").splitlines():
            if line.startswith(("inactive_file ", "total_inactive_file ")):
                return int(line.split()[1])
    return 0
