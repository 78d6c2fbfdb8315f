"""Tests that ask for compiled loops get them, also where a test before has imported the loops as they are."""

from importlib import import_module, reload
from pathlib import Path

import pytest
from machine_code import CHOSEN, compile_chosen, compiled_loops_of

import scleraforce
from scleraforce.compiled import SWITCH, can_compile

ROOT = Path(scleraforce.__file__).parent


def test_every_module_of_loops_that_a_process_may_choose_is_known() -> None:
    """Those of the segmentation, the slices and the contacts' places are compiled wherever Numba is."""
    others = ("segmentation", "section", "eye")
    found = {
        ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
        for path in ROOT.rglob("*.py")
        if "\n@compiled\n" in path.read_text(encoding="utf-8") and path.relative_to(ROOT).parts[0] not in others
    }
    assert found == set(CHOSEN)


def test_loops_that_were_imported_as_they_are_get_compiled_and_stay_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in CHOSEN:
        reload(import_module(name))
        assert not compiled_loops_of(import_module(name))
    monkeypatch.setenv(SWITCH, "1")
    if not can_compile():
        pytest.skip("Numba is not installed")
    compile_chosen()
    compiled = [
        getattr(import_module(name), loops) for name in CHOSEN for loops in compiled_loops_of(import_module(name))
    ]
    assert all(compiled_loops_of(import_module(name)) for name in CHOSEN)
    compile_chosen()
    assert compiled == [
        getattr(import_module(name), loops) for name in CHOSEN for loops in compiled_loops_of(import_module(name))
    ]
