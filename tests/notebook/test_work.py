"""What commands and notebooks share is decided once, and counted as whoever asks for it wants."""

import ast
from pathlib import Path

import pytest

import scleraforce
from scleraforce.notebook.work import counting_for, library_for
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
