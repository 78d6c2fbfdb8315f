"""What commands and notebooks share is decided once, and counted as whoever asks for it wants."""

import ast
from pathlib import Path

import numpy as np
import pytest

import scleraforce
from scleraforce.models.folder import SHIPPED_READER
from scleraforce.notebook.work import counting_for, library_for
from scleraforce.reader import load_force_reader
from scleraforce.study import Study

ROOT = Path(scleraforce.__file__).parent
DECIDED_ONCE = {"calibrate_recordings", "generate_dataset", "train_reader", "train_classifier"}


@pytest.mark.parametrize("path", sorted([*ROOT.glob("cli/*.py"), *ROOT.glob("notebook/*.py")]), ids=lambda p: p.stem)
def test_commands_and_notebooks_leave_it_to_the_shared_work(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    taken = {alias.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert taken & DECIDED_ONCE == (DECIDED_ONCE if path == ROOT / "notebook/work.py" else set())


def test_progress_is_told_of_its_own_work_alone() -> None:
    told: list[int] = []
    for title in ("library", "frames"):
        with counting_for("frames", told.append)(title, 3) as advance:
            advance(2)
    assert told == [2]


def test_linear_mechanics_needs_no_library() -> None:
    assert library_for(Study(), "linear", counting_for("library", None)) is None


def test_the_papers_library_is_that_of_the_shipped_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ticks: list[int] = []
    found = library_for(Study(), "finite-strain", counting_for("library", ticks.append))
    assert found is not None
    np.testing.assert_array_equal(found.curves_tpdbnc, load_force_reader(SHIPPED_READER).library.curves_tpdbnc)
    assert not ticks
    assert not list(tmp_path.iterdir())
