"""The paper's classifier that ships with the package was made with today's sources."""

import json
from dataclasses import replace

import pytest

from scleraforce.learning.classifier.sources import classifier_files, classifier_sources_hash
from scleraforce.models.shipped import SHIPPED_PAPER
from scleraforce.reader import load_model
from scleraforce.study import Study


def test_the_shipped_classifier_is_of_todays_sources() -> None:
    """Where it fails, a module that decides slices or weights has changed: `make paper` makes it anew."""
    record = json.loads((SHIPPED_PAPER / "model.json").read_text())
    assert record["provenance"]["sources_sha256"] == classifier_sources_hash(), "run `make paper`"


def test_the_shipped_classifier_is_the_papers_whole_and_small() -> None:
    reader = load_model("paper")
    assert reader.kind == "classifier"
    for section in ("eye", "mesh", "needle", "slice", "classes", "dataset", "network"):
        assert getattr(reader.study, section) == getattr(Study(), section), f"[{section}]: run `make paper`"
    assert reader.record["samples"]["training"] + reader.record["samples"]["validation"] == 19_200
    assert reader.record["metrics"]["validation_accuracy"] > 0.93
    assert sum(file.stat().st_size for file in SHIPPED_PAPER.iterdir()) < 8e6
    assert replace(reader.study, network=Study().network) == replace(Study(), eye=reader.study.eye)


@pytest.mark.parametrize(
    "name", ["mechanics/linear.py", "section/slices.py", "dataset/plan.py", "eye/mesh.py", "study/sampled.py",
             "learning/classifier/training.py", "learning/classifier/half_weights.py"],
)  # fmt: skip
def test_what_decides_a_classifier_counts(name: str) -> None:
    assert name in classifier_files()


def test_what_decides_nothing_does_not_count() -> None:
    assert not {name for name in classifier_files() if name.startswith(("reader/", "cli/", "segmentation/"))}
