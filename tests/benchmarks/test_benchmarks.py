"""Every benchmark of the folder runs, at its smallest size, and prints figures that are
numbers.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
FOUND = sorted(path.stem for path in FOLDER.glob("bench_*.py"))

# What each is given; a part of the monitor's benchmark is its second word.
SMALLEST = {
    "bench_console": "changes --changes 2",
    "bench_monitor latency": "{model} {recording} --frames 60",
    "bench_monitor soak": (
        "{model} {recording} --frames 1700 --rate-hz 200 --withdrawal-every 100"
    ),
    "bench_monitor faults": (
        "{model} {recording} --times 1 --deaths 1 --only silence checksum garbage"
    ),
    "bench_monitor hostile": (
        "{model} {recording} --connections 100 --at-once 20 --alone-s 1"
    ),
    "bench_monitor_sessions": (
        "--model {model} --kinds sealed living --eyes 1 --seconds 1 --rates-mn-s 100"
    ),
    "bench_old_pictures": "{recording} --frames 20",
    "bench_openigtlink": "--messages 1000",
    "bench_pierced": "--sessions 2",
    "bench_relaxing_ramps": "--eyes 1",
    "bench_scale": "--images 20 40 1000000 --processes 1 --seconds 100 --study {study}",
    "bench_time_to_bound": "{model} --eyes 1 --rates-mn-s 100",
}
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?")


def test_every_benchmark_has_a_smallest_size() -> None:
    assert sorted({name.split()[0] for name in SMALLEST}) == FOUND


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALLEST)
def test_a_benchmark_prints_a_table_of_finite_numbers(
    name: str,
    request: pytest.FixtureRequest,
    environment: dict[str, str],
    tmp_path: Path,
) -> None:
    file, *part = name.split()
    if part:  # it runs in real time
        request.getfixturevalue("alone")

    words = [
        *part,
        *(word.format_map(Given(request, tmp_path)) for word in SMALLEST[name].split()),
    ]
    done = ran(file, words, environment)
    assert done.returncode == 0, done.stderr
    rows = [line for line in done.stdout.splitlines() if len(NUMBER.findall(line)) >= 2]
    assert rows, f"no table in:\n{done.stdout}"
    assert not re.search(r"\b(nan|inf)\b", done.stdout, re.IGNORECASE), done.stdout
    assert done.stderr in ("", "compiling, once: half a minute\n")  # in an empty cache


def ran(
    name: str, words: list[str], environment: dict[str, str]
) -> subprocess.CompletedProcess[str]:
    """Run a benchmark to its end."""
    command = [sys.executable, str(FOLDER / f"{name}.py"), *words]
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        timeout=600,
    )


class Given(dict[str, Path]):
    """Values of the words in braces, made lazily."""

    def __init__(self, request: pytest.FixtureRequest, folder: Path) -> None:
        self._request = request
        self._folder = folder

    def __missing__(self, key: str) -> Path:
        fixture = self._request.getfixturevalue
        if key in ("model", "recording"):
            return fixture("folder") / {"model": "reader", "recording": "eye"}[key]

        return (
            self._folder / "picture.png"
            if key == "out"
            else fixture({"study": "study_file"}.get(key, key))
        )
