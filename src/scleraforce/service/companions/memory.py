"""How much memory the machine and the control groups leave to a process (Linux)."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

PROC, GROUPS = Path("/proc"), Path("/sys/fs/cgroup")
LIMITS = (("", "memory.max", "memory.current"), ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes"))


def available_bytes(proc: Path = PROC, groups: Path = GROUPS) -> int | None:
    """Return the least of what the machine and the control groups of this process leave; None if neither can be read.

    Args:
        proc: the kernel's file system of processes.
        groups: its file system of control groups, version 2 or 1.
    """
    left = list(_group_bytes(proc, groups))
    with suppress(OSError, ValueError):
        lines = (proc / "meminfo").read_text("ascii").splitlines()
        left += [1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
    return max(0, min(left)) if left else None


def _group_bytes(proc: Path, groups: Path) -> Iterator[int]:
    """Yield what each control group of this process leaves; inactive file cache counts as free."""
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
