"""Today's code still trains the bundled models: their fingerprints have not moved."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from provenance import fingerprint
from provenance.fingerprint import Fingerprint, moved
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.lab.training import interval_measurement
from scleraforce.lab.training.interval_measurement import wall_depths
from scleraforce.library.library_file import load_library
from scleraforce.library.library_store import solve_path
from scleraforce.reading.load_model import (
    load_force_reader,
    load_reader,
    load_wall_finder,
)
from scleraforce.records.model_folder import (
    SHIPPED_LIVING,
    SHIPPED_PAPER,
    SHIPPED_READER,
    SHIPPED_WALL_FINDER,
)
from scleraforce.records.study import MeshStudy, Study, parse_study, preset_toml

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


def intervals_now(study: Study, stiffer: float = 1.0) -> Fingerprint:
    library = load_library(SHIPPED_READER / "library.npz")
    forces = stiffer * library.walls.force_ratio_btpd
    library = replace(library, walls=replace(library.walls, force_ratio_btpd=forces))
    network = (SHIPPED_READER / "model.onnx").read_bytes()
    return fingerprint.interval_fingerprint(study, library, network)


@pytest.mark.slow
def test_the_intervals_of_the_shipped_reader_are_measured_as_today() -> None:
    now = intervals_now(study_of(SHIPPED_READER))
    assert set(now) == INTERVALS
    assert not moved_since(SHIPPED_READER, now), "run `make model`"


@pytest.mark.slow
def test_another_start_of_the_fit_does_not_move_the_intervals(monkeypatch) -> None:
    """Each fit is begun a second time, at its own end, and goes on to a closer one."""

    def begun_again(library, lateral_m, depth_bc, prior, smoothing_m):
        columns = library, lateral_m, depth_bc, prior, smoothing_m
        first = fit_boundaries(*columns)
        return first and fit_boundaries(*columns, begun=first.unknown)

    monkeypatch.setattr(interval_measurement, "fit_boundaries", begun_again)
    now = intervals_now(study_of(SHIPPED_READER))
    before = record_of(SHIPPED_READER)["fingerprint"]["scores"]
    assert now["scores"]["values"] != before["values"]
    assert not moved_since(SHIPPED_READER, now)


@pytest.mark.slow
def test_another_seed_or_number_of_frames_moves_the_intervals(monkeypatch) -> None:
    study = study_of(SHIPPED_READER)
    other = replace(study, reader=replace(study.reader, seed=study.reader.seed + 1))
    found = moved_since(SHIPPED_READER, intervals_now(other))
    assert found == sorted(INTERVALS)

    monkeypatch.setattr(interval_measurement, "CALIBRATED", 2)
    found = moved_since(SHIPPED_READER, intervals_now(study))
    assert {"scores", "traits"} <= set(found)


@pytest.mark.slow
def test_load_paths_that_are_2_percent_off_move_a_reader(monkeypatch) -> None:
    def stiffer(plan, unit):
        path = solve_path(plan, unit)
        return path._replace(force_d=1.02 * path.force_d)

    monkeypatch.setattr(fingerprint, "solve_path", stiffer)
    reader = load_force_reader(SHIPPED_READER)
    now = fingerprint.reader_fingerprint(reader.study, reader.library)
    paths = {f"force_d of path {number}" for number in range(4)}
    assert paths <= set(moved_since(SHIPPED_READER, now))


@pytest.mark.slow
def test_a_library_that_is_2_percent_stiffer_moves_the_scores() -> None:
    now = intervals_now(study_of(SHIPPED_READER), stiffer=1.02)
    assert moved_since(SHIPPED_READER, now) == ["scores"]


@pytest.mark.slow
def test_eyes_that_are_5_percent_stiffer_move_the_calibration(monkeypatch) -> None:
    def under_less(eye, forces_n, *place):
        return wall_depths(eye, forces_n / 1.05, *place)

    monkeypatch.setattr(interval_measurement, "wall_depths", under_less)
    now = intervals_now(study_of(SHIPPED_READER))
    assert "calibrated tissue" in moved_since(SHIPPED_READER, now)


def test_scores_of_intervals_may_change_places_and_move_by_a_tenth() -> None:
    scores = np.linspace(0.0, 2.0, 60)
    before = {"scores": fingerprint.item(scores, fingerprint.SCORES)}

    for other in (scores[::-1], scores + 0.09, scores - 0.09):
        now = {"scores": fingerprint.item(other, fingerprint.SCORES)}
        assert moved(before, now) == []

    for other in (scores + 0.11, 1.2 * scores, np.sqrt(scores)):
        now = {"scores": fingerprint.item(other, fingerprint.SCORES)}
        assert moved(before, now) == ["scores"]


def test_a_few_traits_may_move_and_each_factor_by_a_tenth_of_its_own() -> None:
    traits = np.full(100, 3)
    before = {"traits": fingerprint.item(traits, fingerprint.TRAITS)}
    for changed, found in ((1, []), (20, ["traits"])):
        other = traits.copy()
        other[1 : 1 + changed] = 4
        now = {"traits": fingerprint.item(other, fingerprint.TRAITS)}
        assert moved(before, now) == found

    factors = np.array([0.3, 1.0, 15.0])
    before = {"factors": fingerprint.item(factors, fingerprint.FACTORS)}
    for change, found in ((1.09, []), (1.11, ["factors"])):
        other = factors * [change, 1.0, 1.0]
        now = {"factors": fingerprint.item(other, fingerprint.FACTORS)}
        assert moved(before, now) == found


def test_todays_tolerance_decides_not_the_one_in_the_record() -> None:
    values = np.linspace(1.0, 2.0, 60)
    strict = {"a": fingerprint.item(values) | {"tolerance": 1e-6}}
    loose = {"a": fingerprint.item(values + 0.05, fingerprint.SCORES)}
    assert moved(strict, loose) == []
    assert moved(loose, strict) == ["a"]


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

    loose = fingerprint.Tolerance(of_largest=0.01)
    assert moved(before, {"a": fingerprint.item(values * 1.001, loose)}) == []
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
    reader = load_reader("paper")
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
