"""What memory is left is the least that the machine and the control groups say."""

from pathlib import Path

import pytest

from scleraforce.service.companions.frame_ring import available_bytes

MB = 2**20


@pytest.fixture
def roots(tmp_path: Path) -> tuple[Path, Path]:
    (tmp_path / "proc" / "self").mkdir(parents=True)
    (tmp_path / "proc" / "meminfo").write_text("MemTotal: 9000 kB\nMemAvailable:    8192000 kB\nSwapFree: 0 kB\n")
    return tmp_path / "proc", tmp_path / "groups"


def group(folder: Path, names: tuple[str, str], most: object, used: int, cache: str = "") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / names[0]).write_text(f"{most}\n")
    (folder / names[1]).write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 1\n{cache}\n")


def test_without_groups_it_is_the_machines(roots) -> None:
    assert available_bytes(*roots) == 8000 * MB


def test_of_version_2_every_group_on_the_way_up_counts(roots) -> None:
    proc, groups = roots
    names = "memory.max", "memory.current"
    (proc / "self" / "cgroup").write_text("0::/user.slice/app\n")
    group(groups / "user.slice" / "app", names, "max", 50 * MB)
    group(groups / "user.slice", names, 300 * MB, 200 * MB, f"inactive_file {30 * MB}")
    group(groups / "another", names, MB, 0)
    assert available_bytes(proc, groups) == 130 * MB
    group(groups / "user.slice", names, 300 * MB, 400 * MB)
    assert available_bytes(proc, groups) == 0


def test_of_version_1_the_memory_controller_counts(roots) -> None:
    proc, groups = roots
    (proc / "self" / "cgroup").write_text("5:cpu:/x\n4:memory:/docker/abc\n0::/\n")
    names = "memory.limit_in_bytes", "memory.usage_in_bytes"
    group(groups / "memory" / "docker" / "abc", names, 500 * MB, 100 * MB, f"total_inactive_file {10 * MB}")
    group(groups / "memory", names, 2**63 - 4096, 0)
    assert available_bytes(proc, groups) == 410 * MB


def test_where_nothing_tells_there_is_no_answer(tmp_path: Path) -> None:
    assert available_bytes(tmp_path, tmp_path) is None
    assert (available_bytes() or 0) > 0
