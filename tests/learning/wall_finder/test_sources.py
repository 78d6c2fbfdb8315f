"""The wall finder that ships with the package was trained with today's sources."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from scleraforce.laboratory import scenes
from scleraforce.learning.wall_finder import sources
from scleraforce.learning.wall_finder.sources import MODULES, finder_sources_hash
from scleraforce.models.shipped import SHIPPED_WALL_FINDER
from scleraforce.reader.wall_finder_model import load_wall_finder
from scleraforce.study import Study, parse_study


def test_the_shipped_wall_finder_is_of_todays_sources() -> None:
    """Where it fails, a module that decides the weights has changed: `make wall-finder` trains it anew."""
    record = json.loads((SHIPPED_WALL_FINDER / "model.json").read_text())
    assert record["provenance"]["sources_sha256"] == finder_sources_hash(), "run `make wall-finder`"


def test_the_shipped_wall_finder_is_of_the_default_study_and_small() -> None:
    load_wall_finder(SHIPPED_WALL_FINDER)
    study = parse_study((SHIPPED_WALL_FINDER / "study.toml").read_text())
    assert study.scenes == Study().scenes
    assert study.wall_finder == Study().wall_finder
    assert (SHIPPED_WALL_FINDER / "model.onnx").stat().st_size < 700_000


def test_all_that_scenes_are_drawn_by_decides() -> None:
    drawing = {path for path in Path(str(scenes.__file__)).parent.glob("*.py") if path.name != "__init__.py"}
    assert drawing <= {Path(str(module.__file__)) for module in MODULES}


def test_the_hash_changes_with_a_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "scleraforce"
    package.mkdir()
    monkeypatch.setattr("scleraforce.source_hash.PACKAGE", package)
    monkeypatch.setattr(sources, "MODULES", (SimpleNamespace(__file__=package / "one.py"),))
    (package / "one.py").write_text("VALUE = 1\n")
    before = finder_sources_hash()
    assert finder_sources_hash() == before
    (package / "one.py").write_text("VALUE = 2\n")
    assert finder_sources_hash() != before
