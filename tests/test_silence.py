"""No process of ours speaks to anybody, and none writes outside its outputs and our own folders in the user's home."""

import os
import subprocess
import sys
from ipaddress import ip_address
from pathlib import Path

import pytest
from analytic_library import analytic_library
from effects import STRACE, fresh_home, traced
from small_models import write_fixed_reader

pytest.importorskip("torch")

STUDY = """
[mesh]
divisions = 4
[dataset]
contacts = 2
[[dataset.group]]
thickness_um = 500.0
images = 20
[network]
hidden = [8]
epochs = 1
"""
DEVICES = ("/dev/null", "/dev/tty", "/dev/shm", "/proc")
OURS = {Path(".cache/scleraforce"), Path(".local/state/scleraforce"), Path(".cache/matplotlib"), Path(".config")}


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model folder of kind "reader"."""
    path = tmp_path_factory.mktemp("silence") / "reader"
    write_fixed_reader(path, analytic_library(thicknesses=4, ratios=4, tips=5), [1.0] * 8)
    return path


def test_onnx_runtime_keeps_no_device_id_and_no_events(reader: Path, tmp_path: Path) -> None:
    """In a notebook, too, which makes a session of its own: our import alone switches it off."""
    environment = fresh_home(tmp_path) | {"ORT_DISABLE_TELEMETRY": "0"}
    script = "import sys, scleraforce, onnxruntime; onnxruntime.InferenceSession(sys.argv[1] + '/model.onnx')"
    subprocess.run([sys.executable, "-c", script, reader], env=environment, check=True)
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


def test_processes_that_we_start_inherit_the_silence() -> None:
    import scleraforce  # noqa: F401 - what switches it off

    assert os.environ["ORT_DISABLE_TELEMETRY"] == "1"


@pytest.mark.slow
@pytest.mark.skipif(STRACE is None, reason="strace is not installed")
def test_no_command_speaks_to_another_host_or_writes_outside_its_outputs(reader: Path, tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    frame = ("eye/frames/0001.png", "--width-mm", "15", "--depth-mm", "4")
    commands = [
        ("phantom", "--study", "study.toml", "--out", "eye", "--forces-mn", "5,30"),
        ("segment", "eye", "--out", "masks", "--overlay"),
        ("generate", "--study", "study.toml", "--out", "data.zarr", "--workers", "1"),
        ("train", "data.zarr", "--out", "classifier"),
        ("classify", "classifier", *frame),
        ("classify", reader, *frame),
        ("evaluate", reader, "eye", "--html", "page.html"),
        ("monitor", reader, "--port", "0", "--web-port", "0"),
    ]
    for command in commands:
        monitor = command[0] == "monitor"
        done = traced(tmp_path, *command, until=(lambda line: line.startswith("reset")) if monitor else None)
        assert done.code in ((0, 130) if monitor else (0,)), (command, done.err)  # Ctrl-C ends the monitor
        assert [name for name in done.addresses if not ip_address(name).is_loopback] == [], command
        outside = [str(file) for file in done.written if not file.is_relative_to(tmp_path)]
        assert [name for name in outside if not name.startswith(DEVICES)] == [], command
    home = tmp_path / "home"
    kept = {file.relative_to(home) for file in home.rglob("*") if file.is_file()}
    assert [file for file in kept if not any(file.is_relative_to(ours) for ours in OURS)] == []
    assert [file for file in (tmp_path / "temporary").rglob("*") if file.is_file()] == []
