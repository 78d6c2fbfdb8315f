"""The surface's reflection, of light that is known."""

import numpy as np

from scleraforce.laboratory import scanner_light
from scleraforce.laboratory.scanner_display import Estimate, Unmeasured
from scleraforce.laboratory.scanner_light import SurfaceLight, reflections


def light_about(gain: float, angle_rad: float, seed: int) -> SurfaceLight:
    """Light of one look about a surface that is where it was found."""
    rng = np.random.default_rng(seed)
    slope, below = rng.uniform(0.0, 0.4, 60_000), rng.uniform(-5.0, 5.0, 60_000)
    mean = scanner_light._seen(slope, below, np.full(60_000, 1.2), np.array([gain, angle_rad, 0.3, *[0.0] * 6]))
    light = mean * rng.exponential(1.0, 60_000)
    return SurfaceLight(slope_rad=slope, below=below, light=light, sigma_rows=1.2, noise=0.05)


def test_a_ridge_that_falls_with_the_angle_is_a_reflection() -> None:
    (strength,), angle = reflections([light_about(4.0, 0.12, 1)])
    assert isinstance(strength, Estimate)
    assert abs(strength.value - 10 * np.log10(4.0)) < 1.0
    assert isinstance(angle, Estimate)
    assert 0.1 < angle.value < 0.14


def test_a_ridge_that_is_there_at_all_angles_is_none() -> None:
    """The fit runs to the largest angle that it looks for, and knows that end exactly."""
    (strength,), angle = reflections([light_about(3.0, 50.0, 2)])
    assert isinstance(strength, Unmeasured)
    assert isinstance(angle, Unmeasured)
