"""Model folders: loaded, checked, refused; the limits of each kind of model."""

import json
from pathlib import Path

import numpy as np
import pytest
from small_models import force_reader

import scleraforce
from scleraforce.errors import ModelError
from scleraforce.known import OPEN, SEALED, Known, Modulus
from scleraforce.models import sha256
from scleraforce.reader import load_classifier, load_model
from scleraforce.recording.folder import OctInfo
from scleraforce.study import Study


def slices(count: int, shape: tuple[int, int] = (8, 10)) -> np.ndarray:
    return np.random.default_rng(1).choice(np.array([0, 255], dtype=np.uint8), size=(count, *shape))


def rehash(model: Path, name: str) -> None:
    """Make `model.json` agree with a changed file, as someone would who means harm or well."""
    record = json.loads((model / "model.json").read_text())
    record["files"][name] = sha256((model / name).read_bytes())
    (model / "model.json").write_text(json.dumps(record))


def test_probabilities_equal_the_network_computed_in_numpy(tiny_model) -> None:
    reader = load_model(tiny_model.path)
    found = reader.probabilities(slices(50))
    np.testing.assert_allclose(found, tiny_model.network.probabilities(slices(50)), atol=1e-6)
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-15)
    assert np.ptp(found, axis=0).max() > 0.1, "a network that answers always the same proves nothing"


def test_the_same_slice_gives_the_same_answer_every_time(tiny_model) -> None:
    first, second = (load_model(tiny_model.path).probabilities(slices(3)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_no_slices_give_no_answers(tiny_model) -> None:
    assert load_model(tiny_model.path).probabilities(slices(0)).shape == (0, 3)


def test_the_study_travels_with_the_model(tiny_model) -> None:
    reader = load_model(tiny_model.path)
    assert reader.study == tiny_model.study
    assert reader.provenance["study_sha256"] == sha256((tiny_model.path / "study.toml").read_bytes())


@pytest.mark.parametrize(
    "wrong",
    [slices(2, (10, 8)), slices(1)[0], slices(1).astype(np.float32), slices(1) // 255, slices(1) ^ 7],
    ids=["turned", "one slice without its axis", "float", "0 and 1", "grey"],
)
def test_anything_but_binary_slices_of_the_studys_shape_is_refused(tiny_model, wrong: np.ndarray) -> None:
    with pytest.raises(ModelError, match="slices"):
        load_model(tiny_model.path).probabilities(wrong)


@pytest.mark.parametrize("name", ["model.onnx", "study.toml", "card.md"])
def test_a_file_changed_by_one_byte_is_refused(tiny_model, name: str) -> None:
    content = bytearray((tiny_model.path / name).read_bytes())
    content[len(content) // 2] ^= 1
    (tiny_model.path / name).write_bytes(content)
    with pytest.raises(ModelError, match=f"{name}: SHA-256"):
        load_model(tiny_model.path)


@pytest.mark.parametrize("name", ["model.onnx", "study.toml", "card.md", "model.json"])
def test_a_missing_file_is_named(tiny_model, name: str) -> None:
    (tiny_model.path / name).unlink()
    with pytest.raises(ModelError, match=name):
        load_model(tiny_model.path)


@pytest.mark.parametrize(
    ("stated", "other", "message"),
    [("bounds_mn = [5.0, 30.0]", "bounds_mn = [5.0, 50.0]", "study_sha256"), ("rows = 8\n", "rows = 9\n", "input")],
    ids=["not trained with it", "for other slices"],
)
def test_another_study_than_the_networks_is_refused_even_where_the_hashes_agree(
    tiny_model, stated: str, other: str, message: str
) -> None:
    study = tiny_model.path / "study.toml"
    study.write_text(study.read_text().replace(stated, other))
    rehash(tiny_model.path, "study.toml")
    with pytest.raises(ModelError, match=message):
        load_model(tiny_model.path)


def test_a_file_that_is_no_network_is_refused(tiny_model) -> None:
    (tiny_model.path / "model.onnx").write_bytes(b"not a network")
    rehash(tiny_model.path, "model.onnx")
    with pytest.raises(ModelError, match="ONNX Runtime"):
        load_model(tiny_model.path)


@pytest.mark.parametrize(
    ("content", "field"),
    [("{", "not JSON"), ("[]", "format"), ('{"format": 99}', "format"), ('{"format": 1, "kind": "oracle"}', "kind"),
     ('{"format": 1, "kind": "classifier"}', "files"), ('{"format": 1, "kind": {}}', "kind"),
     ('{"format": [1]}', "format"), ("[" * 100_000, "nested too deep"), ('{"format": NaN}', "not a number of JSON"),
     ('{"format": ' + "9" * 5000 + "}", "not JSON")],
)  # fmt: skip
def test_a_record_that_cannot_be_used_is_refused(tiny_model, content: str, field: str) -> None:
    (tiny_model.path / "model.json").write_text(content)
    with pytest.raises(ModelError, match=field):
        load_model(tiny_model.path)


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no such folder"):
        load_model(tmp_path / "nothing")


def test_a_network_that_asks_for_other_files_is_refused(tiny_model) -> None:
    import onnx

    path = tiny_model.path / "model.onnx"
    model = onnx.load(path)
    onnx.save(model, path, save_as_external_data=True, location="weights.bin", size_threshold=0)
    rehash(tiny_model.path, "model.onnx")
    with pytest.raises(ModelError, match="asks for data in other files"):
        load_model(tiny_model.path)


def test_a_network_that_answers_no_numbers_is_an_error(tiny_model) -> None:
    import onnx

    path = tiny_model.path / "model.onnx"
    model = onnx.load(path)
    model.graph.initializer[0].raw_data = b"\xff" * len(model.graph.initializer[0].raw_data)
    onnx.save(model, path)
    rehash(tiny_model.path, "model.onnx")
    with pytest.raises(ModelError, match="not finite"):
        load_model(tiny_model.path).probabilities(slices(1))


ROOT = Path(scleraforce.__file__).parent
KINDS = {"Classifier", "ForceReader", "RawReader"}
SCAN = OctInfo(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3)


@pytest.fixture(scope="module")
def model(write_model, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("reader") / "model"
    write_model(path, Study())
    return path


def test_a_classifier_has_a_modulus_of_its_own_and_a_force_reader_takes_each_eyes(model: Path) -> None:
    classifier = load_classifier(model)
    assert (classifier.reads_force, classifier.fixed_modulus_pa) == (False, Study().eye.youngs_modulus_pa)
    assert (force_reader().reads_force, force_reader().fixed_modulus_pa) == (True, None)


def test_only_what_a_model_was_trained_on_limits_it(model: Path) -> None:
    stiff, thick = Known(modulus=Modulus.stated(5e6)), Known(thickness_m=3e-3)
    classifier = load_classifier(model)
    assert (classifier.refusal(stiff), classifier.refusal(thick)) == (None, None)
    assert force_reader().refusal(Known()) is None
    assert force_reader().refusal(stiff).startswith("Young's modulus 5 MPa, the model was trained on")
    for reader in (classifier, force_reader()):
        assert reader.limits(Known(), SCAN) == ()
        (limit,) = reader.limits(thick, SCAN)
        assert limit.startswith("wall thickness 3000 µm, the model was trained on")
        assert reader.limits(Known(globe=OPEN), SCAN) == ()
    (limit,) = classifier.limits(Known(globe=SEALED), SCAN)  # its linear mechanics knows no sealed eye
    assert "sealed" in limit
    assert force_reader().limits(Known(globe=SEALED), SCAN) == ()
