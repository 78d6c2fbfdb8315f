import json
import os
import signal
import time
from pathlib import Path

import pytest
from peer import FUSE_S, wait_until

from scleraforce.errors import MessageError
from scleraforce.known.eye import NOTHING_KNOWN
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.companions.channel import Channel, ChannelClosedError
from scleraforce.service.companions.child import Child, settings_of_child
from scleraforce.service.companions.frame_ring import RingPlace
from scleraforce.service.companions.guard import Guard
from scleraforce.service.companions.messages import MonitorEnds
from scleraforce.service.companions.opinion_settings import OpinionSettings

MODULE = """
import json, os, signal, sys, time
from scleraforce.service.companions.child import settings_of_child
from scleraforce.service.companions.channel import ChannelClosedError
from scleraforce.service.companions.messages import Note
from scleraforce.service.companions.opinion_settings import OpinionSettings
channel, settings = settings_of_child(sys.argv, OpinionSettings)
blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])
said = os.pread(settings.ring.descriptor, 100, 0).decode() if settings.ring.descriptor else None
channel.send(Note(time_s=0.0, text=json.dumps({
    "settings": repr(settings), "interrupts": signal.SIGINT not in blocked, "read": said,
    "threads": os.environ["OMP_NUM_THREADS"],
})))
while settings.ring.frames:
    try:
        channel.receive()
    except ChannelClosedError:
        sys.exit(settings.ring.frames)
    time.sleep(0.01)
time.sleep(60)
"""


def ending_with(code, descriptor=0):
    """Settings of some child: its exit code in place of a number of frames; it waits for ever for 0."""
    ring = RingPlace(descriptor=descriptor, frames=code, rows=1, columns=1)
    return OpinionSettings(
        model=Path("é"), known=NOTHING_KNOWN, scale=PixelScale(lateral_m=1e-5, depth_m=1e-5), ring=ring
    )


@pytest.fixture(autouse=True)
def module(tmp_path, monkeypatch):
    (tmp_path / "some_child.py").write_text(MODULE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)


def answer(child):
    messages = []
    wait_until(lambda: messages.extend(child.channel.receive()) or messages)
    return json.loads(messages[0].text)


def test_a_child_gets_its_settings_and_the_files_and_ends_when_the_channel_closes():
    file = os.memfd_create("test")
    os.write(file, b"shared")
    settings = ending_with(7, file)
    child = Child("some_child", settings, [file])
    said = answer(child)
    assert said == {"settings": repr(settings), "interrupts": False, "read": "shared", "threads": "1"}
    assert child.exit_code is None
    os.kill(child.pid, 0)
    os.kill(child.pid, signal.SIGINT)
    time.sleep(0.05)
    assert child.exit_code is None
    assert child.end(FUSE_S) == 7
    assert child.exit_code == 7
    os.close(file)


def test_a_child_that_does_not_end_is_killed():
    child = Child("some_child", ending_with(0))
    answer(child)
    assert child.end(within_s=0.05) == -signal.SIGKILL


def test_a_child_whose_monitor_has_gone_or_says_nothing_does_not_start():
    ours, theirs = Channel.pair()
    with pytest.raises(RuntimeError, match="started by `scleraforce monitor`"):
        settings_of_child(["x", str(os.dup(theirs.fileno()))], OpinionSettings, within_s=0.01)
    ours.send(MonitorEnds())
    with pytest.raises(MessageError, match="a MonitorEnds came; the first message must be a OpinionSettings"):
        settings_of_child(["x", str(os.dup(theirs.fileno()))], OpinionSettings)
    ours.close()
    with pytest.raises(ChannelClosedError):
        settings_of_child(["x", str(os.dup(theirs.fileno()))], OpinionSettings)
    theirs.close()


def test_no_module_of_the_current_folder_runs_in_a_child(tmp_path, monkeypatch):
    """Those of PYTHONPATH do, as in the process that starts it."""
    here = tmp_path / "here"
    here.mkdir()
    for name in ("numpy", "signal", "json", "socket", "sitecustomize", "some_child"):
        (here / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\nraise SystemExit\n")
    monkeypatch.chdir(here)
    child = Child("some_child", ending_with(3))
    assert answer(child)["threads"] == "1"
    assert child.end(FUSE_S) == 3
    guard = Guard()
    guard.end()
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGHUP,
        *(pytest.param(number, marks=pytest.mark.slow) for number in (signal.SIGQUIT, signal.SIGINT, signal.SIGTERM)),
    ],
)
def test_a_child_does_not_hear_of_a_terminal_that_is_closed(number):
    child = Child("some_child", ending_with(5))
    answer(child)
    assert os.getsid(child.pid) == child.pid
    os.kill(child.pid, number)
    time.sleep(0.05)
    assert child.exit_code is None
    assert child.end(FUSE_S) == 5
