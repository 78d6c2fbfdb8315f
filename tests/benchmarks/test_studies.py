"""Each study of the figures runs at its smallest size and prints finite numbers; the
statistics that studies share are as computed by hand.
"""

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import click
import numpy as np
import pytest
from small_models import write_blind_finder

from figures.__main__ import Studies, main
from figures.accuracy import found_moduli, joined, read_forces, rms
from figures.boundary_statistics import CLEAR_M, SIDE_COLUMNS, boundary_statistics
from scleraforce.records.study import SliceStudy

SMALLEST = {
    "at-rest": "--readings 1",
    "boundary-errors": "--eyes 1 --frames 3 --study {study}",
    "calibration": "--linear 1 --bent 1 --frames 5 --study {study}",
    "conjunctiva": "--frames 1",
    "forms": "--rows 1",
    "intervals": "--eyes 6 --workers 1",
    "layers": "--rows 1 --rings 6",
    "library": "--walls 1 --study {study}",
    "meshes": "--rows 1 --forces 1 --quads 4 --core 2 --rings 4",
    "missing-inputs": "--eyes 1",
    "missing-inputs --sealed": "--eyes 1",
    "places": "--groups plain --eyes 1 --frames 2 --needles",
    "planes": "--eyes 1",
    "posterior": "--eyes 2 --groups plain --out {folder}",
    "real-tissue": "--rows 1",
    "real-tissue picture": "--out {picture}",
    "revolution": "--rows 1",
    "wall-finder": "{finder} --scenes 3 --phantoms 2",
    "without-force": "--eyes 1 --out {folder}",
}
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?")


def test_every_study_has_a_smallest_size() -> None:
    studies = Studies().list_commands(click.Context(main))
    assert sorted({name.split()[0] for name in SMALLEST}) == studies


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALLEST)
def test_a_study_prints_a_table_of_finite_numbers(
    name: str,
    request: pytest.FixtureRequest,
    environment: dict[str, str],
    tmp_path: Path,
) -> None:
    picture = tmp_path / "picture.png"
    places = {"folder": tmp_path / "eyes", "picture": picture}
    if "{study}" in SMALLEST[name]:
        places["study"] = request.getfixturevalue("study_file")
    if "{finder}" in SMALLEST[name]:
        places["finder"] = tmp_path / "finder"
        write_blind_finder(places["finder"])

    words = [*name.split(), *SMALLEST[name].format_map(places).split()]
    folder = str(Path(__file__).parents[2] / "benchmarks")
    done = subprocess.run(
        [sys.executable, "-m", "figures", *words],
        capture_output=True,
        text=True,
        check=False,
        env=environment | {"PYTHONPATH": folder},
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    # each process says so in an empty cache
    assert set(done.stderr.splitlines()) <= {"compiling, once: half a minute"}
    assert not re.search(r"\b(nan|inf)\b", done.stdout, re.IGNORECASE), done.stdout
    if "{picture}" in SMALLEST[name]:
        assert picture.stat().st_size > 10_000
        return
    rows = [line for line in done.stdout.splitlines() if NUMBER.search(line)]
    assert any(len(NUMBER.findall(row)) >= 2 for row in rows), done.stdout


def answer(force_n, interval_n):
    return SimpleNamespace(force_n=force_n, interval_n=interval_n)


def test_read_forces_leave_out_frames_without_a_force() -> None:
    read = read_forces(
        [
            (answer(0.011, (0.009, 0.012)), 0.010),
            (answer(None, None), 0.020),
            (answer(0.028, (0.027, 0.029)), 0.030),
        ]
    )
    assert read.errors_n == pytest.approx([0.001, -0.002])
    assert read.widths_n == pytest.approx([0.003, 0.002])
    assert read.holds.tolist() == [True, False]
    assert joined([read, read]).holds.tolist() == [True, False, True, False]
    assert len(read_forces([(answer(None, None), 0.02)]).holds) == 0


def test_a_modulus_is_compared_with_twice_its_standard_deviation() -> None:
    found = found_moduli([(0.03, 0.02), (-0.05, 0.02)])
    assert found.within_two_sd == "1 of 2"
    assert rms(found.errors) == pytest.approx(np.sqrt((0.03**2 + 0.05**2) / 2))


def test_boundary_statistics_are_those_of_the_errors_put_in() -> None:
    """Dented walls whose surface is seen 2 um too deep with noise of 3 um, and whose
    thickness each frame sees 1 % too large or too small.
    """
    study = SliceStudy()
    rng = np.random.default_rng(0)
    lateral_m = (np.arange(study.columns) - study.columns / 2) * study.pixel_m
    depth_m = lateral_m**2 / 24e-3 + 1e-3 * np.exp(-((lateral_m / 2e-3) ** 2))
    outer = np.tile(0.2e-3 + depth_m, (40, 1))
    true = np.stack([outer, outer + 0.6e-3], axis=1)
    thickness_m = 0.6e-3 * (1.0 + 0.01 * np.resize([1.0, -1.0], 40))
    seen_outer = outer + 2e-6 + 3e-6 * rng.standard_normal(outer.shape)
    seen = np.stack([seen_outer, seen_outer + thickness_m[:, None]], axis=1)
    seen[:, :, study.columns // 2] = np.nan
    found = boundary_statistics(true, seen, study)

    inside = outer[0, SIDE_COLUMNS:-SIDE_COLUMNS]
    clear = inside < study.rows * study.pixel_m - CLEAR_M
    assert found.outer_bias_m == pytest.approx(2e-6, abs=0.3e-6)
    assert found.outer_sd_m == pytest.approx(3e-6, rel=0.1)
    assert found.outer_correlation == pytest.approx((4 / 13, 4 / 13), abs=0.05)
    assert found.thickness_scale_sd == pytest.approx(0.02 / 1.349, rel=0.01)
    assert found.thickness_sd_m < 1e-9
    assert found.lost_share == pytest.approx(1 / clear.sum())
    assert found.layer_share == 0.0
