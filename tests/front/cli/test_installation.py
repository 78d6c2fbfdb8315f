"""Checks of an installation: packages, the machine, small runs with known results."""

import os
import re
import subprocess
import sys
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace

import pytest

import scleraforce
from scleraforce.front.cli import installation_checks
from scleraforce.front.cli.installation_checks import Finding, tried

STATED = [
    "numpy>=2.0",
    'pywin32>=300; sys_platform == "never"',
    'torch>=2.6; extra == "train"',
    'onnx>=1.17; extra == "train"',
    'fastapi>=0.115; extra == "web"',
    'pytest>=8; extra == "dev"',
]


def test_packages_of_this_system_and_each_extra_of_users_are_named_with_their_versions(
    monkeypatch,
) -> None:
    there = {
        "numpy": "2.4.6",
        "torch": "2.13.0+cpu",
        "onnx": "1.23.2",
        "fastapi": "0.165.0",
    }

    def version(name: str) -> str:
        if name not in there:
            raise PackageNotFoundError(name)
        return there[name]

    monkeypatch.setattr(installation_checks, "requires", lambda _: STATED)
    monkeypatch.setattr(installation_checks, "version", version)
    assert list(installation_checks.packages()) == [
        Finding("packages", "ok", "numpy 2.4.6"),
        Finding("extra [train]", "ok", "torch 2.13.0+cpu, onnx 1.23.2"),
        Finding("extra [web]", "ok", "fastapi 0.165.0"),
    ]
    del there["torch"]
    there["onnx"] = "1.2"
    there["numpy"] = "1.26.4"
    assert list(installation_checks.packages())[:2] == [
        Finding(
            "packages",
            "failed",
            "numpy 1.26.4 is too old",
            "pip install --upgrade scleraforce",
        ),
        Finding(
            "extra [train]",
            "missing",
            "no torch, onnx 1.2 is too old",
            "pip install 'scleraforce[train]'",
        ),
    ]


def found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, Finding]:
    monkeypatch.setattr(
        installation_checks, "user_cache_path", lambda name: tmp_path / name
    )
    return {finding.name: finding for finding in installation_checks.machine()}


def test_too_small_a_machine_is_missing_and_has_a_remedy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(
        installation_checks.subprocess,
        "run",
        lambda *_, **__: SimpleNamespace(returncode=1),
    )
    monkeypatch.setattr(installation_checks, "available_cores", lambda: 1)
    monkeypatch.setattr(
        installation_checks, "_memory_bytes", lambda: 2 * installation_checks.GIB
    )
    monkeypatch.setattr(
        installation_checks.shutil,
        "disk_usage",
        lambda _: SimpleNamespace(free=installation_checks.GIB // 2),
    )
    all_of_it = found(monkeypatch, tmp_path)
    assert {
        name for name, finding in all_of_it.items() if finding.state == "missing"
    } == {"cores", "memory", "real time", "cache"}
    assert all(
        finding.remedy for finding in all_of_it.values() if finding.state == "missing"
    )


def test_a_cache_that_cannot_be_written_has_failed_and_real_time_needs_linux(
    monkeypatch, tmp_path: Path
) -> None:
    (tmp_path / "scleraforce").write_text("in the way")
    monkeypatch.setattr(installation_checks.sys, "platform", "darwin")
    findings = found(monkeypatch, tmp_path)
    assert findings["cache"].state == "failed"
    assert "XDG_CACHE_HOME" in findings["cache"].remedy
    assert findings["real time"].state == "missing"


@pytest.fixture(autouse=True)
def _anew() -> None:
    installation_checks._path.cache_clear()


def test_a_solve_and_a_reading_are_right_here_and_a_wrong_force_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("a solve", "a reading"):
        found = tried(name)
        assert (found.name, found.state) == (name, "ok")
        assert "mN" in found.found
    monkeypatch.setattr(installation_checks, "READ_WITHIN_N", 1e-9)
    assert tried("a reading").state == "failed"


@pytest.mark.slow
def test_without_pytorch_training_is_missing_and_with_it_a_model_is_trained() -> None:
    script = (
        "import sys; {block}; from scleraforce.front.cli.installation_checks import tried;"
        " print(tried('a training'))"
    )
    first, second = (
        subprocess.run(
            [sys.executable, "-c", script.format(block=block)],
            capture_output=True,
            text=True,
            check=True,
        )
        for block in ("sys.modules['torch'] = None", "pass")
    )
    assert "state='missing'" in first.stdout
    assert "pip install 'scleraforce[train]'" in first.stdout
    assert "state='ok'" in second.stdout


@pytest.mark.slow
@pytest.mark.timeout(900)  # half a minute of two cores; a machine may be busy
def test_an_installation_compiles_every_loop(tmp_path: Path) -> None:
    """Each function that is compiled has its index in an empty cache afterwards."""
    command = "from scleraforce.front.cli.installation_checks import compile_loops; compile_loops()"
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    subprocess.run(
        [sys.executable, "-c", command],
        env=environment,
        check=True,
        capture_output=True,
    )
    kept = {file.name.split("-")[0] for file in tmp_path.rglob("*.nbi")}

    for source in Path(scleraforce.__file__).parent.rglob("*.py"):
        for name in re.findall(
            r"^@compiled\ndef (\w+)", source.read_text(encoding="utf-8"), re.M
        ):
            assert f"{source.stem}.{name}" in kept
