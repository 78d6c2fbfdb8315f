"""Today's code still trains the bundled models: their fingerprints have not moved."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from provenance import fingerprint
from provenance.fingerprint import Fingerprint, moved
from scleraforce.lab.training import interval_measurement
from scleraforce.lab.training.interval_measurement import wall_depths
from scleraforce.library.library_file import load_library
from scleraforce.library.library_store import solve_path
from scleraforce.reading.load_model import (
    load_force_reader,
    load_reader,
)
from scleraforce.records.model_folder import (
    SHIPPED_LIVING,
    SHIPPED_READER,
    SHIPPED_WALL_FINDER,
    path_or_bundled,
)
from scleraforce.records.study import Study, parse_study, preset_toml

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


def intervals_now(study: Study) -> Fingerprint:
    library = load_library(SHIPPED_READER / "library.npz")
    network = (SHIPPED_READER / "model.onnx").read_bytes()
    return fingerprint.interval_fingerprint(study, library, network)


@pytest.mark.slow
def test_the_intervals_of_the_shipped_reader_are_measured_as_today():
    now = intervals_now(study_of(SHIPPED_READER))
    assert set(now) == INTERVALS
    assert not moved_since(SHIPPED_READER, now), "run `make model`"


@pytest.mark.slow
def test_load_paths_that_are_2_percent_off_move_a_reader(monkeypatch):
    def stiffer(plan, unit):
        path = solve_path(plan, unit)
        return path._replace(force_d=1.02 * path.force_d)

    monkeypatch.setattr(fingerprint, "solve_path", stiffer)
    reader = load_force_reader(SHIPPED_READER)
    now = fingerprint.reader_fingerprint(reader.study, reader.library)
    paths = {f"force_d of path {number}" for number in range(4)}
    assert paths <= set(moved_since(SHIPPED_READER, now))


@pytest.mark.slow
def test_eyes_that_are_5_percent_stiffer_move_the_calibration(monkeypatch):
    def under_less(eye, forces_n, *place):
        return wall_depths(eye, forces_n / 1.05, *place)

    monkeypatch.setattr(interval_measurement, "wall_depths", under_less)
    now = intervals_now(study_of(SHIPPED_READER))
    assert "calibrated tissue" in moved_since(SHIPPED_READER, now)


SCORES = np.linspace(0.0, 2.0, 60)
TRAITS = np.full(100, 3)
FACTORS = np.array([0.3, 1.0, 15.0])


@pytest.mark.parametrize(
    ("sort", "before", "now", "moves"),
    [
        # scores may change places and move by a tenth
        (fingerprint.SCORES, SCORES, SCORES[::-1], False),
        (fingerprint.SCORES, SCORES, SCORES - 0.09, False),
        (fingerprint.SCORES, SCORES, SCORES + 0.11, True),
        (fingerprint.SCORES, SCORES, np.sqrt(SCORES), True),
        # a few traits may move, and each factor by a tenth of its own
        (fingerprint.TRAITS, TRAITS, np.where(np.arange(100) < 1, 4, TRAITS), False),
        (fingerprint.TRAITS, TRAITS, np.where(np.arange(100) < 20, 4, TRAITS), True),
        (fingerprint.FACTORS, FACTORS, FACTORS * [1.09, 1.0, 1.0], False),
        (fingerprint.FACTORS, FACTORS, FACTORS * [1.11, 1.0, 1.0], True),
    ],
)
def test_an_entry_moves_beyond_the_tolerance_of_its_sort(
    sort: Any, before: np.ndarray, now: np.ndarray, moves: bool
):
    # today's tolerance decides, not the one in the record
    strict = {"a": fingerprint.item(before, sort) | {"tolerance": 1e-6}}
    assert bool(moved(strict, {"a": fingerprint.item(now, sort)})) == moves


def check_sections(study: Study, wanted: Study, target: str, *names: str) -> None:
    different = [
        name for name in names if getattr(study, name) != getattr(wanted, name)
    ]
    assert different == [], f"run `make {target}`"


@pytest.mark.slow
def test_the_shipped_wall_finder_is_of_the_default_study_small_and_trained_as_today():
    study = study_of(SHIPPED_WALL_FINDER)
    check_sections(study, Study(), "wall-finder", "scenes", "wall_finder")
    assert (SHIPPED_WALL_FINDER / "model.onnx").stat().st_size < 2_500_000
    found = moved(
        record_of(SHIPPED_WALL_FINDER)["fingerprint"],
        fingerprint.finder_fingerprint(study),
    )
    assert not found, "run `make wall-finder`"


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

    loose = fingerprint.Tolerance(of_largest=0.01)
    assert moved(before, {"a": fingerprint.item(values * 1.001, loose)}) == []
    assert moved(before, {"b": before["a"]}) == ["a", "b"]
    assert moved({"a": fingerprint.item([])}, {"a": fingerprint.item([])}) == []


@pytest.mark.slow
@pytest.mark.parametrize("folder", [SHIPPED_READER, SHIPPED_LIVING])
def test_the_shipped_readers_are_of_the_default_study_and_of_their_preset_whole_and_small(
    folder: Path,
):
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


@pytest.mark.slow
def test_the_shipped_classifier_is_the_papers_whole_small_and_trained_as_today():
    folder = path_or_bundled("paper")
    reader = load_reader(folder)
    assert reader.kind == "classifier"
    sections = "eye", "mesh", "needle", "slice", "classes", "dataset", "network"
    check_sections(reader.study, Study(), "paper", *sections)
    assert sum(reader.record["samples"].values()) == 19_200
    assert reader.record["metrics"]["validation_accuracy"] > 0.93
    assert sum(file.stat().st_size for file in folder.iterdir()) < 8e6
    now = fingerprint.classifier_fingerprint(study_of(folder))
    assert not moved(reader.record["fingerprint"], now), "run `make paper`"
