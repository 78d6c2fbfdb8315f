"""The raw reader's network and training: against the graph that runs, repeatable, and a folder of its own kind."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from analytic_library import analytic_library

from scleraforce.known import Known, Modulus
from scleraforce.learning.raw_reader import RawReaderNetwork, RawSource, fit_raw_reader, raw_reader_bytes, slice_weights
from scleraforce.learning.reader import ReaderNetwork, histogram
from scleraforce.learning.train import train_raw_reader
from scleraforce.library import Library
from scleraforce.models import network_session
from scleraforce.reader import load_model
from scleraforce.reader.networks import GIVEN
from scleraforce.segmentation.reduced import FrameWindow
from scleraforce.study import RawReaderStudy, ReaderStudy, Study, parse_study, study_hash

TINY = Study(
    reader=ReaderStudy(channels=(6, 8), hidden=(24,), bins=16, samples_per_epoch=2000, validation_samples=100),
    raw_reader=RawReaderStudy(
        rows=80,
        columns=144,
        row_m=50e-6,
        column_m=100e-6,
        channels=(4, 6, 8),
        slice_epochs=1,
        batches=6,
        batch_size=8,
        validation_frames=40,
        interval_eyes=0,
    ),
)


@pytest.fixture(scope="module")
def library() -> Library:
    return analytic_library(thicknesses=5, ratios=5, tips=24)


def network(seed: int = 1) -> RawReaderNetwork:
    torch.manual_seed(seed)
    made = RawReaderNetwork(TINY, ReaderNetwork(TINY.reader, TINY.slice, TINY.eye.radius_m))
    made(torch.rand(4, 80, 144), torch.rand(4, len(GIVEN)))  # moves the means of its normalisations
    return made.eval()


def test_sure_boundaries_make_the_slice_of_the_wall_between_them() -> None:
    outer, inner = 20, 33  # rows of 50 µm: from the middle of the one to the middle of the other
    logits = torch.full((1, 2, 80, 72), -50.0)
    logits[0, 0, outer], logits[0, 1, inner] = 50.0, 50.0
    cut = network().slices(logits, torch.full((1, 72), 50.0))[0].numpy()
    assert cut.shape == (40, 140)
    expected = np.zeros(40)
    expected[10], expected[11:16], expected[16] = 0.75, 1.0, 0.75
    np.testing.assert_allclose(cut, np.repeat(expected[:, None], 140, axis=1), atol=1e-5)


def test_an_unsure_boundary_makes_a_share_and_keeps_the_mean_thickness() -> None:
    logits = torch.full((1, 2, 80, 72), -50.0)
    logits[0, 0, [18, 22]], logits[0, 1, 36] = 5.0, 50.0
    cut = network().slices(logits, torch.full((1, 72), 50.0))[0].numpy()
    assert cut[:, 70].sum() * TINY.slice.pixel_m == pytest.approx((36 - 20) * 50e-6, rel=1e-4)
    assert cut[10, 70] == pytest.approx(0.5, abs=1e-4)
    absent = network().slices(logits, torch.full((1, 72), -50.0)).numpy()
    assert absent.max() < 1e-12


def test_columns_between_two_pairs_are_their_mean() -> None:
    window = FrameWindow.of(TINY.raw_reader)
    weights = slice_weights(window, TINY.slice)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-6)
    pairs_m = window.laterals_m.reshape(-1, 2).mean(axis=1)
    columns_m = (np.arange(140) - 69.5) * 1e-4
    np.testing.assert_allclose(pairs_m @ weights, columns_m, atol=1e-9)


def test_the_graph_answers_as_the_network_does() -> None:
    made, rng = network(), np.random.default_rng(2)
    frames = rng.uniform(-0.4, 1.4, (3, 80, 144)).astype(np.float32)
    given = rng.normal(size=(3, len(GIVEN))).astype(np.float32)
    content = raw_reader_bytes(made, {"who": "me"})
    session = network_session(content, "place", 1)
    found, contact_m = session.run(["histogram", "contact_m"], {"frames": frames, "given": given})
    with torch.inference_mode():
        mixtures, places, _, _ = made(torch.from_numpy(frames), torch.from_numpy(given))
    np.testing.assert_allclose(found, histogram(mixtures, TINY.reader.bins).numpy(), atol=1e-5)
    np.testing.assert_allclose(contact_m, places.numpy() * 1e-3, atol=1e-7)
    assert session.get_modelmeta().custom_metadata_map == {"who": "me"}
    assert raw_reader_bytes(made, {"who": "me"}) == content


def test_the_force_reaches_the_part_that_sees_the_wall() -> None:
    made = network().train()
    mixtures, _, _, _ = made(torch.rand(2, 80, 144), torch.rand(2, len(GIVEN)))
    mixtures.square().sum().backward()
    first = made.sees_wall.down[0][0].weight.grad
    assert first is not None
    assert first.abs().max() > 0.0


@pytest.mark.slow
def test_a_training_is_repeatable_and_learns_where_the_wall_is(library: Library) -> None:
    study = replace(TINY, raw_reader=replace(TINY.raw_reader, batches=60, wall_share=0.5, learning_rate=0.01))
    counted: list[int] = []
    first, again = (fit_raw_reader(library, study, workers, counted.append) for workers in (1, 2))
    assert counted == [1, 1]
    for one, other in zip(first.network.parameters(), again.network.parameters(), strict=True):
        assert torch.equal(one, other)
    assert first.training_loss == again.training_loss
    samples = RawSource.of(library, study).chunk(2**31, 40)
    with torch.inference_mode():
        _, _, rows, _ = first.network(torch.from_numpy(samples.frames), torch.from_numpy(samples.given))
    found = (rows.softmax(dim=2) * torch.arange(80.0)[:, None]).sum(dim=2).numpy()
    assert np.nanmedian(np.abs(found - samples.boundary_rows)) < 6.0  # of 80; in the middle of all frames 13


@pytest.mark.slow
def test_the_folder_is_a_model_that_reads_forces(library: Library, tmp_path: Path) -> None:
    study = replace(TINY, raw_reader=replace(TINY.raw_reader, interval_eyes=6))
    done: dict[str, int] = {"epochs": 0, "batches": 0, "eyes": 0}
    trained = train_raw_reader(
        library,
        study,
        tmp_path / "raw",
        1,
        *(lambda count, name=name: done.update({name: done[name] + count}) for name in done),
    )
    assert done == {"epochs": 1, "batches": 6, "eyes": 6}
    assert (trained.batches, trained.frames) == (6, 48)
    record = json.loads((tmp_path / "raw" / "model.json").read_text())
    assert record["kind"] == "raw-reader"
    assert record["provenance"]["study_sha256"] == study_hash(study)
    assert record["samples"] == {"slices": 2000, "training": 48, "validation": 40}
    assert set(record["intervals"]) >= {"eyes", "network"}
    assert parse_study((tmp_path / "raw" / "study.toml").read_text()) == study
    assert "48 drawn raw frames" in (tmp_path / "raw" / "card.md").read_text()
    model = load_model(tmp_path / "raw", finder=None)
    assert (model.kind, model.reads_force, model.serves_loop) == ("raw-reader", True, False)
    assert model.refusal(Known(modulus=Modulus.stated(5e6))).startswith("Young's modulus 5 MPa")
    assert model.refusal(Known(gap_m=0.0)) is None
