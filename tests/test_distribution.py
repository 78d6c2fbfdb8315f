"""The wheel and the lock, under permissive licences; the gallery's scripts draw the pictures of its page."""

import ast
import os
import re
import shutil
import subprocess
import sys
import tomllib
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from zipfile import ZipFile

import cv2
import numpy as np
import pytest
import yaml
from analytic_frames import image, tip_of, wall_section
from effects import cache_of_its_own, fresh_home
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]


def built(source: Path, out: Path) -> Path:
    """Build the wheel of a copy of the sources, whose files are new."""
    pytest.importorskip("build")
    source.mkdir()
    before = os.umask(0o022)
    try:
        left_out = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / "src", source / "src", copy_function=shutil.copyfile, ignore=left_out)
        for name in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copyfile(ROOT / name, source / name)
        environment = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
        words = ["-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(source)]
        subprocess.run([sys.executable, *words], env=environment, check=True, capture_output=True)
    finally:
        os.umask(before)
    (wheel,) = out.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    return built(folder / "source", folder / "dist")


@pytest.mark.slow
def test_two_builds_are_the_same_bytes_of_every_file_of_the_package(wheel: Path, tmp_path: Path) -> None:
    assert wheel.read_bytes() == built(tmp_path / "elsewhere", tmp_path / "dist").read_bytes()
    package = ROOT / "src" / "scleraforce"
    there = [path for path in package.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    files = {path.relative_to(ROOT / "src").as_posix() for path in there}
    held = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert held == files
    assert wheel.stat().st_size < 17 * 2**20


@pytest.mark.slow
def test_an_unpacked_wheel_reads_a_frame_and_writes_a_study(wheel: Path, tmp_path: Path) -> None:
    ZipFile(wheel).extractall(tmp_path / "site")
    cv2.imwrite(str(tmp_path / "1.png"), image(wall_section(tip_of(0.020))))
    environment = fresh_home(tmp_path) | {"PYTHONPATH": str(tmp_path / "site")}
    script = ("import sys, scleraforce; from scleraforce.cli.main import run; assert "
              f"scleraforce.__file__.startswith({str(tmp_path)!r}); sys.exit(run(sys.argv[1:]))")  # fmt: skip
    for line in ("read default 1.png --width-mm 15 --depth-mm 4", "init study"):
        subprocess.run([sys.executable, "-c", script, *line.split()], env=environment, cwd=tmp_path, check=True)
    assert (tmp_path / "study" / "study.toml").exists()


def test_the_scripts_of_the_package_can_be_run() -> None:
    for script in (path for path in (ROOT / ".ci").iterdir() if not path.suffix):
        assert os.access(script, os.X_OK), script
        subprocess.run(["bash", "-n", script], check=True)


def test_the_page_on_installation_names_the_extras_and_the_citation_this_version() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    page = (ROOT / "docs" / "installation.md").read_text()
    assert {name for name in project["optional-dependencies"] if f"| `{name}` |" not in page} <= {"dev", "docs"}
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    assert {"message", "title", "authors"} <= citation.keys()


def test_no_locked_package_wants_a_newer_python_than_ours() -> None:
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    oldest = wanted.removeprefix(">=") + ".0"
    judged = []
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        name, _, version = line.partition("==")
        try:
            found = distribution(name) if version else None
        except PackageNotFoundError:  # an extra that is not installed here
            continue
        if found is not None and found.version.partition("+")[0] == version:
            judged.append((name, found.metadata.get("Requires-Python") or ""))
    assert len(judged) > 50
    assert [one for one in judged if not SpecifierSet(one[1]).contains(oldest)] == []


PERMISSIVE = {
    "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "HPND", "ISC", "LLVM-exception", "MIT",
    "MIT-CMU", "MPL-2.0", "PSF-2.0", "Python-2.0", "Unlicense", "Zlib",
}  # fmt: skip
CLASSIFIERS = {
    "Apache Software License", "BSD License", "ISC License (ISCL)", "MIT License",
    "Mozilla Public License 2.0 (MPL 2.0)", "Python Software Foundation License",
    "Historical Permission Notice and Disclaimer (HPND)", "The Unlicense (Unlicense)",
}  # fmt: skip
# The free field of older packages; the LICENSE of APSW ("any-OSI") is zlib's.
IN_WORDS = {"Apache 2.0": "Apache-2.0", "BSD": "BSD-3-Clause", "3-Clause BSD License": "BSD-3-Clause",
            "any-OSI": "Zlib"}  # fmt: skip
FOR_DEVELOPERS = {"dev", "docs"}
NVIDIA = re.compile(r"nvidia-|cuda-|triton$")  # PyTorch's wheels for a GPU, which nothing of ours uses


def licence_of(found: Distribution) -> str:
    """Return the licence in a package's metadata: an SPDX expression, classifiers, or a name in the free field."""
    stated = found.metadata
    if expression := stated.get("License-Expression"):
        return expression
    classifiers = [line.split(" :: ")[-1] for line in stated.get_all("Classifier") or () if line.startswith("License")]
    named = [name for name in classifiers if name != "OSI Approved"]
    return " AND ".join(named) or IN_WORDS.get(stated.get("License", ""), stated.get("License", ""))


def is_permissive(licence: str) -> bool:
    if all(part in CLASSIFIERS for part in licence.split(" AND ")):
        return True
    words = re.split(r"\s+(?:AND|OR|WITH)\s+|[()]", licence)
    names = [word.strip() for word in words if word.strip()]
    return bool(names) and all(name in PERMISSIVE for name in names)


@cache
def brought_along() -> dict[str, Distribution]:
    """Return installed packages that `pip install 'scleraforce[every extra of users]'` needs on this system."""
    found: dict[str, Distribution] = {}
    extras = set(distribution("scleraforce").metadata.get_all("Provides-Extra") or ()) - FOR_DEVELOPERS
    waiting = [("scleraforce", frozenset(extras))]
    seen = set(waiting)
    while waiting:
        name, wanted = waiting.pop()
        try:
            one = distribution(name)
        except PackageNotFoundError:
            continue
        found[canonicalize_name(name)] = one
        for line in one.requires or ():
            needed = Requirement(line)
            if needed.marker and not any(needed.marker.evaluate({"extra": extra}) for extra in {"", *wanted}):
                continue
            entry = (canonicalize_name(needed.name), frozenset(needed.extras))
            if entry not in seen and not NVIDIA.match(entry[0]):
                seen.add(entry)
                waiting.append(entry)
    return found


def test_every_package_that_is_brought_along_is_under_a_permissive_licence() -> None:
    assert {"scleraforce", "numpy", "scipy", "onnxruntime", "protobuf", "zarr", "numcodecs"} <= set(brought_along())
    assert "pytest" not in brought_along()  # a tool for developers
    stated = {name: licence_of(one) for name, one in brought_along().items()}
    others = {name: licence[:80] for name, licence in stated.items() if not is_permissive(licence)}
    assert not others, "not in the list; read their LICENSE files"


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
    assert len(SCRIPTS) == 10
    for script in SCRIPTS:
        title, _, words = (ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or "").partition("\n")
        assert f"## {title.rstrip('.')} {' '.join(words.split())}" in page, script.name
        assert f"](images/gallery/{script.stem}.png)" in page
        assert f"](../examples/gallery/{script.name})" in page
