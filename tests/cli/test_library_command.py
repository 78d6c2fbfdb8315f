"""`scleraforce library`: JSON, errors, and Ctrl-C that the same command repairs."""

import json

import pytest

from scleraforce.cli.main import run
from scleraforce.cli.output import count_bar
from scleraforce.library import build as library_build
from scleraforce.library.store import open_library
from scleraforce.notebook.training import library_for
from scleraforce.study import parse_study

STUDY = """
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
def test_a_library_is_made_and_its_size_and_time_are_said(study, tmp_path, capsys):
    out = tmp_path / "library.zarr"
    assert run(["library", "--study", str(study), "--out", str(out), "--workers", "1", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["paths"] == 5 * 16 + 8 * 16
    assert answer["seconds"] > 0.0
    assert open_library(out).force_ratio_tpd.shape == (4, 4, 4)
    assert run(["library", "--study", str(study), "--out", str(out)]) == 2
    assert "a complete library" in capsys.readouterr().err


def test_an_interrupted_library_says_what_it_keeps_and_exits_with_130(study, tmp_path, capsys, monkeypatch):
    def interrupted(*_, progress, **__):
        progress(7)
        raise KeyboardInterrupt

    monkeypatch.setattr(library_build, "build_library", interrupted)
    assert run(["library", "--study", str(study), "--out", str(tmp_path / "d")]) == 130
    assert "7 of 208 load paths are kept; the same command completes them" in capsys.readouterr().err


@pytest.mark.slow
def test_other_commands_find_the_library_in_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = library_for(parse_study(STUDY), "finite-strain", count_bar)
    assert made is not None
    assert len(list((tmp_path / "scleraforce" / "libraries").glob("*.zarr"))) == 1
    again = library_for(parse_study(STUDY), "finite-strain", count_bar)
    assert again is not None
    assert (again.force_ratio_tpd == made.force_ratio_tpd).all()
