"""How a monitor starts, and what its recordings state of the eye that it watches."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from small_monitor import FakeCompanion

from scleraforce.known import (
    OPEN,
    REFERENCE_RIGIDITY,
    SEALED,
    UNKNOWN,
    Known,
    KnownGlobe,
    known_globe,
    stated_eye,
    told_globe,
)
from scleraforce.monitor import MonitorLimits
from scleraforce.service import monitor_service
from scleraforce.service.companions.companions import OPINION, Companions
from scleraforce.service.companions.messages import Alive, SelfReport
from scleraforce.service.monitor_service import Address, MonitorSettings, _recording_info
from scleraforce.study import Study

CALIBRATED = KnownGlobe(
    kind="sealed", lowest=SEALED.lowest, highest=SEALED.highest, mean=REFERENCE_RIGIDITY, sd=1e6, calibrated=True
)


@pytest.mark.parametrize(
    ("known", "stated"),
    [
        (None, None),
        (UNKNOWN, None),
        (OPEN, OPEN),
        (SEALED, SEALED),
        (known_globe("sealed", REFERENCE_RIGIDITY, "logarithmic"),) * 2,
        (CALIBRATED, SEALED),  # its rigidity stands in the calibration
    ],
)
def test_a_recording_states_what_was_told_of_the_globe(known: KnownGlobe | None, stated: KnownGlobe | None) -> None:
    assert told_globe(stated_eye("mine", Known(globe=known))) == stated


def test_a_recording_states_where_the_monitor_was_told_that_plane_and_needle_are() -> None:
    known = Known(globe=OPEN, gap_m=0.4e-3, polar_rad=0.6, direction_rad=1.1)
    settings = MonitorSettings(
        eye="mine", known=known, limits=MonitorLimits(size=(400, 500), scale_m=(20e-6, 5e-6)), refractive_index=1.38,
        address=Address("localhost", 0), console=None, black_box=Path("black-box"), record=None, token="",
    )  # fmt: skip
    info = _recording_info(settings, Study())
    assert (info.oct.plane_direction_rad, info.needle.polar_angle_rad, info.needle.slice_gap_m) == (1.1, 0.6, 0.4e-3)
    assert (info.oct.width_m, info.oct.depth_m) == pytest.approx((10e-3, 2e-3))
    assert info.oct.refractive_index == 1.38
    untold = _recording_info(replace(settings, known=Known()), Study())
    assert (untold.oct.plane_direction_rad, untold.needle.polar_angle_rad) == (None, None)
    assert untold.needle.slice_gap_m == Study().needle.gap_m


@pytest.fixture
def opinion() -> Iterator[FakeCompanion]:
    companion = FakeCompanion()
    yield companion
    companion.end()


def test_a_monitor_waits_until_the_second_opinion_is_ready(
    opinion: FakeCompanion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(monitor_service, "NOTED_S", 0.0)
    companions, notes = Companions({OPINION: opinion}), list[str]()  # type: ignore[dict-item]  # a stand-in

    def note(text: str) -> None:  # it is told while it waits
        notes.append(text)
        assert companions.starts(OPINION)
        opinion.says(Alive(faults=()))

    monitor_service._wait_for_opinion(companions, opinion.channel, note)
    assert not companions.starts(OPINION)
    assert notes == ["the second opinion gets ready: some seconds, once after an installation half a minute or more"]


def test_a_monitor_does_not_wait_for_a_second_opinion_that_has_failed(opinion: FakeCompanion) -> None:
    companions, notes = Companions({OPINION: opinion}), list[str]()  # type: ignore[dict-item]  # a stand-in
    opinion.says(SelfReport(detail="no model"))
    opinion.theirs.close()
    monitor_service._wait_for_opinion(companions, opinion.channel, notes.append)
    assert companions.faults(1.0) == ("second opinion: no model",)  # a cause at the server's first tick
    assert notes == []


def test_a_monitor_serves_without_a_second_opinion_that_is_never_ready_and_says_so(
    opinion: FakeCompanion, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(monitor_service, "READY_S", 0.3)
    companions, notes = Companions({OPINION: opinion}), list[str]()  # type: ignore[dict-item]  # a stand-in
    monitor_service._wait_for_opinion(companions, opinion.channel, notes.append)
    assert companions.starts(OPINION)
    assert notes == ["the second opinion was not ready within 0.3 s: nothing is OK before its first one"]
