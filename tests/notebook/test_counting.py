"""Work is counted for a progress or a bar; the library that it needs is the bundled one or the cache's."""

from pathlib import Path

import numpy as np

from scleraforce.models import SHIPPED_READER
from scleraforce.notebook import counting_for
from scleraforce.notebook.training import library_for
from scleraforce.reader import load_force_reader
from scleraforce.study import Study


def test_progress_counts_its_own_work_alone() -> None:
    counted: list[int] = []
    for title in ("library", "frames"):
        with counting_for(counted.append, "frames")(title, 3) as advance:
            advance(2)
    assert counted == [2]


def test_linear_mechanics_needs_no_library_and_the_papers_is_the_bundled_readers(tmp_path: Path, monkeypatch) -> None:
    assert library_for(Study(), "linear", counting_for(None, "library")) is None
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    ticks: list[int] = []
    found = library_for(Study(), "finite-strain", counting_for(ticks.append, "library"))
    assert found is not None
    np.testing.assert_array_equal(found.curves_tpdbnc, load_force_reader(SHIPPED_READER).library.curves_tpdbnc)
    assert not ticks
    assert not list(tmp_path.iterdir())
