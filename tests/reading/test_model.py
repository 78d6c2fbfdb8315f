"""Model folders: loaded, checked, refused; the limits of each kind of model."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import SCALE, THICKNESS_M, frame_under
from analytic_library import analytic_library
from small_models import (
    force_reader,
    rehash_model,
    write_fixed_reader,
    write_raw_model,
)

from scleraforce.base.errors import ModelError
from scleraforce.reading.load_model import load_classifier, load_reader, opened_reader
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN, SEALED
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import boundary_slice
from virtual_eyes import changed


def slices(count: int, shape: tuple[int, int] = (8, 10)) -> np.ndarray:
    values = np.array([0, 255], dtype=np.uint8)
    return np.random.default_rng(1).choice(values, size=(count, *shape))


def test_probabilities_equal_the_network_computed_in_numpy(tiny_model):
    reader = load_reader(tiny_model.path)
    found = reader.probabilities(slices(50))
    lit = slices(50).reshape(50, -1) / 255.0
    shares = np.exp(lit @ tiny_model.weights + tiny_model.biases)
    expected = shares / shares.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-15)
    assert np.ptp(found, axis=0).max() > 0.1, "the network tells slices apart"
    again = load_reader(tiny_model.path).probabilities(slices(50))
    np.testing.assert_array_equal(found, again)
    assert reader.probabilities(slices(0)).shape == (0, 3)


@pytest.mark.parametrize("thickness_m", [None, 1.08 * THICKNESS_M])
def test_an_answer_is_the_networks_for_the_slice_of_the_segmented_frame(
    write_model, tmp_path, thickness_m: float | None
):
    """With the inner boundary that is found: a linear wall under a needle is not as
    thick as at rest.
    """
    model = load_classifier(write_model(tmp_path / "model", Study()).path)
    frame = frame_under(0.02)
    wall = find_wall(frame, SCALE, thickness_m, model.finder)
    assert wall.inner_found
    cut = boundary_slice(wall, SCALE, model.study.slice)
    assert 0.02 < (cut > 0).mean() < 0.3
    answer = model.read(frame, SCALE, Setup(eye=Eye(thickness_m=thickness_m)))
    expected = model.probabilities(cut[None])[0]
    np.testing.assert_allclose(answer.probabilities, expected, atol=1e-12)
    assert answer.predicted == np.argmax(expected)


@pytest.mark.parametrize(
    "wrong",
    [
        slices(2, (10, 8)),
        slices(1)[0],
        slices(1).astype(np.float32),
        slices(1) // 255,
        slices(1) ^ 7,
    ],
)
def test_slices_of_another_shape_type_or_value_are_refused(tiny_model, wrong):
    with pytest.raises(ModelError, match="slices"):
        load_reader(tiny_model.path).probabilities(wrong)


@pytest.mark.parametrize("name", ["model.onnx", "study.toml", "card.md", "model.json"])
def test_a_changed_file_and_a_missing_one_are_named(tiny_model, name):
    path = tiny_model.path / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    message = name if name == "model.json" else f"{name}: SHA-256"
    with pytest.raises(ModelError, match=message):
        load_reader(tiny_model.path)

    path.unlink()
    with pytest.raises(ModelError, match=name):
        load_reader(tiny_model.path)
    with pytest.raises(ModelError, match="no such folder"):
        load_reader(tiny_model.path / "nothing")


@pytest.mark.parametrize(
    ("stated", "other", "field"),
    [
        ("bounds_mn = [5.0, 30.0]", "bounds_mn = [5.0, 50.0]", "study_sha256"),
        ("rows = 8\n", "rows = 9\n", "input"),
    ],
)
def test_another_study_than_the_networks_is_refused_even_where_the_hashes_agree(
    tiny_model, stated, other, field
):
    study = tiny_model.path / "study.toml"
    study.write_text(study.read_text().replace(stated, other))
    rehash_model(tiny_model.path, "study.toml")
    with pytest.raises(ModelError, match=field):
        load_reader(tiny_model.path)


@pytest.mark.parametrize(
    ("content", "field"),
    [
        ("{", "not JSON"),
        ('{"format": 99}', "format"),
        ('{"format": 1, "kind": "oracle"}', "kind"),
        ('{"format": 1, "kind": "classifier"}', "files"),
    ],
)
def test_a_record_that_cannot_be_used_is_refused(tiny_model, content, field):
    (tiny_model.path / "model.json").write_text(content)
    with pytest.raises(ModelError, match=field):
        load_reader(tiny_model.path)


def test_a_network_that_cannot_be_used_is_refused(tiny_model):
    import onnx

    path = tiny_model.path / "model.onnx"
    model = onnx.load(path)
    for weights in model.graph.initializer:
        weights.raw_data = b"\xff" * len(weights.raw_data)
    onnx.save(model, path)
    rehash_model(tiny_model.path, "model.onnx")
    with pytest.raises(ModelError, match="not finite"):
        load_reader(tiny_model.path).probabilities(slices(1))

    outside = {"save_as_external_data": True, "location": "weights.bin"}
    onnx.save(model, path, **outside, size_threshold=0)
    rehash_model(tiny_model.path, "model.onnx")
    with pytest.raises(ModelError, match="asks for data in other files"):
        load_reader(tiny_model.path)

    path.write_bytes(b"not a network")
    rehash_model(tiny_model.path, "model.onnx")
    with pytest.raises(ModelError, match="ONNX Runtime"):
        load_reader(tiny_model.path)


SCAN = Scan(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3)


def test_a_classifier_reads_every_eye_as_its_own_and_says_its_limits(
    write_model, tmp_path
):
    model = load_classifier(write_model(tmp_path / "model", Study()).path)
    assert model.fixed_modulus_pa == Study().eye.youngs_modulus_pa
    assert (force_reader().fixed_modulus_pa, model.reads_force) == (None, False)
    thick = changed(Setup(), thickness_m=3e-3)
    sealed = changed(Setup(), globe=SEALED)
    assert model.refusal(thick) is None
    assert model.limits(changed(Setup(), globe=OPEN), SCAN) == ()
    limits = [model.limits(setup, SCAN) for setup in (thick, sealed)]
    found = [(one.code, one.fields) for (one,) in limits]
    # its linear mechanics knows no sealed eye
    thickness = ("outside-training", ("thickness_m",))
    assert found == [thickness, ("inputs-ignored", ("globe",))]


@pytest.fixture(params=["classifier", "reader", "raw-reader"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A small model of each kind."""
    path = tmp_path / request.param
    if request.param == "classifier":
        return request.getfixturevalue("tiny_model").path
    if request.param == "raw-reader":
        write_raw_model(path)
        return path

    library = analytic_library(thicknesses=4, ratios=4, tips=5)
    write_fixed_reader(path, library, [1.0] * 8)
    return path


def test_models_are_copied_and_pickled(folder):
    model = load_reader(folder)
    alone = pickle.loads(pickle.dumps(load_reader(folder, finder=None)))
    pickled = pickle.loads(pickle.dumps(model))
    for other in (pickled, alone, copy.deepcopy(model), copy.copy(model)):
        assert type(other) is type(model)
        assert other is not model
        assert (other.path, other.study) == (model.path, model.study)
        assert (other.record, other.provenance) == (model.record, model.provenance)

    if model.kind == "classifier":
        shares = (one.probabilities(slices(5)) for one in (pickled, model))
        np.testing.assert_array_equal(*shares)

    assert pickled.finder.origin == model.finder.origin
    assert alone.finder is None
    assert len(pickle.dumps(model)) < 2000  # neither network nor library


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [("card.md", "#", "##"), ("model.json", '"format"', '"more": 1, "format"')],
)
def test_a_pickle_does_not_load_a_changed_or_another_model(
    folder, tmp_path, name, before, after
):
    pickled = pickle.dumps(load_reader(folder, finder=None))
    content = (folder / name).read_text()
    (folder / name).write_text(content.replace(before, after, 1))
    with pytest.raises(ModelError, match=f"{name}: (SHA-256|not the model that)"):
        pickle.loads(pickled)

    folder.rename(tmp_path / "elsewhere")
    with pytest.raises(ModelError, match=r"no such folder, and a pickled model needs"):
        pickle.loads(pickled)


def test_a_model_that_no_folder_gave_is_not_pickled():
    with pytest.raises(ModelError, match="not loaded from a folder"):
        pickle.dumps(force_reader())


def test_a_model_is_loaded_once_named_as_it_is_given_and_checked_at_each_use(
    folder, monkeypatch
):
    monkeypatch.chdir(folder.parent)
    loaded = load_reader(folder)
    again = load_reader(f"./{folder.name}", finder=None)
    assert (str(again.path), again.finder) == (folder.name, None)
    assert again.record is loaded.record
    assert load_reader(folder, threads=2).record is not loaded.record
    monkeypatch.setattr("scleraforce.reading.load_model.KEPT", 1)
    load_reader("paper", finder=None)  # takes the place of all others
    assert load_reader(folder, finder=None).record is not loaded.record

    model = opened_reader(folder)
    assert (model.path, model.finder is None) == (folder, False)
    assert opened_reader(model) is model
    assert opened_reader("default") is opened_reader("default")
    (folder / "study.toml").write_text("")
    with pytest.raises(ModelError, match=r"study\.toml: SHA-256"):
        opened_reader(str(folder))
