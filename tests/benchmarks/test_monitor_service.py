"""The benchmarks of the monitor: their arithmetic; and each part for some seconds, on a reader that knows one force."""

import json
import subprocess
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor_service.monitors import Resources
from monitor_service.scanner import Answers, Frames
from monitor_service.soak import Sample, grown
from scleraforce.monitor.limits import MonitorLimits
from scleraforce.openigtlink import Status, Text

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "bench_monitor.py"
PARTS: dict[str, list[str]] = {
    "latency": ["--frames", "60"],
    "soak": ["--frames", "1700", "--rate-hz", "200", "--withdrawal-every", "100"],
    "faults": ["--times", "1", "--deaths", "1", "--only", "silence", "checksum", "garbage", "a tight loop",
               "monitor killed", "second opinion killed"],
    "hostile": ["--connections", "100", "--at-once", "20", "--alone-s", "1"],
}  # fmt: skip


def test_growth_differs_from_a_level() -> None:
    samples = [
        Sample(frames, {"grows": Resources(5000 + frames // 10, 7, 9, 4), "stays": Resources(600, 6, 8, 3)})
        for frames in range(0, 10_000, 100)
    ]
    assert grown(samples, "grows")["rss"] == [pytest.approx(5045), pytest.approx(5945), pytest.approx(100.0)]
    assert grown(samples, "stays")["rss"] == [600, 600, pytest.approx(0.0, abs=1e-9)]
    assert grown(samples, "stays")["descriptors"] == 3
    assert grown(samples, "nobody") == {}


def test_a_heartbeat_is_not_taken_for_the_answer_to_a_frame() -> None:
    answers = Answers()

    def tell(at_s: float, code: int, frame_id: int | None = None) -> None:
        answers.hear(at_s, "ForceMonitor", Status(code, 0, "", ""))
        if frame_id:
            text = json.dumps({"frame_id": frame_id, "latency_ms": 1.5, "cause": None})
            answers.hear(at_s + 1e-4, "ForceReading", Text(text))

    answers.sent(7, 7, 1.000)
    tell(1.001, 1)
    assert answers.last is None
    tell(1.003, 3, frame_id=7)
    assert answers.last is not None
    assert (answers.last.took_s, answers.last.code) == (pytest.approx(3e-3), 3)
    answers.sent(8, 8, 1.010)
    assert answers.last is None
    answers.sent(9, 9, 1.020)
    tell(1.021, 3, frame_id=9)
    tell(1.500, 3, frame_id=8)
    assert [answer.took_s for answer in answers.answers] == pytest.approx([3e-3, 1e-3, 0.49])
    assert answers.withdrawn_s == 1.003


@pytest.mark.slow
def test_the_way_to_and_fro_takes_steps_of_one_frame_and_shows_no_picture_again_soon(folder: Path) -> None:
    frames = Frames(folder / "eye", most=40)
    way = list(islice(frames.to_and_fro(), 200))
    assert set(np.abs(np.diff([place % len(frames.force_n) for place in way]))) == {1}
    remembered = MonitorLimits().shown_frames
    assert all(place not in way[max(now - remembered, 0) : now] for now, place in enumerate(way))
    pictures = {frames.messages[place].stamped(0.0)[-1000:].hex() for place in way}
    assert len(pictures) == len(set(way))


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.usefixtures("alone")
def test_a_part_runs_and_writes_its_figures(folder: Path, tmp_path: Path, part: str) -> None:
    command = [sys.executable, str(BENCHMARK), part, str(folder / "reader"), str(folder / "eye"), *PARTS[part]]
    command += ["--json", str(tmp_path / "figures.json")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))
    CHECKS[part](figures)
    assert not left_behind(str(folder)), "processes were left behind"


def left_behind(folder: str) -> list[str]:
    """Command lines of processes that name the folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            found.append(path.read_text(encoding="utf-8"))
        except OSError:
            continue
    return [line for line in found if folder in line and "bench_monitor" not in line and "pytest" not in line]


def check_latency(figures: dict[str, Any]) -> None:
    for variant in ("without the second opinion", "with the second opinion"):
        result = figures[variant]
        assert result["client"]["n"] + result["unanswered"] == 60
        assert result["client"]["median"] > result["server"]["median"] > 0.0
        assert result["echo"]["n"] == 6


def check_soak(figures: dict[str, Any]) -> None:
    tally = figures["tally"]
    assert sum(tally["injected"].values()) == sum(tally["answered"].values()) + sum(tally["late"].values()) > 0
    assert tally["lost"] == []
    assert tally["unlatched"] == []
    assert {"monitor", "watchdog", "black box", "second opinion"} == set(figures["growth"])


def check_faults(figures: dict[str, Any]) -> None:
    rows = {row["name"]: row for row in figures["rows"]}
    assert len(rows) == 6
    for row in rows.values():
        assert (row["times"], row["missed"]) == (1, []), row
        assert row["delay_ms"]["n"] == 1
    assert list(rows["a tight loop"]["causes"]) == ["WATCHDOG"]


def check_hostile(figures: dict[str, Any]) -> None:
    assert figures["died"] == []
    assert sum(figures["phases"]["under attack"]["ends"].values()) == 100
    assert figures["phases"]["robot alone"]["gap_ms"]["median"] == pytest.approx(50.0, rel=0.5)


CHECKS = {"latency": check_latency, "soak": check_soak, "faults": check_faults, "hostile": check_hostile}
