"""What `doctor` says of a machine: too little is `missing`, with what to do."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from scleraforce import installation
from scleraforce.installation import Finding


def found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Finding]:
    monkeypatch.setattr(installation, "user_cache_path", lambda name: tmp_path / name)
    return {finding.name: finding for finding in installation.machine()}


def test_a_machine_is_described(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(installation.shutil, "which", lambda _: None)
    monkeypatch.setattr(installation.subprocess, "run", lambda *_, **__: SimpleNamespace(returncode=0, stdout=""))
    monkeypatch.setattr(installation, "available_cores", lambda: 8)
    monkeypatch.setattr(installation, "_memory_bytes", lambda: 24 * installation.GIB)
    all_of_it = found(monkeypatch, tmp_path)
    assert {finding.state for finding in all_of_it.values()} == {"ok"}
    assert all_of_it["cores"].found == "8 that this process may use"
    assert all_of_it["memory"].found == "24 GiB"
    assert all_of_it["GPU"].found.startswith("no NVIDIA driver; none is needed")
    assert all_of_it["cache"].found.startswith(str(tmp_path / "scleraforce"))


def test_what_is_too_little_is_missing_with_what_to_do(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    cards = SimpleNamespace(returncode=1, stdout="NVIDIA H100\nNVIDIA H100\n")
    monkeypatch.setattr(installation.shutil, "which", lambda _: "/usr/bin/nvidia-smi")
    monkeypatch.setattr(installation.subprocess, "run", lambda *_, **__: cards)
    monkeypatch.setattr(installation, "available_cores", lambda: 1)
    monkeypatch.setattr(installation, "_memory_bytes", lambda: 2 * installation.GIB)
    monkeypatch.setattr(installation.shutil, "disk_usage", lambda _: SimpleNamespace(free=installation.GIB // 2))
    all_of_it = found(monkeypatch, tmp_path)
    assert {name for name, finding in all_of_it.items() if finding.state == "missing"} == {
        "cores", "memory", "real time", "cache"
    }  # fmt: skip
    assert all(finding.remedy for finding in all_of_it.values() if finding.state == "missing")
    assert all_of_it["GPU"] == Finding("GPU", "ok", "NVIDIA H100, NVIDIA H100; not used, all is computed on the CPU")


def test_a_cache_that_cannot_be_written_has_failed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "scleraforce").write_text("in the way")
    cache = found(monkeypatch, tmp_path)["cache"]
    assert cache.state == "failed"
    assert "XDG_CACHE_HOME" in cache.remedy


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_real_time_is_not_asked_for_where_the_monitor_does_not_run(platform: str, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(installation.sys, "platform", platform)
    assert found(monkeypatch, tmp_path)["real time"].state == "missing"
