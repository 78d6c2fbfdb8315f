"""`reproduce` from end to end, on a coarse mesh and few slices: every stage, its page,
and Ctrl-C.
"""

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from effects import SCLERAFORCE, cache_of_its_own

COARSE = """
[mesh]
divisions = 8
level = 0
core = 2
rings = 5
[dataset]
contacts = 10
[[dataset.group]]
thickness_um = 600
images = 100
[[dataset.group]]
thickness_um = 800
images = 100
[network]
hidden = [16]
dropout = 0.2
epochs = 3
"""
QUICK_READER = """
[library]
thicknesses = 4
tension = { min = 1e-3, max = 0.21 }
tensions = 4
elements = 24
[reader]
epochs = 1
interval_eyes = 0
samples_per_epoch = 300
validation_samples = 60
channels = [8]
hidden = [16]
"""

STAGES = [
    "phantom",
    "phantom to the bounds",
    "calibrate",
    "generate",
    "train",
    "evaluate",
    "bend",
    "library",
    "calibrate bent",
    "train bent",
    "train reader",
    "read bent",
    "report",
]
BUNDLED_STAGES = [name for name in STAGES if name not in ("library", "train reader")]

pytestmark = pytest.mark.slow


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*SCLERAFORCE, *arguments], capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache of this module's own, which the commands inherit."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in cache_of_its_own(tmp_path_factory.mktemp("cache")).items():
            patch.setenv(name, value)
        yield


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("study") / "study.toml"
    path.write_text(COARSE + QUICK_READER)
    return path


@pytest.fixture(scope="module")
def done(study: Path) -> tuple[Path, dict]:
    """A finished run's folder and what it printed; it trained its reader."""
    return finished(study, "a reader that this run trains", STAGES, "--train")


@pytest.fixture(scope="module")
def bundled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """A finished run's folder and what it printed; it read with the bundled reader."""
    study = tmp_path_factory.mktemp("bundled") / "study.toml"
    study.write_text(COARSE)
    return finished(
        study, "the bundled reader, 'default' (--train trains one)", BUNDLED_STAGES
    )


def finished(
    study: Path, reader: str, stages: list[str], *options: str
) -> tuple[Path, dict]:
    """Run to the end; in a pipe there is one line for each stage."""
    out = study.parent / "out"
    result = run(
        "reproduce", "--out", str(out), "--study", str(study), "--json", *options
    )
    assert result.returncode == 0, result.stderr
    first, *lines = (
        line for line in result.stderr.splitlines() if not line.startswith("compiling")
    )
    assert first == f"reads walls of finite strain with {reader}"
    assert [re.sub(r"[\d.]+ s$", "... s", line) for line in lines] == [
        f"{number}/{len(stages)} {name}: ... s"
        for number, name in enumerate(stages, start=1)
    ]

    return out, json.loads(result.stdout)


def test_the_bundled_reader_reads_by_default_and_the_run_says_so(bundled) -> None:
    out, printed = bundled
    assert list(printed["seconds"]) == [*BUNDLED_STAGES, "total"]
    assert printed["reader"] == {"model": "default", "trained": False}
    assert "It is the bundled reader" in (out / "report.html").read_text(
        encoding="utf-8"
    )
    reader = printed["finite_strain"]["reader"]
    assert [sum(row) for row in reader["confusion"]] == [7, 15, 23]
    assert reader["accuracy"] > 0.8
    assert (out / "model" / "model.onnx").exists()
    assert not (out / "reader").exists()


def test_a_run_that_trains_reads_with_its_own_reader_and_answers_45_trials_of_each_kind(
    done,
) -> None:
    out, printed = done
    assert printed["reader"] == {"model": str(out / "reader"), "trained": True}
    assert "The reader was trained in this run." in (out / "report.html").read_text(
        encoding="utf-8"
    )
    assert list(printed["seconds"]) == [*STAGES, "total"]
    right = sum(printed["confusion"][k][k] for k in range(3))
    assert printed["accuracy"] == pytest.approx(right / 45)
    both = printed["finite_strain"]

    for one in (printed, *both.values()):
        assert [sum(row) for row in one["confusion"]] == [7, 15, 23]
        assert one["scored"] == 45

    # the log puts a few of these into the next class
    near = printed["to_the_bounds"]["confusion"]
    assert sum(map(sum, near)) == printed["to_the_bounds"]["scored"] == 45
    assert [sum(row) for row in near] == pytest.approx([7, 15, 23], abs=3)
    assert both["paper"]["mae_mn"] is None
    assert both["reader"]["mae_mn"] > 0.0
    # The eyes were made with the same coarse mesh; the mean of 0.27, 0.22, 0.24 and
    # 0.29 MPa.
    assert printed["youngs_modulus_mpa"]["mean_mpa"] == pytest.approx(0.255, rel=0.05)


def test_the_page_has_every_table_and_figure_of_the_paper(done) -> None:
    page = (done[0] / "report.html").read_text(encoding="utf-8")
    figures = ("1a", "1b", 2, 3, 4, 5, 6, 7, "8a", "8b", 9, 10)
    wanted = [*(f"Table {n}" for n in "123"), *(f"Fig. {n}" for n in figures)]
    assert [name for name in wanted if name not in page] == []
    assert "The recordings are simulated" in page
    assert "not a medical device" in page.lower()
    shown = len(re.findall(r"<img ", page))
    assert shown == len(re.findall(r'download="[^"]*\.svg"', page)) == 14
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    assert "nan" not in re.sub(r'(?:src|href)="[^"]*"', "", page).lower().split()


def test_a_second_run_reuses_the_finished_stages(done, study: Path) -> None:
    out, first = done
    command = f"reproduce --out {out} --study {study} --json --train"
    again = json.loads(run(*command.split()).stdout)
    reused = [name for name in STAGES if name.startswith(("phantom", "train", "bend"))]
    kept = {name: again["seconds"][name] for name in reused}
    assert kept == {name: first["seconds"][name] for name in reused}
    assert again["confusion"] == first["confusion"]
