"""The wheel: the same bytes from the same sources, whole, and enough to read a frame."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from hashlib import sha256
from pathlib import Path
from zipfile import ZipFile

import cv2
import pytest
import yaml
from analytic_frames import image, recording_toml, tip_of, wall_section

ROOT = Path(__file__).parents[1]
SOURCES = ("src", "pyproject.toml", "README.md", "LICENSE")
MIB = 2**20

pytest.importorskip("build")


def built(source: Path, out: Path) -> Path:
    """The wheel of a copy of the sources, whose files are new."""
    source.mkdir()
    before = os.umask(0o022)
    try:
        for name in SOURCES:
            here = ROOT / name
            left_out = shutil.ignore_patterns("__pycache__", "*.egg-info")
            if here.is_dir():
                shutil.copytree(here, source / name, copy_function=shutil.copyfile, ignore=left_out)
            else:
                shutil.copyfile(here, source / name)
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
def test_two_builds_are_the_same_bytes(wheel: Path, tmp_path: Path) -> None:
    again = built(tmp_path / "elsewhere", tmp_path / "dist")
    assert sha256(wheel.read_bytes()).hexdigest() == sha256(again.read_bytes()).hexdigest()


@pytest.mark.slow
def test_it_holds_every_file_of_the_package_and_nothing_else(wheel: Path) -> None:
    package = ROOT / "src" / "scleraforce"
    files = {
        path.relative_to(ROOT / "src").as_posix()
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    held = {name for name in ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert held == files
    assert wheel.stat().st_size < 15 * MIB


@pytest.mark.slow
def test_what_it_holds_reads_a_frame_and_writes_a_study(wheel: Path, tmp_path: Path) -> None:
    ZipFile(wheel).extractall(tmp_path / "site")
    frame = tmp_path / "session" / "frames" / "1.png"
    frame.parent.mkdir(parents=True)
    (frame.parents[1] / "recording.toml").write_text(recording_toml("mine"))
    cv2.imwrite(str(frame), image(wall_section(tip_of(0.020))))
    environment = os.environ | {"PYTHONPATH": str(tmp_path / "site"), "HOME": str(tmp_path)}
    script = (
        "import sys, scleraforce; from scleraforce.cli.main import run; "
        f"assert scleraforce.__file__.startswith({str(tmp_path)!r}); sys.exit(run(sys.argv[1:]))"
    )
    for words in (["classify", "default", str(frame), "--json"], ["init", str(tmp_path / "study"), "--json"]):
        done = subprocess.run(
            [sys.executable, "-c", script, *words], env=environment, cwd=tmp_path, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        told = json.loads(done.stdout)
    assert Path(told["path"]).exists()


def test_the_scripts_of_the_package_can_be_run() -> None:
    for script in (path for path in (ROOT / ".ci").iterdir() if not path.suffix):
        assert os.access(script, os.X_OK), script
        subprocess.run(["bash", "-n", script], check=True)


def test_the_size_of_an_installation_is_that_of_all_its_files(tmp_path: Path) -> None:
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci" / "size", tmp_path / ".ci" / "size")
    megabytes = {
        "big/a.py": 4,
        "big/__pycache__/a.pyc": 1,
        "big.libs/b c.so": 3,
        "big-1.2.dist-info/RECORD": 1,
        "s.py": 2,
    }
    make = [f'install -D /dev/null "$1/site/{name}" && truncate -s {size}MB "$1/site/{name}"'
            for name, size in megabytes.items()]  # fmt: skip
    clean = tmp_path / ".ci" / "clean"
    clean.write_text("#!/bin/bash\n" + "\n".join(make).replace("/site/", "/lib/python3.11/site-packages/"))
    clean.chmod(0o755)
    done = subprocess.run([tmp_path / ".ci" / "size"], capture_output=True, text=True, check=True)
    assert done.stdout == "  11.0 MB in all, of which compiled Python 1.0\n   9.0    big\n"


def test_extras_are_named_in_the_page_on_installation() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    page = (ROOT / "docs" / "installation.md").read_text()
    assert {name for name in extras if f"| `{name}` |" not in page} <= {"dev", "docs"}


def test_the_citation_is_of_this_version_and_licence() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["cff-version"] == "1.2.0"
    assert (citation["version"], citation["license"]) == (project["version"], project["license"])
    assert {"message", "title", "authors"} <= citation.keys()


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "SECURITY.md"])
def test_the_links_of_a_page_lead_somewhere(page: str) -> None:
    links = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", (ROOT / page).read_text(encoding="utf-8"))
    assert links
    assert [link for link in links if "://" not in link and not (ROOT / link).exists()] == []
