import os
import signal
import time

import pytest

from scleraforce.service.companions.channel import Channel, ChannelClosedError
from scleraforce.service.companions.child import Child, settings_of_child
from scleraforce.service.companions.guard import Guard

MODULE = """
import os, signal, sys, time
from scleraforce.service.companions.child import settings_of_child
from scleraforce.service.companions.channel import ChannelClosedError
channel, settings = settings_of_child(sys.argv)
blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])
said = os.pread(settings["descriptor"], 100, 0).decode() if "descriptor" in settings else None
channel.send({"settings": settings, "interrupts": signal.SIGINT not in blocked, "read": said,
              "threads": os.environ["OMP_NUM_THREADS"]})
while settings["ends"]:
    try:
        channel.receive()
    except ChannelClosedError:
        sys.exit(settings["ends"])
    time.sleep(0.01)
time.sleep(60)
"""


@pytest.fixture(autouse=True)
def module(tmp_path, monkeypatch):
    (tmp_path / "some_child.py").write_text(MODULE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


def answer(child):
    for _ in range(1000):
        if messages := child.channel.receive():
            return messages[0]
        time.sleep(0.01)
    raise AssertionError("no answer in 10 s")


def test_a_child_gets_its_settings_and_the_files_and_ends_when_the_channel_closes():
    file = os.memfd_create("test")
    os.write(file, b"shared")
    settings = {"ends": 7, "descriptor": file, "name": "é"}
    child = Child("some_child", settings, [file])
    said = answer(child)
    assert said == {"settings": settings, "interrupts": False, "read": "shared", "threads": "1"}
    assert child.exit_code is None
    os.kill(child.pid, 0)
    os.kill(child.pid, signal.SIGINT)
    time.sleep(0.05)
    assert child.exit_code is None
    assert child.end() == 7
    assert child.exit_code == 7
    os.close(file)


def test_a_child_that_does_not_end_is_killed():
    child = Child("some_child", {"ends": 0})
    answer(child)
    assert child.end(within_s=0.05) == -signal.SIGKILL


def test_a_child_whose_monitor_has_gone_or_says_nothing_does_not_start():
    ours, theirs = Channel.pair()
    with pytest.raises(RuntimeError, match="started by `scleraforce monitor`"):
        settings_of_child(["x", str(os.dup(theirs.fileno()))], within_s=0.01)
    ours.close()
    with pytest.raises(ChannelClosedError):
        settings_of_child(["x", str(os.dup(theirs.fileno()))])
    theirs.close()


def test_no_module_of_the_current_folder_runs_in_a_child(tmp_path, monkeypatch):
    """Those of PYTHONPATH do, as in the process that starts it."""
    here = tmp_path / "here"
    here.mkdir()
    for name in ("numpy", "signal", "json", "socket", "sitecustomize", "some_child"):
        (here / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\nraise SystemExit\n")
    monkeypatch.chdir(here)
    child = Child("some_child", {"ends": 3})
    assert answer(child)["threads"] == "1"
    assert child.end() == 3
    guard = Guard()
    guard.end()
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT, signal.SIGINT, signal.SIGTERM])
def test_a_child_does_not_hear_of_a_terminal_that_is_closed(number):
    child = Child("some_child", {"ends": 5})
    answer(child)
    assert os.getsid(child.pid) == child.pid
    os.kill(child.pid, number)
    time.sleep(0.05)
    assert child.exit_code is None
    assert child.end() == 5
