"""One protocol for both kinds of model: what differs stands inside them."""

import ast
from pathlib import Path

import pytest
from small_models import force_reader
from sources import syntax_nodes

import scleraforce
from scleraforce.errors import ModelError
from scleraforce.known import OPEN, SEALED, Known, Modulus
from scleraforce.reader import load_classifier, load_force_reader
from scleraforce.recording.folder import OctInfo
from scleraforce.study import Study

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


def test_a_classifier_where_a_reader_is_needed_is_refused(model: Path) -> None:
    with pytest.raises(ModelError, match="found 'classifier', a reader is needed here"):
        load_force_reader(model)


def asks_for_the_kind(node: ast.AST) -> bool:
    """`isinstance(model, ForceReader)`, or a `kind` compared with the name of one."""
    if isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
        return any(getattr(part, "id", None) in KINDS for part in ast.walk(node.args[1]))
    if not isinstance(node, ast.Compare):
        return False
    names = {part.value for part in ast.walk(node) if isinstance(part, ast.Constant)}
    return bool(names & {"classifier", "reader", "raw-reader"}) and ".kind" in ast.unparse(node)


@pytest.mark.parametrize("code", ["isinstance(m, Classifier)", 'm.kind == "reader"', 'm.kind != "classifier"'])
def test_a_question_for_the_kind_is_seen(code: str) -> None:
    assert any(map(asks_for_the_kind, ast.walk(ast.parse(code))))


def test_nobody_outside_the_room_asks_a_model_for_its_kind() -> None:
    for path in ROOT.rglob("*.py"):
        if path.parent != ROOT / "reader":
            asked = [node.lineno for node in syntax_nodes(path) if asks_for_the_kind(node)]
            assert not asked, f"{path}: lines {asked}: ask the reader what is meant (`reads_force`, ...)"
