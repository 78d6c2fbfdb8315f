"""Today's code still trains the bundled models: their fingerprints have not moved."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from provenance import fingerprint
from provenance.fingerprint import Fingerprint, moved
from scleraforce.library.files import load_library
from scleraforce.models import (
    SHIPPED_LIVING,
    SHIPPED_PAPER,
    SHIPPED_READER,
    SHIPPED_WALL_FINDER,
)
from scleraforce.reader.model import load_force_reader, load_model, load_wall_finder
from scleraforce.study import MeshStudy, Study, parse_study, preset_toml

INTERVALS = {"calibrated tissue", "scores", "traits", "factors"}


def record_of(folder: Path) -> Any:
    return json.loads((folder / "model.json").read_text())


def moved_since(folder: Path, now: Fingerprint) -> list[str]:
    """The entries computed now that have moved since the training of a bundled
    model.
    """
    before = record_of(folder)["fingerprint"]
    return moved({name: before[name] for name in before if name in now}, now)


def study_of(folder: Path) -> Study:
    return parse_study((folder / "study.toml").read_text())


@pytest.mark.slow
def test_the_intervals_of_the_shipped_reader_are_measured_as_today() -> None:
    library = load_library(SHIPPED_READER / "library.npz")
    network = (SHIPPED_READER / "model.onnx").read_bytes()
    now = fingerprint.interval_fingerprint(study_of(SHIPPED_READER), library, network)
    assert set(now) == INTERVALS
    assert not moved_since(SHIPPED_READER, now), "run `make model`"


@pytest.mark.parametrize(
    ("folder", "compute"),
    [
        (SHIPPED_PAPER, fingerprint.classifier_fingerprint),
        (SHIPPED_WALL_FINDER, fingerprint.finder_fingerprint),
    ],
)
def test_the_shipped_classifier_and_wall_finder_are_trained_as_today(
    folder: Path, compute
) -> None:
    found = moved(record_of(folder)["fingerprint"], compute(study_of(folder)))
    assert not found, "run `make paper` or `make wall-finder`"


def test_another_seed_moves_all_of_a_fingerprint() -> None:
    other = replace(Study(), scenes=replace(Study().scenes, seed=1))
    now = fingerprint.finder_fingerprint(other)
    assert moved_since(SHIPPED_WALL_FINDER, now) == sorted(now)


def test_an_entry_moves_with_values_order_missing_values_and_size_beyond_its_tolerance():
    values = 1e-7 * np.sin(np.arange(1000.0))
    before = {"a": fingerprint.item(values)}
    assert moved(before, {"a": fingerprint.item(values * (1.0 + 1e-8))}) == []
    others = (
        values * 1.001,
        values[::-1],
        np.where(values > 0.999e-7, np.nan, values),
        values[:20],
        [],
    )

    for other in others:
        assert moved(before, {"a": fingerprint.item(other)}) == ["a"]

    assert moved(before, {"a": fingerprint.item(values * 1.001, tolerance=0.01)}) == []
    assert moved(before, {"b": before["a"]}) == ["a", "b"]
    assert moved({"a": fingerprint.item([])}, {"a": fingerprint.item([])}) == []


def check_sections(study: Study, wanted: Study, target: str, *names: str) -> None:
    assert [
        name for name in names if getattr(study, name) != getattr(wanted, name)
    ] == [], f"run `make {target}`"


@pytest.mark.parametrize("folder", [SHIPPED_READER, SHIPPED_LIVING])
def test_the_shipped_readers_are_of_the_default_study_and_of_their_preset_whole_and_small(
    folder: Path,
) -> None:
    reader = load_force_reader(folder)
    target = "model" if folder == SHIPPED_READER else "living"
    wanted = Study() if folder == SHIPPED_READER else parse_study(preset_toml("living"))
    sections = "eye", "needle", "slice", "classes", "calibration", "library", "reader"
    check_sections(reader.study, wanted, target, *sections)
    assert reader.record["intervals"]["eyes"] >= 200, "trained without its intervals"
    assert sum(file.stat().st_size for file in SHIPPED_READER.iterdir()) < 9.5e6
    now = fingerprint.reader_fingerprint(reader.study, reader.library)
    assert set(record_of(SHIPPED_READER)["fingerprint"]) == {*now, *INTERVALS}
    found = moved_since(folder, now)
    assert not found, (
        f"run `make {target}`; if an entry of a path moved, raise library.plan.METHOD"
        " first"
    )


def test_the_shipped_classifier_is_the_papers_whole_and_small() -> None:
    reader = load_model("paper")
    assert reader.kind == "classifier"
    # what "automatic" is in `generate`
    today = replace(Study(), mesh=MeshStudy(kind="hexahedra"))
    check_sections(
        reader.study,
        today,
        "paper",
        "eye",
        "mesh",
        "needle",
        "slice",
        "classes",
        "dataset",
        "network",
    )
    assert (
        reader.record["samples"]["training"] + reader.record["samples"]["validation"]
        == 19_200
    )
    assert reader.record["metrics"]["validation_accuracy"] > 0.93
    assert sum(file.stat().st_size for file in SHIPPED_PAPER.iterdir()) < 8e6
    others = replace(
        reader.study,
        network=Study().network,
        scenes=today.scenes,
        wall_finder=today.wall_finder,
    )
    assert others == replace(today, eye=reader.study.eye)


def test_the_shipped_wall_finder_is_of_the_default_study_and_small() -> None:
    load_wall_finder(SHIPPED_WALL_FINDER)
    check_sections(
        study_of(SHIPPED_WALL_FINDER), Study(), "wall-finder", "scenes", "wall_finder"
    )
    assert (SHIPPED_WALL_FINDER / "model.onnx").stat().st_size < 2_500_000
