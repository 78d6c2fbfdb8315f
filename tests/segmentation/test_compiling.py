"""The monitor says that it compiles wherever the code of any loops that it calls is missing."""

import re
from pathlib import Path

import pytest

from scleraforce import segmentation
from scleraforce.segmentation import compiling

FOLDER = Path(segmentation.__path__[0])


@pytest.mark.parametrize("missing", [None, *compiling.CALLED])
def test_code_is_kept_only_where_that_of_all_loops_is(missing: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiling, "code_is_kept", lambda module: module.rpartition(".")[2] != missing)
    assert compiling.compiled_is_kept() == (missing is None)


def test_all_loops_that_are_called_from_outside_are_looked_for() -> None:
    outside = "".join(path.read_text(encoding="utf-8") for path in FOLDER.glob("*.py"))
    called = set(re.findall(r"segmentation\.kernels\.(\w+) import", outside))
    loops = {path.stem for path in (FOLDER / "kernels").glob("*.py") if "@compiled" in path.read_text(encoding="utf-8")}
    assert set(compiling.CALLED) == called & loops
