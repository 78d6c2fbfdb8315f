"""Shell completion (docs/installation.md): the scripts load in their shells, commands and options are offered."""

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from scleraforce.cli.main import COMMANDS

SHELLS = ("bash", "zsh", "fish")


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A PATH on which `scleraforce` is this one."""
    folder = tmp_path_factory.mktemp("bin")
    command = folder / "scleraforce"
    command.write_text(f"#!{sys.executable}\nfrom scleraforce.cli.main import main\nmain()\n")
    command.chmod(0o755)
    return f"{folder}:{os.environ['PATH']}"


@cache
def script_of(shell: str, path: str) -> str:
    environment = os.environ | {"PATH": path, "_SCLERAFORCE_COMPLETE": f"{shell}_source"}
    done = subprocess.run(["scleraforce"], env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_loads_without_a_word(shell: str, path: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    script = tmp_path / "completion"
    script.write_text(script_of(shell, path))
    before = "autoload -U compinit && compinit -D; " if shell == "zsh" else ""
    environment = os.environ | {"PATH": path, "HOME": str(tmp_path)}
    call = [shell, "-c", f"{before}source {script}"]
    done = subprocess.run(call, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def offered(line: str, path: str, tmp_path: Path) -> list[str]:
    """Return the words that bash offers at the end of a line."""
    script = tmp_path / "completion"
    script.write_text(script_of("bash", path))
    words = [word or '""' for word in line.split(" ")]
    asked = (
        f"source {script}; COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}; "
        '_scleraforce_completion scleraforce; printf "%s\\n" "${COMPREPLY[@]}"'
    )
    environment = os.environ | {"PATH": path}
    done = subprocess.run(["bash", "-c", asked], env=environment, capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_bash_offers_commands_options_and_choices(path: str, tmp_path: Path) -> None:
    assert offered("scleraforce ", path, tmp_path) == list(COMMANDS)
    assert offered("scleraforce cal", path, tmp_path) == ["calibrate"]
    assert {"--json", "--quiet", "--html"} <= set(offered("scleraforce evaluate default --", path, tmp_path))
    assert offered("scleraforce init --preset l", path, tmp_path) == ["living"]
