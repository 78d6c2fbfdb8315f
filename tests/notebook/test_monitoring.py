"""A monitor for the time of a block: the real one, ended whatever the block does."""

import socket
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from analytic_frames import GAP_M, IOP_PA, SCALE, image, tip_of, wall_section
from commands import PACED, monitor_folder
from small_monitor import Peer
from waiting import FUSE_S

import scleraforce as sf
from scleraforce.errors import InputError
from scleraforce.notebook import monitoring
from scleraforce.openigtlink import Image

MATRIX = (
    SCALE.lateral_m * 1e3,
    0.0,
    0.0,
    0.0,
    SCALE.depth_m * 1e3,
    0.0,
    0.0,
    0.0,
    1.0,
    0.0,
    0.0,
    0.0,
)
pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="the monitor runs on Linux only"
)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no busy machine make the watchdog or the operator impatient."""
    monkeypatch.setattr(monitoring, "COMMAND", (sys.executable, str(PACED)))
    ask = partial(monitoring.ask_reset, within_s=FUSE_S)
    monkeypatch.setattr(monitoring, "ask_reset", ask)


@pytest.mark.usefixtures("patient")
def test_a_robot_meets_the_monitor_of_the_command_and_it_ends_with_the_block(
    tmp_path: Path,
) -> None:
    folder = monitor_folder(tmp_path)
    given = {
        "calibration": folder / "calibration.json",
        "eye": "mine",
        "iop_pa": IOP_PA,
        "gap_m": GAP_M,
    }
    meets = sf.monitor(
        folder / "reader",
        **given,
        globe="open",
        second_opinion=False,
        black_box=tmp_path / "box",
    )

    with meets as running, Peer(running.port, version=2) as robot:
        assert f"gap {1e3 * GAP_M:.2f} mm" in "".join(running.lines)
        robot.hear(lambda peer: bool(peer.statuses()))
        assert robot.statuses()[0].code == 13
        robot.say(Image(image(wall_section(tip_of(8e-3)))[None], MATRIX), message_id=1)
        robot.hear(lambda peer: peer.statuses()[-1].code != 13)
        assert running.reset()[1]
        assert not replace(running, token="wrong").reset()[0]

    assert running.summary["frames"] >= 1
    assert running.lines[-1].startswith("ended after")
    assert (tmp_path / "box" / "log").is_dir()

    with (
        pytest.raises(ConnectionRefusedError),
        socket.create_connection((running.host, running.port)),
    ):
        pass


def test_a_monitor_that_cannot_start_is_one_clear_line(tmp_path: Path) -> None:
    for model, given, words in (
        (tmp_path / "gone", {}, "gone"),
        ("default", {"iop_pa": -5.0}, "iop-mmhg"),
        ("default", {"globe": "shut"}, "shut"),
    ):
        with (
            pytest.raises(InputError, match=words) as fault,
            sf.monitor(model, **given),
        ):
            pass

        assert "\n" not in str(fault.value)


@pytest.mark.usefixtures("patient")
def test_a_block_that_fails_ends_its_monitor(tmp_path: Path) -> None:
    folder = monitor_folder(tmp_path)
    seen = []

    def fail() -> None:
        with sf.monitor(folder / "reader", second_opinion=False) as running:
            seen.append(running)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()

    assert seen[0].lines[-1].startswith("ended after")
