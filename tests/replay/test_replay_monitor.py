"""Each fault that `replay` injects, against the monitor's own server with its decision: it withdraws, and says why."""

from contextlib import closing, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_monitor import COLUMNS, FRAME_S, FUSE_S, ROWS, SCALE_M, TurnedClock, frame_of, serving

from scleraforce.errors import InputError
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.replay import faults, player
from scleraforce.replay.answer_log import AnswerLog
from scleraforce.replay.faults import FAULTS, FaultReport, inject, prepare
from scleraforce.replay.player import Player
from scleraforce.replay.scanner_client import ScannerClient

FORCES_N = np.concatenate([np.zeros(10), np.full(60, 8e-3), np.linspace(8e-3, 40e-3, 60)])
FAULT_S = 1.4  # frame 41, in contact
# Its reader takes any picture for a frame of some force, so noise is not unusable to it.
# The small monitor's frames have no texture by which a changed picture could be known, and it bears more delay than the
# stale frames of so short a recording have: `test_replay_faults.py` and `test_decision.py` have these.
CHANGED = ("burned-in-clock", "dark-level", "moved", "half-frozen", "ghost", "persistence")
SEEN = [name for name in FAULTS if name not in ("unusable", "stale", *CHANGED)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Recording:
    folder: Path = tmp_path_factory.mktemp("replay") / "rec"
    (folder / "frames").mkdir(parents=True)
    width_m, depth_m = COLUMNS * SCALE_M[0], ROWS * SCALE_M[1]
    (folder / "recording.toml").write_text(
        f"[eye]\nid = 'ruled'\n[oct]\ncolumns = {COLUMNS}\nrows = {ROWS}\nbits = 16\nwidth_m = {width_m}\n"
        f"depth_m = {depth_m}\n[needle]\ngauge = 22\nslice_gap_m = 0.0005\n"
    )
    lines = ["file,time_s"]
    for index, force_n in enumerate(FORCES_N):
        assert cv2.imwrite(str(folder / "frames" / f"{index:03d}.png"), frame_of(round(force_n * 1e6), index + 1))
        lines.append(f"{index:03d}.png,{1.0 + index / 100:.4f}")
    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    return read_recording(folder)


def injected(recording: Recording, name: str, version: int) -> FaultReport:
    log = AnswerLog()
    with (
        serving(clock=None, catch_up_s=0.1) as port,  # 100 frames are not a flood for a server with time to catch up
        closing(ScannerClient("127.0.0.1", port, log.hear, observed=True)) as client,
    ):
        player = Player(recording, client, log, version=version)
        ready = prepare(name, recording, FAULT_S, np.random.default_rng(0), version=version, forces_n=FORCES_N)
        player.play(ready.time_s)
        return inject(player, ready)


@pytest.mark.slow
@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("name", SEEN)
def test_the_monitor_withdraws_for_the_faults_own_cause(recording, monkeypatch, name: str, version: int) -> None:
    for name_of_limit in ("WITHIN_S", "SILENT_S"):  # the monitor's server may be held up
        monkeypatch.setattr(faults, name_of_limit, FUSE_S)
    found = []
    for _ in range(5):  # a machine that stalls makes frames late or lost, which are causes too: then once more
        with suppress(InputError):
            report = injected(recording, name, version)
            assert report.code == 3
            found.append(report.cause)
            if report.expected:
                return
    raise AssertionError(found)


def test_a_whole_recording_is_answered_and_withdrawn_at_its_force(recording, monkeypatch) -> None:
    monkeypatch.setattr(player, "ANSWER_S", FUSE_S)
    clock, log = TurnedClock(), AnswerLog()
    with serving(clock=clock) as port, closing(ScannerClient("127.0.0.1", port, log.hear)) as client:
        Player(recording, client, log, version=2, wall_clock=clock).step(lambda _: clock.turn(FRAME_S) or True)
    withdrawal = log.first_doubt(0.0, (3,))
    assert withdrawal is not None
    assert len(log.answers) == len(FORCES_N)
    assert withdrawal.cause == "RISING"
    assert withdrawal.answers
    assert 20e-3 < FORCES_N[withdrawal.frame - 1] < 30e-3
