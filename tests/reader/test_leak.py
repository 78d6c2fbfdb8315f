"""Frames of an eye that leaks are read at the pressure that is left."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scleraforce.known import Known, known_globe
from scleraforce.reader.leak import Leak

GLOBE = known_globe("sealed", 1e8)
LAW = GLOBE.globe(GLOBE.mean)
KNOWN = Known(iop_pa=300.0, globe=GLOBE, leak_time_s=20.0)
DENT_M3 = 10e-9


@pytest.mark.parametrize("every_s", [0.1, 5.0])
def test_a_dent_that_stays_leaks_in_dense_sequences_and_in_sparse_ones_whose_holds_are_known(every_s: float) -> None:
    leak, rests_pa = Leak(KNOWN), []
    times_s = np.arange(0.0, 30.0, every_s).tolist()
    for time_s in times_s:
        (answer,), leak = leak.read(lambda now: (shown(now.iop_pa),), time_s, every_s)
        rests_pa.append(answer.rest_pa)
    expected_pa = LAW.pressure(300.0, -DENT_M3 * (1.0 - np.exp(-np.array(times_s) / 20.0)))
    assert rests_pa == pytest.approx(expected_pa, rel=2e-3)


def test_frames_that_are_refused_show_no_dent_and_the_pressure_comes_back() -> None:
    leak = Leak(KNOWN)
    for time_s in (0.0, 0.2, 10.0, 20.0):
        (low,), leak = leak.read(lambda now: (shown(now.iop_pa),), time_s, 10.0)
    rests_pa = []
    for time_s in np.arange(20.2, 140.0, 0.2).tolist():
        _, leak = leak.read(
            lambda now: rests_pa.append(now.iop_pa) or (SimpleNamespace(iop_at_dent_pa=None),), time_s, None
        )
    assert low.rest_pa < 0.9 * 300.0
    assert rests_pa[-1] == pytest.approx(300.0, rel=0.01)


def test_an_eye_that_does_not_leak_keeps_its_pressure() -> None:
    for known in (replace(KNOWN, leak_time_s=None), replace(KNOWN, globe=known_globe("open")), Known(leak_time_s=9.0)):
        leak = Leak(known)
        assert leak.read(lambda now: now, 5.0, None) == (known, leak)


def shown(rest_pa: float) -> SimpleNamespace:
    return SimpleNamespace(rest_pa=rest_pa, iop_at_dent_pa=float(LAW.pressure(rest_pa, DENT_M3)))
