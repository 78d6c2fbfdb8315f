"""The start of a monitor: its checks, its recordings' statements on the eye, the
operator's lines.
"""

import resource
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from small_monitor import FakeCompanion, read
from waiting import FUSE_S

from scleraforce.base.errors import InputError
from scleraforce.live import monitor
from scleraforce.live.companions.companion_processes import OPINION, Companions
from scleraforce.live.companions.process_messages import Alive, SelfReport
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.reading.answer import Answer
from scleraforce.records.eye import Eye
from scleraforce.records.globe import (
    OPEN,
    REFERENCE_RIGIDITY,
    SEALED,
    UNKNOWN,
    Globe,
)
from scleraforce.records.needle import Needle
from scleraforce.records.recording_info import ForceInfo
from scleraforce.records.scan import PixelScale, Plane, Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation

SIZE = {"bits": 16, "width_m": 10e-3, "depth_m": 2e-3}
CALIBRATED = Globe(
    kind="sealed",
    lowest=SEALED.lowest,
    highest=SEALED.highest,
    mean=REFERENCE_RIGIDITY,
    sd=1e6,
    calibrated=True,
)


def test_a_recording_states_the_declared_globe() -> None:
    for globe, stated in (
        (None, None),
        (UNKNOWN, None),
        (OPEN, OPEN),
        (SEALED, SEALED),
        (Globe.declared("sealed", REFERENCE_RIGIDITY, "logarithmic"),) * 2,
        (CALIBRATED, SEALED),  # its rigidity is in the calibration
    ):
        assert Eye("mine", globe=globe).declared().globe == stated


def test_each_plane_is_read_with_the_eye_as_it_sees_it_and_a_single_one_as_declared():
    known = Setup(needle=Needle(gap_m=0.4e-3), scan=Scan(direction_rad=0.2))
    scan = Scan(columns=500, rows=400, **SIZE)
    seen = list[Setup]()

    def read_live(pixels: np.ndarray, scale: PixelScale, setup: Setup) -> Answer:
        seen.append(setup)
        return read(pixels, scale)

    reader = SimpleNamespace(study=Study(), read_live=read_live)
    cross = replace(scan, planes=(Plane("along", 0.0, 0.0), Plane("across", 0.0, 1.5)))

    for taken, eyes in (
        (scan, {"": (0.2, 0.4e-3)}),
        (cross, {"along": (0.2, None), "across": (1.7, None)}),
    ):
        seen.clear()
        assert list(monitor.live_readers(reader, known, taken)) == list(eyes)
        assert list(
            dict.fromkeys((eye.scan.direction_rad, eye.needle.gap_m) for eye in seen)
        ) == list(eyes.values())


def test_a_recording_states_the_declared_places_of_plane_and_needle() -> None:
    known = Setup(
        eye=Eye(globe=OPEN),
        needle=Needle(gap_m=0.4e-3, polar_rad=0.6),
        scan=Scan(direction_rad=1.1),
    )
    scan = Scan(columns=500, rows=400, direction_rad=1.1, **SIZE)
    settings = monitor.MonitorSettings(
        eye="mine",
        setup=known,
        limits=MonitorLimits(),
        scan=scan,
        address=monitor.Address("localhost", 0),
        console=None,
        black_box=Path("box"),
        record=None,
        token="",
    )
    info = monitor._recording_info(settings, Study())
    assert (info.scan, info.needle.polar_rad, info.needle.gap_m) == (
        scan,
        0.6,
        0.4e-3,
    )
    assert info.force == ForceInfo("fz", 1, 0.2)
    relaxing = replace(
        known, eye=replace(known.eye, relaxation=Relaxation.declared([[0.1, 2.0]]))
    )
    # in the calibration
    found = replace(
        known,
        eye=replace(
            known.eye, relaxation=Relaxation.of([0.1], [2.0], np.eye(1), "holds")
        ),
    )
    stated = [
        monitor._recording_info(replace(settings, setup=one), Study()).eye.relaxation
        for one in (known, relaxing, found)
    ]
    assert stated == [None, Relaxation.declared([[0.1, 2.0]]), None]
    unstated = monitor._recording_info(replace(settings, setup=Setup()), Study())
    assert unstated.needle.polar_rad is None
    assert unstated.needle.gap_m == Study().needle.gap_m
    assert unstated.needle.diameter_m == Study().needle.outer_diameter_m


@pytest.mark.parametrize(
    ("lean_rad", "stated"),
    [((0.1, 0.1), ((0.1, 0.1), 0.3)), ((0.1, 0.2), (None, None))],
)
def test_a_recording_states_the_gauge_and_the_lean_that_a_file_can_hold(
    lean_rad: tuple[float, float], stated: tuple[object, object]
) -> None:
    """A file has one lean, and no direction without it."""
    needle = Needle(diameter_m=0.9e-3, lean_rad=lean_rad, lean_azimuth_rad=0.3)
    settings = monitor.MonitorSettings(
        eye="mine",
        setup=Setup(needle=needle),
        limits=MonitorLimits(),
        scan=Scan(columns=500, rows=400, **SIZE),
        address=monitor.Address("localhost", 0),
        console=None,
        black_box=Path("box"),
        record=None,
        token="",
    )
    info = monitor._recording_info(settings, Study())
    assert info.needle.diameter_m == 0.9e-3
    assert (info.needle.lean_rad, info.needle.lean_azimuth_rad) == stated


@pytest.fixture
def opinion() -> Iterator[FakeCompanion]:
    companion = FakeCompanion()
    yield companion
    companion.end()


def test_a_monitor_waits_until_the_second_opinion_is_ready(
    opinion: FakeCompanion, monkeypatch
) -> None:
    monkeypatch.setattr(monitor, "NOTED_S", 0.0)
    companions = Companions({OPINION: opinion})
    notes = list[str]()

    def note(text: str) -> None:  # which comes while it waits
        notes.append(text)
        assert companions.starts(OPINION)
        opinion.says(Alive(faults=()))

    monitor._wait_for_opinion(companions, note)
    assert not companions.starts(OPINION)
    assert notes == [
        "the second opinion gets ready: some seconds, once after an installation half a"
        " minute or more"
    ]


def test_a_monitor_does_not_wait_for_a_second_opinion_that_has_failed(
    opinion: FakeCompanion,
) -> None:
    companions = Companions({OPINION: opinion})
    notes = list[str]()
    opinion.says(SelfReport(detail="no model"))
    opinion.theirs.close()
    monitor._wait_for_opinion(companions, notes.append)
    # a cause at the server's first tick
    assert companions.faults(1.0) == ("second opinion: no model",)
    assert notes == []


def test_a_monitor_serves_without_a_second_opinion_that_is_never_ready_and_says_so(
    opinion: FakeCompanion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(monitor, "READY_S", 0.3)
    companions = Companions({OPINION: opinion})
    notes = list[str]()
    monitor._wait_for_opinion(companions, notes.append)
    assert companions.starts(OPINION)
    assert notes == [
        "the second opinion was not ready within 0.3 s: nothing is OK before its"
        " first one"
    ]


def test_a_host_that_is_not_an_address_of_this_machine_is_refused_in_one_line() -> None:
    for host in (
        "",
        " ",
        "no-such-host.invalid",
        "x" * 64 + ".example",
        "203.0.113.7",
        "a\nb",
    ):
        with pytest.raises(InputError) as refused:
            monitor.listen(host, 0)

        assert str(refused.value).startswith(
            f"`host` {host!r}" if host.strip() else "`host`: empty"
        )
        assert "\n" not in str(refused.value)


def test_a_folder_that_cannot_be_written_or_exists_is_refused_before_anything_is_made(
    tmp_path: Path,
) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    box = tmp_path / "box"
    within = tmp_path / "file" / "inside"
    long = tmp_path / ("x" * 300)

    for black_box, record, words in (
        (within, None, "Not a directory"),
        (long, None, "File name too long"),
        (Path("/proc/box"), None, "/proc/box"),
        (box, tmp_path / "there", "exists already"),
        (box, tmp_path / "link", "exists already"),
        (box, within, "Not a directory"),
        (box, long, "File name too long"),
        (box, Path("/proc/session"), "`record` /proc/session"),
        (box, box, "the folder of the black box is there"),
        (box / "inside", box, "the folder of the black box is there"),
    ):
        with pytest.raises(InputError, match=words) as refused:
            monitor.try_folders(black_box, record)

        assert "\n" not in str(refused.value)

    assert (tmp_path / "file").read_text() == "mine"
    assert not box.exists()
    for _ in range(2):
        monitor.try_folders(box, tmp_path / "session")

    assert sorted(path.name for path in box.rglob("*")) == [
        "decisions-000001.jsonl",
        "log",
    ]


def test_a_low_limit_of_files_is_raised_and_a_hard_one_below_the_need_is_refused(
    monkeypatch,
) -> None:
    found = [(256, 1024)]
    monkeypatch.setattr(resource, "getrlimit", lambda _: found[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, both: found.append(both))
    monitor.allow_files(200)

    with pytest.raises(InputError, match=r"at most 1024 .* needs 1025"):
        monitor.allow_files(1025)

    assert found == [(256, 1024)]
    monitor.allow_files(384)
    assert found[-1] == (384, 1024)


def test_a_terminal_that_is_stopped_keeps_nobody_waiting_and_fills_no_memory() -> None:
    go_on = Event()
    lines = list[str]()

    def write(text: str) -> None:
        go_on.wait(FUSE_S)
        lines.append(text)

    notes = monitor.OperatorNotes(write)
    for number in range(3 * monitor.WAITING_LINES):
        notes(str(number))

    notes.close(within_s=0.01)
    assert not lines
    go_on.set()
    notes.close(FUSE_S)
    assert monitor.WAITING_LINES <= len(lines) <= monitor.WAITING_LINES + 1
    assert lines == [str(number) for number in range(len(lines))]  # in their order
