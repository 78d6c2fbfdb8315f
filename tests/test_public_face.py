"""The public API: all of it is documented, nothing is imported before it is used, and paths may be strings."""

import ast
import inspect
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from analytic_library import analytic_library

import scleraforce
from scleraforce.errors import InputError, StudyError
from scleraforce.known.calibration_file import open_calibration, read_calibration
from scleraforce.learning.dataset import open_dataset
from scleraforce.library.files import load_library
from scleraforce.library.store import open_library
from scleraforce.reader import load_classifier, load_force_reader, load_model
from scleraforce.recording.folder import read_recording
from scleraforce.recording.images import read_frame
from scleraforce.study import parse_study, read_study

ROOT = Path(scleraforce.__file__).parent
PAGE = Path(__file__).parents[1] / "docs" / "python.md"
PUBLIC = [name for name in scleraforce.__all__ if not name.startswith("__")]
HEAVY = ["torch", "scipy", "cv2", "onnxruntime", "numpy", "pydicom", "zarr", "matplotlib", "click", "tqdm",
         "scipy.linalg", "scipy.ndimage", "scipy.special"]  # fmt: skip


def loaded_after(code: str) -> set[str]:
    """Return the heavy packages and our own modules that a fresh interpreter has imported after running some code."""
    show = f"import sys; print(*[m for m in sys.modules if m in {HEAVY!r} or m.startswith('scleraforce')])"
    return set(
        subprocess.run(
            [sys.executable, "-c", f"{code}\n{show}"], capture_output=True, text=True, check=True
        ).stdout.split()
    )


def test_each_name_loads_only_its_own_imports() -> None:
    assert loaded_after("import scleraforce as sf; dir(sf)") == {"scleraforce"}
    loaded = loaded_after("import scleraforce as sf; sf.Study; sf.InputError; sf.__version__")
    assert "scleraforce.study" in loaded
    assert not loaded & {"torch", "scipy", "cv2", "onnxruntime", "zarr", "matplotlib"}
    loaded = loaded_after("import scleraforce as sf; sf.segment; sf.load_model; sf.read; sf.read_recording")
    assert {"cv2", "onnxruntime"} <= loaded
    assert not loaded & {"torch", "zarr", "matplotlib", "click", "tqdm"}
    loaded = loaded_after("import scleraforce as sf; sf.calibrate")
    assert not loaded & {*HEAVY} - {"scipy", "cv2", "onnxruntime", "numpy"}  # Numba imports SciPy's name


@pytest.mark.slow
def test_nothing_public_loads_pytorch_before_it_trains() -> None:
    assert "torch" not in loaded_after("import scleraforce as sf\nfor name in dir(sf): getattr(sf, name)")


def test_the_page_type_checkers_python_and_dir_have_the_same_names() -> None:
    rows = re.findall(r"^\| `sf\.(\w+)", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(rows) == sorted(PUBLIC)
    assert dir(scleraforce) == sorted(scleraforce.__all__)
    tree = ast.parse((ROOT / "__init__.py").read_text(encoding="utf-8"))
    typed = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("scleraforce.")
        for alias in node.names
    }
    assert sorted(typed) == sorted(PUBLIC)
    for name, module in typed.items():
        assert getattr(scleraforce, name) is getattr(import_module(module), name)
    assert (ROOT / "py.typed").exists()
    packages = {path.stem for path in ROOT.iterdir()}
    assert not packages & set(PUBLIC), "an import of the package would replace the function"


def test_an_unknown_name_is_an_attribute_error_that_says_where_to_look() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'fish'; docs/python\.md"):
        scleraforce.fish  # noqa: B018
    with pytest.raises(ImportError):
        from scleraforce import fish  # noqa: F401


def test_every_public_name_has_an_example_and_takes_numbers_by_name() -> None:
    for name in PUBLIC:
        function = getattr(scleraforce, name)
        text = inspect.getdoc(function) or ""
        assert ">>> import scleraforce as sf" in text, name
        assert f"sf.{name}" in text, name
        for argument in inspect.signature(function).parameters.values() if inspect.isfunction(function) else ():
            assert argument.annotation is not inspect.Parameter.empty, f"{name}: {argument.name}"
            by_name = argument.kind is inspect.Parameter.KEYWORD_ONLY
            assert by_name or "float" not in str(argument.annotation), f"{name}: {argument.name}"


def test_a_key_that_a_call_does_not_use_is_refused_by_name(tmp_path: Path) -> None:
    """The commands call the other functions (tests/cli/test_unused_keys.py)."""
    sealed, straps = (parse_study(f'[{name}]\nkind = "{kind}"') for name, kind in (("globe", "sealed"),
                      ("supports", "straps")))  # fmt: skip
    for call in (
        lambda: scleraforce.library_of(straps),
        lambda: scleraforce.train(analytic_library(), tmp_path / "out", straps),
        lambda: scleraforce.generate(tmp_path / "out", sealed, mechanics="linear"),
    ):
        with pytest.raises(StudyError, match=r"(globe|supports)\.kind: not used by `"):
            call()
    with pytest.raises(InputError, match="search"):
        scleraforce.train(analytic_library(), tmp_path / "out", search=True)
    assert not list(tmp_path.iterdir())


READERS = (
    load_classifier, load_force_reader, load_library, load_model, open_calibration, open_dataset, open_library,
    read_calibration, read_frame, read_recording, read_study,
)  # fmt: skip


def test_a_path_that_is_a_string_and_does_not_exist_is_one_clear_line(tmp_path: Path) -> None:
    missing = str(tmp_path / "nothing")
    for read in READERS:
        faults = []
        for path in (missing, Path(missing)):
            with pytest.raises(InputError, match="nothing") as fault:
                read(path)  # type: ignore[operator]  # of various types
            faults.append(str(fault.value))
        assert faults[0] == faults[1], read
        assert "\n" not in faults[0], read
