"""A folder of kind "reader": loaded, refused, and what its network's histogram means."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_library import analytic_library
from small_models import write_fixed_reader

from scleraforce.errors import ModelError
from scleraforce.known import ForceDiscrepancy, Known, Modulus
from scleraforce.models import sha256
from scleraforce.reader import load_classifier, load_model
from scleraforce.reader.networks import given_eye, ratio_edges, unknown_modulus

pytest.importorskip("torch")

SHARES = (0.0, 0.0, 0.25, 0.5, 0.25, 0.0, 0.0, 0.0)
CUTS = np.zeros((4, 40, 140), dtype=np.uint8)
LIBRARY = analytic_library(thicknesses=4, ratios=4, tips=6)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_fixed_reader(tmp_path / "model", LIBRARY, SHARES, contact_m=0.4e-3)
    return tmp_path / "model"


def rewrite(folder: Path, name: str, content: bytes) -> None:
    """Replace a file and its hash."""
    (folder / name).write_bytes(content)
    record = json.loads((folder / "model.json").read_text())
    record["files"][name] = sha256(content)
    (folder / "model.json").write_text(json.dumps(record))


def test_force_and_interval_scale_with_the_modulus_that_it_is_told(folder: Path) -> None:
    reader = load_model(folder)
    edges = ratio_edges(len(SHARES), reader.study.reader.max_force_ratio)
    for modulus_pa in (0.2e6, 0.5e6):
        read = reader.read_slices(CUTS, Known(modulus=Modulus(mean_pa=modulus_pa, sd_pa=5e3, source="own")))
        # A quarter lies below edge 3, half in bin 3, a quarter above edge 4.
        assert read.force_n == pytest.approx(modulus_pa * (edges[3] + edges[4]) / 2, rel=1e-5)
        ends = edges[2] + 0.2 * (edges[3] - edges[2]), edges[5] - 0.2 * (edges[5] - edges[4])
        np.testing.assert_allclose(read.interval_n, modulus_pa * np.array(ends), rtol=1e-5)
        assert read.contact_m == pytest.approx(0.4e-3)
        assert sum(read.probabilities) == pytest.approx(1.0)


def test_what_a_calibration_found_of_the_forces_moves_the_reading_and_its_interval(folder: Path) -> None:
    known = Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"))
    stiffer = ForceDiscrepancy(level=0.05, growth=0.4, level_sd=0.01, growth_sd=0.02, correlation=0.0)
    reader = load_model(folder)
    was, now = (reader.read_slices(CUTS, replace(known, discrepancy=found)) for found in (None, stiffer))
    # The quantiles move as forces do, but for the bins between whose ends they lie.
    np.testing.assert_allclose(now.interval_n, stiffer.corrected_n(np.array(was.interval_n)), rtol=0.02)
    assert now.force_n == pytest.approx(float(stiffer.corrected_n(np.array(was.force_n))), rel=0.02)
    assert now.force_n != pytest.approx(was.force_n, rel=0.02)


def test_the_reading_of_several_slices_is_that_of_the_mean_of_their_histograms(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    histograms = np.array([[0, 1, 0, 0, 0, 0, 0, 0], [0, 0, 0.5, 0, 0.5, 0, 0, 0]], dtype=np.float32)
    fed: list[dict[str, np.ndarray]] = []

    class Session:
        def run(self, _: object, inputs: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
            fed.append(inputs)
            return histograms, np.array([0.1e-3, 0.4e-3], dtype=np.float32)

    reader = load_model(folder)
    edges = ratio_edges(len(SHARES), reader.study.reader.max_force_ratio)
    monkeypatch.setattr(reader._network, "_session", Session())
    read = reader.read_slices(CUTS[:2], Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"), iop_pa=250.0))
    assert read.force_n == pytest.approx(0.3e6 * edges[2], rel=1e-5)  # half of the mean lies below
    assert read.contact_m == pytest.approx(0.25e-3)
    (inputs,) = fed
    assert inputs["slices"].shape == (2, 40, 140)
    np.testing.assert_array_equal(inputs["given"][0], inputs["given"][1])


def test_the_factor_of_its_group_stretches_what_the_network_reads(folder: Path) -> None:
    known = Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"))
    was = load_model(folder).read_slices(CUTS, known)
    record = json.loads((folder / "model.json").read_text())
    record["intervals"] = {"network": {"own E": {"unknown": 1.5}, "other E": {"unknown": 9.0}}}
    (folder / "model.json").write_text(json.dumps(record))
    now = load_model(folder).read_slices(CUTS, known)
    assert now.force_n == was.force_n
    assert now.interval_n[1] - now.force_n == pytest.approx(1.5 * (was.interval_n[1] - was.force_n))


def test_an_unknown_modulus_is_the_middle_of_the_training(folder: Path) -> None:
    reader = load_model(folder)
    mean_pa, _ = unknown_modulus(reader.study.reader)
    assert (
        reader.read_slices(CUTS, Known()).force_n
        == reader.read_slices(CUTS, Known(modulus=Modulus(mean_pa=mean_pa, sd_pa=1e3, source="own"))).force_n
    )


def test_what_is_not_known_is_told_as_not_known() -> None:
    told = given_eye(Known(iop_pa=250.0, gap_m=0.5e-3))
    assert np.isnan([told.modulus_pa[0], told.modulus_sd_fraction[0], told.thickness_m[0]]).all()
    assert (told.iop_pa[0], told.gap_m[0]) == (250.0, 0.5e-3)
    sure = given_eye(Known(modulus=Modulus(mean_pa=0.25e6, sd_pa=1.0, source="own")))
    assert sure.modulus_sd_fraction[0] == 0.01
    assert np.isnan([told.polar_rad[0], told.direction_rad[0]]).all()
    placed = given_eye(Known(polar_rad=0.6, direction_rad=-1.2))
    assert (placed.polar_rad[0], placed.direction_rad[0]) == (0.6, -1.2)


def test_the_folder_says_which_method_answers(folder: Path) -> None:
    reader = load_model(folder)
    assert (reader.default, reader.other, reader.kind) == ("fit", "network", "reader")
    record = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps({**record, "default": "guess"}))
    with pytest.raises(ModelError, match="default: found 'guess'"):
        load_model(folder)


def test_a_library_that_was_changed_is_refused(folder: Path) -> None:
    content = bytearray((folder / "library.npz").read_bytes())
    content[len(content) // 2] ^= 1
    (folder / "library.npz").write_bytes(content)
    with pytest.raises(ModelError, match=r"library\.npz: SHA-256"):
        load_model(folder)


def test_a_library_that_is_none_is_refused_even_where_its_hash_agrees(folder: Path) -> None:
    rewrite(folder, "library.npz", b"nothing")
    with pytest.raises(ModelError, match=r"library\.npz: not a response library"):
        load_model(folder)


def test_a_network_for_another_histogram_is_refused(folder: Path) -> None:
    study = (folder / "study.toml").read_text().replace(f"bins = {len(SHARES)}\n", "bins = 16\n")
    rewrite(folder, "study.toml", study.encode())
    with pytest.raises(ModelError, match="outputs: found"):
        load_model(folder)


def test_a_reader_where_a_classifier_is_needed_is_refused(folder: Path) -> None:
    with pytest.raises(ModelError, match="found 'reader', a classifier is needed here"):
        load_classifier(folder)
