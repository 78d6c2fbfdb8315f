"""The start of a monitor: its checks, its recordings' statements on the eye, the
operator's lines.
"""

import resource
from collections.abc import Iterator
from dataclasses import replace
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from small_monitor import FakeCompanion, NoGuard, read, run_small, serving
from waiting import FUSE_S

from scleraforce.base.errors import InputError
from scleraforce.live import monitor
from scleraforce.live.companions.companion_processes import OPINION, Companions
from scleraforce.live.companions.process_messages import Alive, SelfReport
from scleraforce.live.monitor_request import Address
from scleraforce.records.eye import Eye
from scleraforce.records.globe import (
    OPEN,
)
from scleraforce.records.needle import Needle
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.scan import Plane, Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation

WAITING_LINES = 1000
SIZE = {"bits": 16, "width_m": 10e-3, "depth_m": 2e-3}


def test_each_plane_is_read_with_the_eye_as_it_sees_it_and_a_single_one_as_declared():
    known = Setup(needle=Needle(gap_m=0.4e-3), scan=Scan(direction_rad=0.2))
    scan = Scan(columns=500, rows=400, **SIZE)
    seen = []

    def read_live(pixels, scale, setup):
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


def recording_info(setup: Setup, **of_scan: Any) -> RecordingInfo:
    """Return what recordings of a monitor of an eye state."""
    asked = list[Any]()
    scan = Scan(columns=500, rows=400, **SIZE, **of_scan)
    child = lambda _, settings, __: asked.append(settings)  # noqa: E731
    with serving(setup=setup, child=child, stated={"scan": scan}):
        (settings,) = asked
        assert settings.info.scan == scan
        return settings.info


FOUND = Relaxation.of([0.1], [2.0], np.eye(1), "holds")  # in the calibration
GAP = Setup(
    eye=Eye(globe=OPEN, relaxation=FOUND), needle=Needle(gap_m=0.4e-3, polar_rad=0.6)
)


def test_a_recording_states_what_was_declared_of_plane_needle_and_eye():
    info = recording_info(GAP, direction_rad=1.1)
    assert (info.needle.polar_rad, info.needle.gap_m) == (0.6, 0.4e-3)
    assert info.eye == Eye("eye-a", globe=OPEN)
    cross = (Plane("along", 0.0, 0.0), Plane("across", 0.0, 1.5))
    assert recording_info(GAP, planes=cross).needle.gap_m is None
    assert info.force == ForceInfo("fz", 1, 0.2)
    unstated = recording_info(Setup()).needle
    needle = Study().needle
    assert (unstated.polar_rad, unstated.gap_m) == (None, needle.gap_m)
    assert unstated.diameter_m == needle.outer_diameter_m


@pytest.mark.parametrize(
    ("lean_rad", "stated"),
    [((0.1, 0.1), ((0.1, 0.1), 0.3)), ((0.1, 0.2), (None, None))],
)
def test_a_recording_states_the_gauge_and_the_lean_that_a_file_can_hold(
    lean_rad, stated
):
    """A file has one lean, and no direction without it."""
    needle = Needle(diameter_m=0.9e-3, lean_rad=lean_rad, lean_azimuth_rad=0.3)
    found = recording_info(Setup(needle=needle)).needle
    assert found.diameter_m == 0.9e-3
    assert (found.lean_rad, found.lean_azimuth_rad) == stated


@pytest.fixture
def opinion() -> Iterator[FakeCompanion]:
    companion = FakeCompanion()
    yield companion
    companion.close()


def test_a_monitor_waits_until_the_second_opinion_is_ready(opinion, monkeypatch):
    monkeypatch.setattr(monitor, "NOTED_S", 0.0)
    companions = Companions({OPINION: opinion})
    notes = []

    def note(text):  # which comes while it waits
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
    opinion,
):
    companions = Companions({OPINION: opinion})
    notes = []
    opinion.says(SelfReport(detail="no model"))
    opinion.theirs.close()
    monitor._wait_for_opinion(companions, notes.append)
    # a cause at the server's first tick
    assert companions.faults(1.0) == ("second opinion: no model",)
    assert notes == []


def test_a_monitor_serves_without_a_second_opinion_that_is_never_ready_and_says_so(
    opinion, monkeypatch
):
    monkeypatch.setattr(monitor, "READY_S", 0.3)
    companions = Companions({OPINION: opinion})
    notes = []
    monitor._wait_for_opinion(companions, notes.append)
    assert companions.starts(OPINION)
    assert notes == [
        "the second opinion was not ready within 0.3 s: nothing is OK before its"
        " first one"
    ]


def refusal(**stated: Any) -> str:
    """Return why a monitor with these settings does not start, in one line."""
    with pytest.raises(InputError) as refused:
        run_small(NoGuard(), Companions({}), pytest.fail, stated=stated)
    assert "\n" not in str(refused.value)
    return str(refused.value)


@pytest.mark.parametrize(
    "host",
    ["", " ", "no-such-host.invalid", "x" * 64 + ".example", "203.0.113.7", "a\nb"],
)
def test_a_host_that_is_not_an_address_of_this_machine_is_refused_in_one_line(
    host,
):
    words = f"`host` {host!r}" if host.strip() else "`host`: empty"
    assert refusal(address=Address(host, 0)).startswith(words)


@pytest.mark.parametrize(
    ("black_box", "record", "words"),
    [
        ("file/inside", None, "Not a directory"),
        ("x" * 300, None, "File name too long"),
        ("/proc/box", None, "/proc/box"),
        ("box", "there", "exists already"),
        ("box", "link", "exists already"),
        ("box", "file/inside", "Not a directory"),
        ("box", "x" * 300, "File name too long"),
        ("box", "/proc/session", "`record` /proc/session"),
        ("box", "box", "the folder of the black box is there"),
        ("box/inside", "box", "the folder of the black box is there"),
    ],
)
def test_a_folder_that_cannot_be_written_or_exists_is_refused_before_anything_is_made(
    tmp_path, black_box, record, words
):
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    folders = {
        "black_box": tmp_path / black_box,
        "record": record and tmp_path / record,
    }
    assert words in refusal(**folders)
    assert (tmp_path / "file").read_text() == "mine"
    assert not (tmp_path / "box").exists()


def test_the_folder_of_the_black_box_may_be_there_and_that_of_a_recording_is_made_later(
    tmp_path,
):
    box = tmp_path / "box"
    for _ in range(2):
        with serving(stated={"black_box": box, "record": tmp_path / "session"}):
            pass

    names = sorted(path.name for path in box.rglob("*"))
    assert names == ["decisions-000001.jsonl", "log"]
    assert not (tmp_path / "session").exists()


@pytest.mark.parametrize(
    ("limits", "raised"),
    [((256, 1024), [(384, 1024)]), ((256, 383), []), ((400, 1024), [])],
)
def test_a_low_limit_of_files_is_raised_and_a_hard_one_below_the_need_is_refused(
    monkeypatch,
    limits,
    raised,
):
    """For 256 clients and 128 files of its own."""
    found = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits)
    monkeypatch.setattr(resource, "setrlimit", lambda _, both: found.append(both))
    if limits[1] < 384:
        assert (
            "at most 383 are allowed (ulimit -Hn), the monitor needs 384" in refusal()
        )
    else:
        with serving():
            pass
    assert found == raised


def test_a_terminal_that_is_stopped_keeps_nobody_waiting_and_fills_no_memory():
    go_on = Event()
    lines = []

    def write(text):
        go_on.wait(FUSE_S)
        lines.append(text)

    notes = monitor.OperatorNotes(write)
    for number in range(3 * WAITING_LINES):
        notes(str(number))

    notes.close(within_s=0.01)
    assert not lines
    go_on.set()
    notes.close(FUSE_S)
    assert WAITING_LINES <= len(lines) <= WAITING_LINES + 1
    assert lines == [str(number) for number in range(len(lines))]  # in their order
