"""The wheel and the lock, under permissive licences; the gallery's scripts draw the
pictures of its page.
"""

import os
import platform
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from zipfile import ZipFile

import cv2
import numpy as np
import pytest
import rattler_build
import yaml
from analytic_frames import frame_under
from effects import cache_of_its_own, fresh_home
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]


def run(
    *command: object, cwd: Path = ROOT, env: Mapping[str, str] | None = None
) -> str:
    """Return what a command printed."""
    done = subprocess.run(
        list(map(str, command)),
        cwd=cwd,
        env=env,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr

    return done.stdout.strip()


def built(source: Path, out: Path) -> Path:
    """Build the wheel of a copy of the sources, whose files are new."""
    pytest.importorskip("build")
    source.mkdir()
    before = os.umask(0o022)

    try:
        left_out = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(
            ROOT / "src", source / "src", copy_function=shutil.copyfile, ignore=left_out
        )

        for name in ("pyproject.toml", "README.md", "LICENSE"):
            shutil.copyfile(ROOT / name, source / name)

        environment = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
        words = [
            "-m",
            "build",
            "--wheel",
            "--no-isolation",
            "--outdir",
            str(out),
            str(source),
        ]
        subprocess.run(
            [sys.executable, *words], env=environment, check=True, capture_output=True
        )
    finally:
        os.umask(before)

    (wheel,) = out.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    return built(folder / "source", folder / "dist")


@pytest.mark.slow
def test_two_builds_are_the_same_bytes_of_every_file_of_the_package(
    wheel: Path, tmp_path: Path
) -> None:
    assert (
        wheel.read_bytes()
        == built(tmp_path / "elsewhere", tmp_path / "dist").read_bytes()
    )
    package = ROOT / "src" / "scleraforce"
    there = [
        path
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    ]
    files = {path.relative_to(ROOT / "src").as_posix() for path in there}
    held = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert held == files
    assert wheel.stat().st_size < 18 * 2**20


@pytest.mark.slow
def test_two_commands_in_a_clean_environment_answer_a_first_frame(
    wheel: Path, tmp_path: Path
) -> None:
    """The wheel names all packages; they come from PyPI, in the versions of the
    lock.
    """
    clean = tmp_path / "clean" / "bin"
    locked = tmp_path / "constraints"
    locked.write_text(
        re.sub(r"(?m)^setuptools.*\n", "", (ROOT / "requirements.lock").read_text())
    )
    run(sys.executable, "-m", "venv", "--without-pip", clean.parent)
    run(
        sys.executable,
        "-m",
        "pip",
        "-q",
        "--python",
        clean / "python",
        "install",
        "-c",
        locked,
        wheel,
    )
    cv2.imwrite(str(tmp_path / "1.png"), frame_under(0.020))

    for line in ("read default 1.png --width-mm 15 --depth-mm 4", "init study"):
        run(
            clean / "scleraforce", *line.split(), cwd=tmp_path, env=fresh_home(tmp_path)
        )

    assert (tmp_path / "study" / "study.toml").exists()
    assert f"-{run(clean / 'scleraforce', '--version').split()[-1]}-" in wheel.name


def test_the_version_is_that_of_the_last_tag_else_that_of_the_citation(
    tmp_path: Path,
) -> None:
    shutil.copyfile(ROOT / "pyproject.toml", tmp_path / "pyproject.toml")

    def version() -> str:
        return run(sys.executable, "-m", "setuptools_scm", cwd=tmp_path)

    def commit() -> None:
        author = ("-c", "user.name=A", "-c", "user.email=a@b.c")
        run(
            "git",
            *author,
            "commit",
            "-q",
            "--allow-empty",
            "-m",
            "A change",
            cwd=tmp_path,
        )

    stated = yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"]
    assert version() == stated
    run("git", "init", "-q", cwd=tmp_path)
    commit()
    assert version() == stated
    run("git", "tag", "v7.8.9", cwd=tmp_path)
    assert version() == "7.8.9"
    commit()
    assert version() == "7.8.9"


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone of the last commit alone, without tags, in which `.ci/dist` has run."""
    folder = tmp_path_factory.mktemp("clone") / "scleraforce"
    run("git", "clone", "-q", "--no-tags", "--depth=1", ROOT.as_uri(), folder)
    (folder / ".venv").symlink_to(sys.prefix)
    run(folder / ".ci" / "dist")
    return folder


@pytest.mark.slow
def test_the_files_of_a_commit_without_a_tag_name_it(clone: Path) -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    name = f"scleraforce-{citation['version']}+g{run('git', 'rev-parse', '--short=8', 'HEAD', cwd=clone)}"
    assert {path.name for path in (clone / "dist").iterdir()} == {
        f"{name}.tar.gz",
        f"{name}-py3-none-any.whl",
    }


RECIPE = yaml.safe_load((ROOT / "conda" / "recipe.yaml").read_text())
ON_CONDA = {"matplotlib": "matplotlib-base", "opencv-python-headless": "py-opencv"}


def test_the_recipe_for_conda_has_the_dependencies_of_the_project() -> None:
    whole = tomllib.loads((ROOT / "pyproject.toml").read_text())
    wanted = [Requirement(line) for line in whole["project"]["dependencies"]]
    names = [f"{ON_CONDA.get(one.name, one.name)} {one.specifier}" for one in wanted]
    python = f"python {whole['project']['requires-python']}"
    assert sorted(RECIPE["requirements"]["run"]) == sorted([python, *names])
    build = [Requirement(line) for line in whole["build-system"]["requires"]]
    assert RECIPE["requirements"]["host"] == [
        python,
        "pip",
        *(f"{one.name} {one.specifier}" for one in build),
    ]


def make_channel(channel: Path, folder: Path) -> None:
    """Make a channel of empty packages and of a Python that finds this one's:
    conda-forge may be out of reach.
    """
    run(sys.executable, "-m", "venv", "--without-pip", folder / "python")
    (site,) = folder.glob("python/lib/*/site-packages")
    (site / "this.pth").write_text(f"{Path(pytest.__file__).parents[1]}\n")
    (folder / "empty").mkdir()
    (folder / "empty" / "nothing").touch()

    for line in {*RECIPE["requirements"]["host"], *RECIPE["requirements"]["run"]}:
        name, _, bound = line.partition(" >=")
        files = folder / ("python" if name == "python" else "empty")
        version = platform.python_version() if name == "python" else bound or "1"
        rattler_build.assemble_package(
            name, version, "linux-64", "0", channel / "linux-64", files_dir=files
        )


@pytest.mark.slow
def test_the_recipe_for_conda_builds_the_sdist(
    clone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (sdist,) = (clone / "dist").glob("*.tar.gz")
    version = sdist.name.removeprefix("scleraforce-").removesuffix(".tar.gz")
    monkeypatch.setenv("SCLERAFORCE_VERSION", version)
    make_channel(tmp_path / "channel", tmp_path)
    (variant,) = rattler_build.Stage0Recipe.from_file(
        clone / "conda" / "recipe.yaml"
    ).render()
    (built_file,) = variant.run_build(
        output_dir=tmp_path / "channel", channels=[]
    ).packages
    package = rattler_build.Package.from_file(built_file)
    # conda counts in numbers: of a commit's hash, too, it drops zeros that lead one
    counted = re.sub(r"(?<!\d)0+(?=\d)", "", version)
    assert (package.name, package.version) == ("scleraforce", counted)
    assert set(package.depends) == set(RECIPE["requirements"]["run"])
    files = {name.removeprefix("site-packages/scleraforce/") for name in package.files}
    assert {"__init__.py", "shipped/default/model.onnx"} <= files


def test_the_scripts_of_the_package_can_be_run() -> None:
    for script in (path for path in (ROOT / ".ci").iterdir() if not path.suffix):
        assert os.access(script, os.X_OK), script
        subprocess.run(["bash", "-n", script], check=True)


def test_no_locked_package_wants_a_newer_python_than_ours() -> None:
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "requires-python"
    ]
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
    "0BSD",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "HPND",
    "ISC",
    "LLVM-exception",
    "MIT",
    "MIT-CMU",
    "MPL-2.0",
    "PSF-2.0",
    "Python-2.0",
    "Unlicense",
    "Zlib",
}
CLASSIFIERS = {
    "Apache Software License",
    "BSD License",
    "ISC License (ISCL)",
    "MIT License",
    "Mozilla Public License 2.0 (MPL 2.0)",
    "Python Software Foundation License",
    "Historical Permission Notice and Disclaimer (HPND)",
    "The Unlicense (Unlicense)",
}
# The free field of older packages; the LICENSE of APSW ("any-OSI") is zlib's.
IN_WORDS = {
    "Apache 2.0": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "3-Clause BSD License": "BSD-3-Clause",
    "any-OSI": "Zlib",
}
FOR_DEVELOPERS = {"dev", "docs"}
# PyTorch's wheels for a GPU, which nothing of ours uses
NVIDIA = re.compile(r"nvidia-|cuda-|triton$")


def licence_of(found: Distribution) -> str:
    """Return the licence in a package's metadata: an SPDX expression, classifiers, or a
    name in the free field.
    """
    stated = found.metadata
    if expression := stated.get("License-Expression"):
        return expression

    classifiers = [
        line.split(" :: ")[-1]
        for line in stated.get_all("Classifier") or ()
        if line.startswith("License")
    ]
    named = [name for name in classifiers if name != "OSI Approved"]

    return " AND ".join(named) or IN_WORDS.get(
        stated.get("License", ""), stated.get("License", "")
    )


def is_permissive(licence: str) -> bool:
    if all(part in CLASSIFIERS for part in licence.split(" AND ")):
        return True
    words = re.split(r"\s+(?:AND|OR|WITH)\s+|[()]", licence)
    names = [word.strip() for word in words if word.strip()]
    return bool(names) and all(name in PERMISSIVE for name in names)


@cache
def brought_along() -> dict[str, Distribution]:
    """Return installed packages that `pip install 'scleraforce[every extra of users]'`
    needs on this system.
    """
    found: dict[str, Distribution] = {}
    extras = (
        set(distribution("scleraforce").metadata.get_all("Provides-Extra") or ())
        - FOR_DEVELOPERS
    )
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
            if needed.marker and not any(
                needed.marker.evaluate({"extra": extra}) for extra in {"", *wanted}
            ):
                continue

            entry = (canonicalize_name(needed.name), frozenset(needed.extras))
            if entry not in seen and not NVIDIA.match(entry[0]):
                seen.add(entry)
                waiting.append(entry)

    return found


def test_every_package_that_is_brought_along_is_under_a_permissive_licence() -> None:
    assert {
        "scleraforce",
        "numpy",
        "scipy",
        "onnxruntime",
        "protobuf",
        "zarr",
        "numcodecs",
    } <= set(brought_along())
    assert "pytest" not in brought_along()  # a tool for developers
    stated = {name: licence_of(one) for name, one in brought_along().items()}
    others = {
        name: licence[:80]
        for name, licence in stated.items()
        if not is_permissive(licence)
    }
    assert not others, "not in the list; read their LICENSE files"


SCRIPTS = sorted((ROOT / "examples" / "gallery").glob("*.py"))
PICTURES = ROOT / "docs" / "images" / "gallery"
SHRUNK = (80, 50)  # lines of a pixel's width and single speckles may differ
ALIKE = 2.0  # of 255, in the mean


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """A cache for the library of the scripts."""
    return cache_of_its_own(tmp_path_factory.mktemp("cache"))


def shrunk(path: Path) -> np.ndarray:
    return cv2.resize(
        cv2.imread(str(path)), SHRUNK, interpolation=cv2.INTER_AREA
    ).astype(float)


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_draws_the_picture_of_the_page(
    script: Path, tmp_path: Path, cache: dict[str, str]
) -> None:
    environment = os.environ | cache
    picture = tmp_path / "picture.png"
    subprocess.run(
        [sys.executable, script, picture], cwd=tmp_path, env=environment, check=True
    )
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    difference = np.abs(
        shrunk(picture) - shrunk(PICTURES / f"{script.stem}.png")
    ).mean()
    assert difference < ALIKE, (
        f"docs/images/gallery/{script.stem}.png is another picture; `make gallery`"
        " makes it anew"
    )


def test_different_pictures_are_not_alike() -> None:
    pictures = [shrunk(path) for path in sorted(PICTURES.glob("*.png"))]
    assert (
        min(np.abs(a - b).mean() for n, a in enumerate(pictures) for b in pictures[:n])
        > 2 * ALIKE
    )
