"""Model folders: loaded, checked, refused; the limits of each kind of model."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from analytic_library import analytic_library
from small_models import (
    force_reader,
    rehash_model,
    write_fixed_reader,
    write_raw_model,
)

from scleraforce.base.errors import ModelError
from scleraforce.reading.load_model import load_classifier, load_reader, opened_reader
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study


def slices(count: int, shape: tuple[int, int] = (8, 10)) -> np.ndarray:
    return np.random.default_rng(1).choice(
        np.array([0, 255], dtype=np.uint8), size=(count, *shape)
    )


def test_probabilities_equal_the_network_computed_in_numpy(tiny_model) -> None:
    reader = load_reader(tiny_model.path)
    other = load_reader(tiny_model.path)
    found = reader.probabilities(slices(50))
    np.testing.assert_allclose(
        found, tiny_model.network.probabilities(slices(50)), atol=1e-6
    )
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-15)
    assert np.ptp(found, axis=0).max() > 0.1, (
        "a network that always gives the same answer proves nothing"
    )
    np.testing.assert_array_equal(found, other.probabilities(slices(50)))
    assert reader.probabilities(slices(0)).shape == (0, 3)


def test_slices_of_another_shape_type_or_value_are_refused(tiny_model) -> None:
    reader = load_reader(tiny_model.path)
    other = (
        slices(2, (10, 8)),
        slices(1)[0],
        slices(1).astype(np.float32),
        slices(1) // 255,
        slices(1) ^ 7,
    )

    for wrong in other:
        with pytest.raises(ModelError, match="slices"):
            reader.probabilities(wrong)


def test_a_changed_file_and_a_missing_one_are_named(tiny_model) -> None:
    for name in ("model.onnx", "study.toml", "card.md", "model.json"):
        path = tiny_model.path / name
        content = path.read_bytes()
        middle = len(content) // 2
        path.write_bytes(
            content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
        )

        with pytest.raises(
            ModelError,
            match="model.json" if name == "model.json" else f"{name}: SHA-256",
        ):
            load_reader(tiny_model.path)

        path.unlink()
        with pytest.raises(ModelError, match=name):
            load_reader(tiny_model.path)

        path.write_bytes(content)

    with pytest.raises(ModelError, match="no such folder"):
        load_reader(tiny_model.path / "nothing")


def test_another_study_than_the_networks_is_refused_even_where_the_hashes_agree(
    tiny_model,
) -> None:
    study = tiny_model.path / "study.toml"
    text = study.read_text()

    for stated, other, field in (
        ("bounds_mn = [5.0, 30.0]", "bounds_mn = [5.0, 50.0]", "study_sha256"),
        ("rows = 8\n", "rows = 9\n", "input"),
    ):
        study.write_text(text.replace(stated, other))
        rehash_model(tiny_model.path, "study.toml")
        with pytest.raises(ModelError, match=field):
            load_reader(tiny_model.path)


def test_a_record_that_cannot_be_used_is_refused(tiny_model) -> None:
    for content, field in (
        ("{", "not JSON"),
        ("[]", "format"),
        ('{"format": 99}', "format"),
        ('{"format": 1, "kind": "oracle"}', "kind"),
        ('{"format": 1, "kind": "classifier"}', "files"),
        ('{"format": 1, "kind": {}}', "kind"),
        ('{"format": [1]}', "format"),
        ("[" * 100_000, "nested too deep"),
        ('{"format": NaN}', "not a number of JSON"),
        ('{"format": ' + "9" * 5000 + "}", "not JSON"),
    ):
        (tiny_model.path / "model.json").write_text(content)
        with pytest.raises(ModelError, match=field):
            load_reader(tiny_model.path)


def test_a_network_that_cannot_be_used_is_refused(tiny_model) -> None:
    import onnx

    path = tiny_model.path / "model.onnx"
    model = onnx.load(path)
    model.graph.initializer[0].raw_data = b"\xff" * len(
        model.graph.initializer[0].raw_data
    )
    onnx.save(model, path)
    rehash_model(tiny_model.path, "model.onnx")

    with pytest.raises(ModelError, match="not finite"):
        load_reader(tiny_model.path).probabilities(slices(1))

    onnx.save(
        model,
        path,
        save_as_external_data=True,
        location="weights.bin",
        size_threshold=0,
    )
    rehash_model(tiny_model.path, "model.onnx")

    with pytest.raises(ModelError, match="asks for data in other files"):
        load_reader(tiny_model.path)

    path.write_bytes(b"not a network")
    rehash_model(tiny_model.path, "model.onnx")
    with pytest.raises(ModelError, match="ONNX Runtime"):
        load_reader(tiny_model.path)


SCAN = Scan(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3)


def test_only_the_training_of_a_model_limits_it(write_model, tmp_path: Path) -> None:
    stiff = Setup(eye=Eye(modulus=Modulus.stated(5e6)))
    thick = Setup(eye=Eye(thickness_m=3e-3))
    classifier = load_classifier(write_model(tmp_path / "model", Study()).path)
    assert (classifier.reads_force, classifier.fixed_modulus_pa) == (
        False,
        Study().eye.youngs_modulus_pa,
    )
    assert (force_reader().reads_force, force_reader().fixed_modulus_pa) == (True, None)
    assert (classifier.refusal(stiff), classifier.refusal(thick)) == (None, None)
    assert force_reader().refusal(Setup()) is None
    assert (
        force_reader()
        .refusal(stiff)
        .startswith("Young's modulus 5 MPa, the model was trained on")
    )

    for reader in (classifier, force_reader()):
        assert reader.limits(Setup(), SCAN) == ()
        (limit,) = reader.limits(thick, SCAN)
        words = "wall thickness 3000 µm, the model was trained on"
        assert limit.words.startswith(words)
        assert (limit.code, limit.fields) == ("outside-training", ("thickness_m",))
        assert reader.limits(Setup(eye=Eye(globe=OPEN)), SCAN) == ()

    # its linear mechanics knows no sealed eye
    (limit,) = classifier.limits(Setup(eye=Eye(globe=SEALED)), SCAN)
    assert "sealed" in limit.words
    assert (limit.code, limit.fields) == ("inputs-ignored", ("globe",))
    assert force_reader().limits(Setup(eye=Eye(globe=SEALED)), SCAN) == ()


@pytest.fixture(params=["classifier", "reader", "raw-reader"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A small model of each kind."""
    if request.param == "classifier":
        return request.getfixturevalue("tiny_model").path

    path = tmp_path / request.param
    if request.param == "reader":
        library = analytic_library(thicknesses=4, ratios=4, tips=5)
        write_fixed_reader(path, library, [1.0] * 8)
    else:
        write_raw_model(path)
    return path


def test_models_are_copied_and_pickled(folder: Path) -> None:
    model = load_reader(folder)
    for other in (
        pickle.loads(pickle.dumps(model)),
        pickle.loads(pickle.dumps(load_reader(folder, finder=None))),
        copy.deepcopy(model),
        copy.copy(model),
    ):
        assert type(other) is type(model)
        assert other is not model
        assert (other.path, other.study) == (model.path, model.study)
        assert (other.record, other.provenance) == (model.record, model.provenance)

    assert pickle.loads(pickle.dumps(model)).finder.origin == model.finder.origin
    assert pickle.loads(pickle.dumps(load_reader(folder, finder=None))).finder is None
    assert len(pickle.dumps(model)) < 2000  # neither network nor library


def test_a_pickled_model_reads_the_same_in_another_process(tiny_model) -> None:
    model = load_reader(tiny_model.path)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        found = pool.submit(model.probabilities, slices(5)).result()
    np.testing.assert_array_equal(found, model.probabilities(slices(5)))


def test_a_pickle_does_not_load_a_changed_or_another_model(
    folder: Path, tmp_path: Path
) -> None:
    pickled = pickle.dumps(load_reader(folder, finder=None))
    record = (folder / "model.json").read_text()
    changes = {
        "card.md": (folder / "card.md").read_text() + "more",
        "model.json": record.replace('"format"', '"more": 1, "format"'),
    }
    assert changes["model.json"] != record

    for name, content in changes.items():
        before = (folder / name).read_text()
        (folder / name).write_text(content)
        with pytest.raises(ModelError, match=f"{name}: (SHA-256|not the model that)"):
            pickle.loads(pickled)
        (folder / name).write_text(before)

    folder.rename(tmp_path / "elsewhere")
    with pytest.raises(ModelError, match=r"no such folder, and a pickled model needs"):
        pickle.loads(pickled)


def test_a_model_that_no_folder_gave_is_not_pickled() -> None:
    with pytest.raises(ModelError, match="not loaded from a folder"):
        pickle.dumps(force_reader())


def test_a_model_is_named_by_its_folder_and_checked_at_each_use(folder: Path) -> None:
    model = opened_reader(folder)
    assert (model.path, model.finder is None) == (folder, False)
    assert opened_reader(model) is model
    assert opened_reader("default") is opened_reader("default")
    (folder / "study.toml").write_text("")
    with pytest.raises(ModelError, match=r"study\.toml: SHA-256"):
        opened_reader(str(folder))
