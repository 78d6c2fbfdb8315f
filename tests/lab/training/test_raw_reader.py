"""The raw reader: samples, network, training, and a folder of its own kind."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from scleraforce.base.onnx_network import network_session
from scleraforce.lab.tissue_light import BscanOptics
from scleraforce.lab.training import raw_reader_training
from scleraforce.lab.training.force_reader_training import (
    ReaderNetwork,
    force_bytes,
    histogram,
)
from scleraforce.lab.training.trained_models import train_raw_reader
from scleraforce.library import Library
from scleraforce.reading.force_network import GIVEN
from scleraforce.reading.load_model import load_reader
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import (
    RawReaderStudy,
    ReaderStudy,
    Study,
    fixed,
    parse_study,
    study_hash,
)
from scleraforce.wall.wall_network import FrameWindow

TINY = Study(
    reader=ReaderStudy(
        channels=(6, 8),
        hidden=(24,),
        bins=16,
        samples_per_epoch=2000,
        validation_samples=100,
    ),
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


def tiny_network(seed: int = 1) -> raw_reader_training.RawReaderNetwork:
    torch.manual_seed(seed)
    made = raw_reader_training.RawReaderNetwork(
        TINY, ReaderNetwork(TINY.reader, TINY.slice, TINY.eye.radius_m)
    )
    # moves the means of its normalisations
    made(torch.rand(4, 80, 144), torch.rand(4, len(GIVEN)))

    return made.eval()


def slice_between(outer_rows: list[int], inner_row: int, wall: float) -> np.ndarray:
    """The slice that a network makes of boundaries that it is sure of, or unsure
    between rows.
    """
    logits = torch.full((1, 2, 80, 72), -50.0)
    logits[0, 0, outer_rows] = 50.0
    logits[0, 1, inner_row] = 50.0
    walls = torch.full((1, 72), wall)
    return tiny_network().slices(logits, walls)[0].numpy()


def test_sure_boundaries_make_the_slice_of_the_wall_between_them():
    # rows of 50 µm: from the middle of the one to the middle of the other
    cut = slice_between([20], 33, 50.0)
    expected = np.zeros((40, 140))
    expected[11:16] = 1.0
    expected[[10, 16]] = 0.75
    np.testing.assert_allclose(cut, expected, atol=1e-5)


def test_an_unsure_boundary_makes_a_share_and_keeps_the_mean_thickness():
    cut = slice_between([18, 22], 36, 50.0)
    assert cut[:, 70].sum() * TINY.slice.pixel_m == pytest.approx(
        (36 - 20) * 50e-6, rel=1e-4
    )
    assert cut[10, 70] == pytest.approx(0.5, abs=1e-4)
    assert slice_between([20], 33, -50.0).max() < 1e-12


def test_the_graph_answers_as_the_network_does():
    made = tiny_network()
    rng = np.random.default_rng(2)
    frames = rng.uniform(-0.4, 1.4, (3, 80, 144)).astype(np.float32)
    given = rng.normal(size=(3, len(GIVEN))).astype(np.float32)
    content = force_bytes(made, {"who": "me"})
    session = network_session(content, "place", 1)
    found, contact_m = session.run(
        ["histogram", "contact_m"], {"frames": frames, "given": given}
    )

    with torch.inference_mode():
        mixtures, places, _, _ = made(torch.from_numpy(frames), torch.from_numpy(given))

    np.testing.assert_allclose(
        found, histogram(mixtures, TINY.reader.bins).numpy(), atol=1e-5
    )
    np.testing.assert_allclose(contact_m, places.numpy() * 1e-3, atol=1e-7)
    assert session.get_modelmeta().custom_metadata_map == {"who": "me"}
    assert force_bytes(made, {"who": "me"}) == content


@pytest.mark.slow
def test_a_training_is_repeatable_and_learns_where_the_wall_is(
    library,
):
    study = replace(
        TINY,
        raw_reader=replace(
            TINY.raw_reader, batches=60, wall_share=0.5, learning_rate=0.01
        ),
    )
    counted: list[int] = []
    first, again = (
        raw_reader_training.fit_raw_reader(library, study, workers, counted.append)
        for workers in (1, 2)
    )
    assert counted == [1, 1]
    assert all(map(torch.equal, first.network.parameters(), again.network.parameters()))
    assert first.training_loss == again.training_loss
    samples = raw_reader_training.RawSource(library, study).chunk(2**31, 40)

    with torch.inference_mode():
        _, _, rows, _ = first.network(
            torch.from_numpy(samples.frames), torch.from_numpy(samples.given)
        )

    found = (rows.softmax(dim=2) * torch.arange(80.0)[:, None]).sum(dim=2).numpy()
    # of 80; in the middle of all frames 13
    assert np.nanmedian(np.abs(found - samples.boundary_rows)) < 6.0


@pytest.mark.slow
def test_the_folder_is_a_model_that_reads_forces(library, tmp_path):
    study = replace(TINY, raw_reader=replace(TINY.raw_reader, interval_eyes=6))
    done = epochs, batches, eyes = [], [], []
    train_raw_reader(
        library, study, tmp_path / "raw", 1, *(each.append for each in done)
    )
    assert (sum(epochs), sum(batches), sum(eyes)) == (1, 6, 6)
    record = json.loads((tmp_path / "raw" / "model.json").read_text())
    assert record["kind"] == "raw-reader"
    assert record["provenance"]["study_sha256"] == study_hash(study)
    assert record["samples"] == {"slices": 2000, "training": 48, "validation": 40}
    assert set(record["intervals"]) >= {"eyes", "network"}
    assert parse_study((tmp_path / "raw" / "study.toml").read_text()) == study
    assert "48 drawn raw frames" in (tmp_path / "raw" / "card.md").read_text()
    model = load_reader(tmp_path / "raw", finder=None)
    assert (model.kind, model.reads_force, model.serves_loop) == (
        "raw-reader",
        True,
        False,
    )
    assert model.refusal(Setup(eye=Eye(modulus=Modulus.stated(5e6)))).startswith(
        "Young's modulus 5 MPa"
    )
    assert model.refusal(Setup(needle=Needle(gap_m=0.0))) is None


STUDY = Study(
    raw_reader=RawReaderStudy(rows=80, columns=144, row_m=50e-6, column_m=100e-6)
)
COUNT = 60


@pytest.fixture(scope="module")
def source(library: Library) -> raw_reader_training.RawSource:
    return raw_reader_training.RawSource(library, STUDY)


def study_with(**raw: object) -> Study:
    """Return a study whose raw reader sees frames without needle or conjunctiva by the
    scanner of [phantom] alone.
    """
    none = {
        "needle_share": 0.0,
        "conjunctiva_share": 0.0,
        "snr_loss_db": fixed(0.0),
        "speckle_factor": fixed(1.0),
    }
    return replace(STUDY, raw_reader=replace(STUDY.raw_reader, **{**none, **raw}))


def test_frames_are_bright_between_their_boundaries_and_dark_above(
    source,
):
    plain = raw_reader_training.RawSource(source.library, study_with()).chunk(1, COUNT)
    row = np.arange(80)[:, None]
    pairs = plain.frames.reshape(COUNT, 80, 72, 2).mean(axis=3)
    outer = plain.boundary_rows[:, :1]
    inner = plain.boundary_rows[:, 1:]
    # below the line
    inside = (row > outer + 1.0) & (row < inner - 1.0)
    above = (row < outer - 1.5) & (row > 8)
    assert np.nanmean(pairs[inside]) > 0.6
    assert abs(pairs[above].mean()) < 0.05


def test_the_tip_touches_the_wall():
    window = FrameWindow.of(STUDY.raw_reader)
    rng = np.random.default_rng(4)
    depth = np.full((1, 2, window.columns), 1.5e-3)
    optics = [raw_reader_training.draw_optics(STUDY, 0.0, rng)]
    (shaft,) = raw_reader_training.draw_shafts(
        optics, depth, np.array([0.4e-3]), np.zeros(1), STUDY
    )
    rows, columns = np.nonzero(shaft.inside)
    lowest = columns[rows == rows.max()] - window.columns / 2
    assert rows.max() * window.row_m == pytest.approx(1.45e-3, abs=0.06e-3)
    assert abs(lowest.mean() * window.column_m - 0.4e-3) < 0.6e-3


def optics_of(study: Study, count: int = 200) -> list[BscanOptics]:
    """The optics of frames whose plane no needle crosses."""
    rngs = map(np.random.default_rng, range(count))
    return [raw_reader_training.draw_optics(study, None, rng) for rng in rngs]


@pytest.mark.parametrize(("loss_db", "factor"), [(0.0, 1.0), (6.0, 3.0)])
def test_the_scanner_is_the_phantoms_or_worse_by_the_given_amount(
    loss_db: float, factor: float
):
    study = study_with(snr_loss_db=fixed(loss_db), speckle_factor=fixed(factor))
    drawn = optics_of(study)
    for name, less, times in (
        ("snr_db", loss_db, 1.0),
        ("lateral_resolution_m", 0.0, factor),
        ("axial_resolution_m", 0.0, factor),
    ):
        values = [(getattr(each, name) + less) / times for each in drawn]
        low, high = getattr(study.phantom, name).bounds
        edge = 0.1 * (high - low)
        assert low <= min(values) < low + edge
        assert high - edge < max(values) <= high

    assert {(each.conjunctiva, each.needle) for each in drawn} == {(None, None)}


def test_a_share_of_the_frames_has_a_conjunctiva_of_the_range():
    study = study_with(conjunctiva_share=0.3)
    layers = [each.conjunctiva for each in optics_of(study, 400)]
    thick_m = [layer.thickness_m for layer in layers if layer]
    assert len(thick_m) / 400 == pytest.approx(0.3, abs=0.08)
    low, high = study.raw_reader.conjunctiva_thickness_m.bounds
    assert low <= min(thick_m) < max(thick_m) <= high


@pytest.mark.slow
def test_a_needle_crosses_its_share_of_the_planes_within_its_diameter(
    library,
):
    """Planes that it crosses are drawn nearer than the reader's nearest."""
    study = study_with(needle_share=0.5)
    raw = study.raw_reader
    given = raw_reader_training.RawSource(library, study).chunk(2, 400).given
    nearest_m, farthest_m = study.reader.gap_m.bounds
    stated = given[:, GIVEN.index("gap known")] > 0.0
    gaps_m = 0.5 * farthest_m * (1.0 + given[stated, GIVEN.index("gap")])
    largest_m = raw.needle_gap_fraction * raw.needle_diameter_m.bounds[1]
    share = 0.5 * 0.85 * nearest_m / largest_m
    assert (gaps_m < 0.85 * nearest_m).mean() == pytest.approx(share, abs=0.1)
    needle = raw_reader_training.draw_optics(
        study, largest_m, np.random.default_rng(1)
    ).needle
    assert needle.gap_m == largest_m
    assert largest_m <= (1.0 + 1e-9) * raw.needle_gap_fraction * needle.diameter_m


def test_a_linear_display_is_drawn_where_the_phantom_has_one(library):
    """There, dim tissue is dark."""
    shares = []
    for display in ("logarithmic", "linear"):
        study = replace(Study(), phantom=replace(Study().phantom, display=display))
        frames = raw_reader_training.RawSource(library, study).chunk(1, 20).frames
        shares.append(np.mean((frames > 0.3) & (frames < 0.9)))

    assert abs(shares[1] - shares[0]) > 0.02
