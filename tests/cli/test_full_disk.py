"""Results that cannot be written: one line and exit code 2, before the work if that can be known."""

import json
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from analytic_library import solve_analytic

from scleraforce.errors import ModelError
from scleraforce.library import build
from scleraforce.models import check_place

LIBRARY = "[library]\nthicknesses = 4\ntensions = 4\ntips = 6\nelements = 16\n"
DATASET = "[mesh]\ndivisions = 4\n[dataset]\ncontacts = 2\n[[dataset.group]]\nthickness_um = 500.0\nimages = 200\n"
NETWORK = "[network]\nhidden = [200]\nepochs = 1\n"


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Let no file grow beyond `size` bytes, as on a full disk.

    Python writes no bytecode meanwhile: it would leave cut .pyc files of imported modules, and not notice.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.setenv("PYTHONDONTWRITEBYTECODE", "1")
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize(
    ("command", "size"),
    [
        pytest.param("library", 200, id="library-at the start"),
        pytest.param("library", 3000, id="library-at a chunk", marks=pytest.mark.slow),
        pytest.param("generate", 200, id="generate-at the start"),
        pytest.param("generate", 3000, id="generate-at a chunk"),
    ],
)
def test_a_store_on_a_full_disk_is_one_line(tmp_path: Path, shell, monkeypatch, command: str, size: int) -> None:
    monkeypatch.setattr(build, "solve_path", solve_analytic)
    study, out = tmp_path / "study.toml", tmp_path / "out"
    study.write_text(LIBRARY + DATASET)
    with files_up_to(size):
        err = shell.refused(command, "--study", study, "--out", out, "--workers", 1)
    assert str(out) in err
    assert "File too large" in err


@pytest.mark.slow
def test_a_model_on_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, shell) -> None:
    pytest.importorskip("torch")
    (tmp_path / "study.toml").write_text(DATASET + NETWORK)
    shell.run("generate", "--study", tmp_path / "study.toml", "--out", tmp_path / "data", "--workers", 1)
    with files_up_to(100_000):
        assert "File too large" in shell.refused("train", tmp_path / "data", "--out", tmp_path / "model")
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["data", "study.toml"]


def test_a_model_that_cannot_be_written_is_refused_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for place in (tmp_path / "file" / "model", Path("/proc/model")):  # not even root may write there
        with pytest.raises(ModelError, match="cannot be made"):
            check_place(place)
    check_place(tmp_path / "new" / "model")
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_training_on_a_store_of_another_kind_names_the_option(tmp_path: Path, shell) -> None:
    pytest.importorskip("torch")
    library = "a response library and no data set; `train --kind reader` learns from it"
    dataset = "a data set and no response library; `train --kind classifier`"
    for schema, options, said in (
        ("scleraforce-library-2", [], library),
        ("scleraforce-dataset-2", ["--kind", "reader"], dataset),
    ):
        metadata = {"zarr_format": 3, "node_type": "group", "attributes": {"schema": schema}}
        (tmp_path / "zarr.json").write_text(json.dumps(metadata))
        assert said in shell.refused("train", tmp_path, *options, "--out", tmp_path / "model")
