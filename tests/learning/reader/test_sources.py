"""The reader that ships with the package was trained with today's sources."""

import json
import sys
from pathlib import Path

import pytest

from scleraforce.learning.reader import sources
from scleraforce.learning.reader.intervals import _measuring
from scleraforce.learning.reader.sources import SHARED, reader_files, reader_sources_hash
from scleraforce.library.files import load_library
from scleraforce.models.shipped import SHIPPED_READER
from scleraforce.reader import load_force_reader
from scleraforce.source_hash import PACKAGE
from scleraforce.study import Study

# Records of the study, conversions and the session of the network: what they hold is hashed beside the weights.
HELD = ("study/", "units.py", "models/session.py", "reader/model.py")


def test_the_shipped_reader_is_of_todays_sources() -> None:
    """Where it fails, a module that decides the reader has changed: `make model` trains it anew."""
    record = json.loads((SHIPPED_READER / "model.json").read_text())
    assert record["provenance"].get("sources_sha256") == reader_sources_hash(), "run `make model`"


def test_the_shipped_reader_is_of_the_default_study_whole_and_small() -> None:
    reader = load_force_reader(SHIPPED_READER)
    for section in ("eye", "needle", "slice", "classes", "calibration", "library", "reader"):
        assert getattr(reader.study, section) == getattr(Study(), section), f"[{section}]: run `make model`"
    assert reader.record["intervals"]["eyes"] >= 200, "trained without its intervals"
    assert sum(file.stat().st_size for file in SHIPPED_READER.iterdir()) < 9.5e6


@pytest.mark.slow
def test_what_an_eye_of_the_training_runs_is_among_the_files_that_count() -> None:
    library = load_library(SHIPPED_READER / "library.npz", (SHIPPED_READER / "library.npz").read_bytes())
    scores_of = _measuring(Study(), library, (SHIPPED_READER / "model.onnx").read_bytes())
    called: set[str] = set()
    sys.setprofile(lambda frame, event, _: called.add(frame.f_code.co_filename) if event == "call" else None)
    try:
        scores = scores_of(0)
    finally:
        sys.setprofile(None)
    assert scores
    ours = {Path(name).relative_to(PACKAGE).as_posix() for name in called if name.startswith(str(PACKAGE))}
    shared = {Path(sys.modules[function.__module__].__file__).relative_to(PACKAGE).as_posix() for function in SHARED}
    assert len(ours & set(reader_files())) > 20
    assert not {name for name in ours - set(reader_files()) - shared if not name.startswith(HELD)}


def test_the_hash_changes_with_a_room_that_computes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "scleraforce"
    for name in ("fitting/one.py", "cli/two.py"):
        (package / name).parent.mkdir(parents=True)
        (package / name).write_text("VALUE = 1\n")
    monkeypatch.setattr("scleraforce.source_hash.PACKAGE", package)
    monkeypatch.setattr(sources, "PACKAGE", package)
    monkeypatch.setattr(sources, "STEPS", ("scleraforce.fitting.one", "scleraforce.cli.two"))
    before = reader_sources_hash()
    (package / "cli" / "two.py").write_text("VALUE = 2\n")
    assert reader_sources_hash() == before
    (package / "fitting" / "one.py").write_text("VALUE = 2\n")
    assert reader_sources_hash() != before


@pytest.mark.parametrize(
    "name", ["library/base_plane.py", "mechanics/axisymmetric/path.py", "fitting/library_fit.py", "reader/given.py",
             "reader/interval_traits.py", "learning/reader/network.py", "calibration/session.py", "study/sampled.py"],
)  # fmt: skip
def test_what_decides_a_reader_counts(name: str) -> None:
    assert name in reader_files()
