"""A module, or a name in one, that a page, a docstring or a comment speaks of is there."""

import re
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import scleraforce

ROOT = Path(__file__).parents[1]
PACKAGE = Path(scleraforce.__file__).parent
TEXTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted(PACKAGE.rglob("*.py")),
    *sorted((ROOT / "benchmarks").rglob("*.py")),
]
FOLDERS = (ROOT, PACKAGE, PACKAGE.parent, ROOT / "benchmarks")  # that `room/module.py` may start from
FILE = re.compile(r"(?<![\w./])(\w+(?:/\w+)+\.py)\b")
# `recording.toml` is a file; pages and docstrings have eyes, recordings and data sets as variables, too.
VARIABLES = {"eye", "recording", "dataset"}
ENDINGS = {"toml", "npz", "json", "csv", "zarr", "md", "py", "onnx"}
ROOMS = {path.stem for path in PACKAGE.iterdir() if path.suffix in {"", ".py"} and path.stem[0] != "_"}
DOTTED = re.compile(
    rf"\bscleraforce((?:\.[A-Za-z_]\w*)+)|`((?:{'|'.join(sorted(ROOMS - VARIABLES))})(?:\.[A-Za-z_]\w*)+)"
)


@cache
def is_there(dotted: str) -> bool:
    """Whether a module below `scleraforce`, or a name in one, can be imported."""
    found: object = scleraforce
    for name in dotted.split("."):
        if hasattr(found, "__path__") and find_spec(f"{found.__name__}.{name}"):
            found = import_module(f"{found.__name__}.{name}")
        elif hasattr(found, name):
            found = getattr(found, name)
        else:
            return False
    return True


def names(text: str) -> list[str]:
    found = [(below or "").lstrip(".") or within for below, within in DOTTED.findall(text)]
    return [name for name in found if name.split(".")[-1] not in ENDINGS]


def test_every_module_that_a_text_names_is_there() -> None:
    missing: dict[str, list[str]] = {}
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")
        found = [name for name in FILE.findall(text) if not any((folder / name).is_file() for folder in FOLDERS)]
        found += [name for name in names(text) if not is_there(name)]
        if found:
            missing[str(path.relative_to(ROOT))] = found
    assert not missing, f"named, but not there: {missing}"


def test_a_name_that_is_not_there_would_be_found() -> None:
    assert is_there("reader.model")
    assert is_there("reader.model.LiveReader")
    assert not is_there("imaging.segmentation")
    assert not is_there("reader.life")
    assert names("`reader.life` and scleraforce.gone, `recording.toml`") == ["reader.life", "gone"]
