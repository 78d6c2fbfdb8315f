"""The scripts of the gallery run, and draw what the page shows."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import cache_of_its_own

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted((ROOT / "examples" / "gallery").glob("*.py"))
PAGE = ROOT / "docs" / "gallery.md"
PICTURES = ROOT / "docs" / "images" / "gallery"
SHRUNK = (80, 50)  # lines of a pixel's width and single speckles may differ
ALIKE = 2.0  # of 255, in the mean


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A cache for the library of the scripts."""
    return cache_of_its_own(tmp_path_factory.mktemp("cache"))


def shrunk(path: Path) -> np.ndarray:
    return cv2.resize(cv2.imread(str(path)), SHRUNK, interpolation=cv2.INTER_AREA).astype(float)


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_draws_the_picture_of_the_page(script: Path, tmp_path: Path, cache: dict[str, str]) -> None:
    environment = os.environ | cache
    picture = tmp_path / "picture.png"
    subprocess.run([sys.executable, script, picture], cwd=tmp_path, env=environment, check=True)
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    difference = np.abs(shrunk(picture) - shrunk(PICTURES / f"{script.stem}.png")).mean()
    assert difference < ALIKE, f"docs/images/gallery/{script.stem}.png is another picture; `make gallery` makes it anew"


def test_different_pictures_are_not_alike() -> None:
    pictures = [shrunk(path) for path in sorted(PICTURES.glob("*.png"))]
    assert min(np.abs(a - b).mean() for n, a in enumerate(pictures) for b in pictures[:n]) > 2 * ALIKE


def test_the_page_has_each_script_with_its_own_words_and_picture() -> None:
    page = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert [path.stem for path in sorted(PICTURES.iterdir())] == [script.stem for script in SCRIPTS]
    assert len(SCRIPTS) == 8
    for script in SCRIPTS:
        title, _, words = (ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or "").partition("\n")
        assert f"## {title.rstrip('.')} {' '.join(words.split())}" in page, script.name
        assert f"](images/gallery/{script.stem}.png)" in page
        assert f"](../examples/gallery/{script.name})" in page
