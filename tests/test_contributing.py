"""The walks of CONTRIBUTING.md are possible: each diff applies to today's sources, and its command passes."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
WALKS = re.findall(
    r"^## (Walk \d: [^\n]+)\n.*?^```diff\n(.*?)^```\n.*?^```console\n\$ pytest (.*?)\n```$",
    PAGE,
    re.DOTALL | re.MULTILINE,
)
NEEDED = ("src", "tests", "benchmarks", "docs", "examples", "pyproject.toml", "README.md", "Makefile")

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


def applied(diff: str, folder: Path, *, check: bool) -> subprocess.CompletedProcess[str]:
    words = ["git", "apply", "--unidiff-zero", *(["--check"] if check else []), "-"]
    # A folder within a repository would be taken for a part of it, and nothing would be applied.
    environment = os.environ | {"GIT_CEILING_DIRECTORIES": str(folder.parent)}
    return subprocess.run(words, cwd=folder, env=environment, input=diff, capture_output=True, text=True, check=False)


def test_an_element_a_material_and_a_cause_are_walked_through() -> None:
    assert [title for title, _, _ in WALKS] == [
        "Walk 1: an element",
        "Walk 2: a material",
        "Walk 3: a cause of withdrawal",
    ]


@pytest.mark.parametrize(("diff", "command"), [walk[1:] for walk in WALKS], ids=[walk[0] for walk in WALKS])
def test_a_walk_applies_to_todays_sources(diff: str, command: str, tmp_path: Path) -> None:
    for name in re.findall(r"^--- a/(\S+)$", diff, re.MULTILINE):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, tmp_path / name)
    done = applied(diff, tmp_path, check=True)
    assert done.returncode == 0, done.stderr
    assert all((ROOT / word).exists() for word in command.split() if word.startswith("tests/"))


@pytest.mark.slow
@pytest.mark.parametrize(("diff", "command"), [walk[1:] for walk in WALKS], ids=[walk[0] for walk in WALKS])
def test_the_command_of_a_walk_passes_with_it_and_its_tests_fail_without(
    diff: str, command: str, tmp_path: Path
) -> None:
    left_out = shutil.ignore_patterns("__pycache__", "*.egg-info", "images")
    for name in NEEDED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tmp_path / name, ignore=left_out)
        else:
            shutil.copyfile(ROOT / name, tmp_path / name)
    environment = os.environ | {"PYTHONPATH": f"{tmp_path / 'src'}:{tmp_path / 'benchmarks'}"}
    call = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *command.split()]
    parts = re.split(r"(?m)^(?=diff --git )", diff)
    of_tests = [part for part in parts if part.startswith("diff --git a/tests/")]
    assert applied("".join(of_tests), tmp_path, check=False).returncode == 0
    without = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert without.returncode in (1, 2), without.stdout  # a test that fails, or that cannot be collected
    assert applied("".join(part for part in parts if part not in of_tests), tmp_path, check=False).returncode == 0
    done = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
