"""What frames of known force tell of how far an eye's forces lie off the library's."""

from collections.abc import Sequence

import numpy as np
import pytest

from scleraforce.calibration.discrepancy import KnownForce, fitted_discrepancy


def frames(library_n: Sequence[float], level: float, growth: float, relative_sd: float = 0.015) -> list[KnownForce]:
    """Frames of an eye whose forces lie off by just so much."""
    return [
        KnownForce(
            force_n=force_n * float(np.exp(level + growth * (force_n / 60e-3 - 0.5))),
            library_n=force_n,
            sd_n=relative_sd * force_n,
        )
        for force_n in library_n
    ]


def test_without_a_frame_nothing_is_known_but_what_eyes_have() -> None:
    found = fitted_discrepancy([])
    assert (found.level, found.growth) == (0.0, 0.0)
    assert (found.level_sd, found.growth_sd) == pytest.approx((0.02, 0.035))


@pytest.mark.parametrize(("level", "growth"), [(0.1, 0.8), (-0.03, 0.3), (0.0, -0.4)])
def test_many_frames_tell_level_and_growth(level: float, growth: float) -> None:
    found = fitted_discrepancy(frames(np.linspace(10e-3, 55e-3, 40), level, growth))
    assert found.level == pytest.approx(level, abs=0.005)
    assert found.growth == pytest.approx(growth, abs=0.05)
    assert abs(found.growth - growth) < 3.0 * found.growth_sd


def test_three_frames_of_tissue_that_stiffens_are_believed_and_noise_of_an_even_wall_is_not() -> None:
    forces_n = (17e-3, 30e-3, 38e-3)
    stiffening = fitted_discrepancy(frames(forces_n, 0.15, 1.2))
    assert stiffening.growth == pytest.approx(1.2, abs=0.2)
    noise = fitted_discrepancy(frames((18e-3, 38e-3, 57e-3), 0.0, 0.04))
    assert abs(noise.growth) < 0.03


def test_one_frame_tells_the_force_at_its_own_dent() -> None:
    (frame,) = frames((40e-3,), 0.0, 0.0)
    found = fitted_discrepancy([KnownForce(force_n=1.3 * frame.force_n, library_n=frame.library_n, sd_n=frame.sd_n)])
    assert found.corrected_n(np.array([40e-3]))[0] == pytest.approx(1.3 * 40e-3, rel=0.03)


def test_frames_in_any_order_tell_the_same() -> None:
    some = frames((12e-3, 30e-3, 50e-3), 0.02, 0.5)
    assert fitted_discrepancy(some) == fitted_discrepancy(some[::-1])
