"""`library` and `generate`: JSON, a calibration's modulus, and Ctrl-C that the same command repairs."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from small_recordings import calibration_text
from waiting import FUSE_S

from scleraforce.cli.output import count_bar
from scleraforce.learning import generate
from scleraforce.learning.dataset import open_dataset
from scleraforce.library import build as library_build
from scleraforce.library.store import open_library
from scleraforce.notebook.libraries import library_for
from scleraforce.study import parse_study

STUDY = """
[mesh]
divisions = 4
[dataset]
contacts = 2
[[dataset.group]]
thickness_um = 500.0
images = 20
[library]
thickness_um = { min = 500.0, max = 800.0 }
thicknesses = 4
tensions = 4
tips = 4
max_tip_mm = 1.0
elements = 16
"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


@pytest.mark.slow
def test_generate_uses_the_calibrations_modulus_and_reports_its_speed(study, tmp_path, shell):
    calibration, out = tmp_path / "calibration.json", tmp_path / "dataset.zarr"
    calibration.write_text(calibration_text(0.31))
    printed, noted = shell.run("generate", "--study", study, "--out", out, "--calibration", calibration, "--json")
    answer = json.loads(printed)
    assert "E was fitted with finite-strain mechanics, the slices are linear" in noted
    assert answer["images"] == 20
    assert answer["images_per_second"] == pytest.approx(20 / answer["seconds"])
    dataset = open_dataset(out)
    assert dataset.youngs_modulus_pa == pytest.approx(0.31e6)
    assert dataset.attributes["calibration"]["path"] == str(calibration)
    assert "complete" in shell.refused("generate", "--study", study, "--out", out)


def test_an_interrupted_command_says_what_it_keeps_and_exits_with_130(study, tmp_path, shell, monkeypatch):
    def interrupted(*_, progress, **__):
        progress(7)
        raise KeyboardInterrupt

    monkeypatch.setattr(generate, "generate_dataset", interrupted)
    monkeypatch.setattr(library_build, "build_library", interrupted)
    for command, kept in (("generate", "7 of 20 images"), ("library", "7 of 208 load paths")):
        said = shell.run(command, "--study", study, "--out", tmp_path / "d", code=130)[1]
        assert f"{kept} are kept; the same command completes them" in said


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_a_generate_that_was_stopped_is_completed_by_the_same_command(study, tmp_path, sent):
    study.write_text(STUDY.replace("images = 20", "images = 3000"))
    out = tmp_path / "dataset.zarr"
    call = "from scleraforce.cli.main import main; main()"
    line = [sys.executable, "-c", call, "generate", "--study", str(study), "--out", str(out), "--json"]
    process = subprocess.Popen(line, stderr=subprocess.PIPE, text=True)
    while not any(out.glob("slices/c/*/0/0")):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(sent)
    message = process.communicate(timeout=FUSE_S)[1]
    assert process.returncode == (130 if sent == signal.SIGINT else -signal.SIGKILL)
    if sent == signal.SIGINT:
        assert "Traceback" not in message
        assert "of 3000 images are kept" in message
    kept = len(list(Path(out).glob("slices/c/*/0/0")))
    assert 0 < kept < 15
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL, timeout=120.0)
    assert open_dataset(out).images == 3000


@pytest.mark.slow
def test_a_library_is_made_with_its_size_and_time(study, tmp_path, shell):
    out = tmp_path / "library.zarr"
    answer = shell.json("library", "--study", study, "--out", out, "--workers", 1)
    assert answer["paths"] == 5 * 16 + 8 * 16
    assert answer["seconds"] > 0.0
    assert open_library(out).force_ratio_tpd.shape == (4, 4, 4)
    assert "a complete library" in shell.refused("library", "--study", study, "--out", out)


@pytest.mark.slow
def test_other_commands_find_the_library_in_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = library_for(parse_study(STUDY), "finite-strain", count_bar)
    assert made is not None
    assert len(list((tmp_path / "scleraforce" / "libraries").glob("*.zarr"))) == 1
    again = library_for(parse_study(STUDY), "finite-strain", count_bar)
    assert again is not None
    assert (again.force_ratio_tpd == made.force_ratio_tpd).all()
