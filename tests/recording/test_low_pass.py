"""The low-pass of a force log, against SciPy's filter."""

import numpy as np
import pytest
from scipy import signal

from scleraforce.recording.low_pass import smoothed


@pytest.mark.parametrize(
    ("count", "rate_hz", "reach"), [(400, 200.0, 120), (5000, 21.0, 13), (7, 20.0, 6), (2, 50.0, 0)]
)
def test_a_force_is_filtered_as_by_scipy(count: int, rate_hz: float, reach: int) -> None:
    values = np.cumsum(np.random.default_rng(count).standard_normal(count)) + 3.0
    before = values.copy()
    sections = signal.butter(2, 5.0, fs=rate_hz, output="sos")
    expected = signal.sosfiltfilt(sections, values, padtype="even", padlen=reach)
    assert smoothed(values, 5.0 / rate_hz, reach) == pytest.approx(expected, rel=1e-9, abs=1e-9)
    np.testing.assert_array_equal(values, before)
