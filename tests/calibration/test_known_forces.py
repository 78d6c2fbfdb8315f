"""What forces that are known, beside those that are read, tell of E, k, level and growth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from scleraforce.calibration.forces import LABEL_SD_N
from scleraforce.calibration.known_forces import KnownForce, place_of, regression
from scleraforce.known import OPEN, REFERENCE_RIGIDITY, SEALED, Known, KnownGlobe, Modulus

FILTERED = replace(SEALED, mean=REFERENCE_RIGIDITY, sd=0.05 * REFERENCE_RIGIDITY, correlation=-0.5, calibrated=True)


def filtered(globe: KnownGlobe = FILTERED, relative_sd: float = 0.02) -> Known:
    """An eye after the filter."""
    return Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=relative_sd * 0.3e6, source="own"), globe=globe)


def frames(
    library_n: Sequence[float], off: Sequence[float], known: Known, relative_sd: float = 0.015
) -> list[KnownForce]:
    """Frames of an eye whose ln E, k over the reference's, level and growth are off by just so much.

    The deeper a dent, the less its force says of E and the more of k.
    """
    assert known.modulus is not None
    found = []
    for force_n in library_n:
        by = 1.0 - 4.0 * force_n, 0.2 + 8.0 * force_n if known.globe and known.globe.can_be_sealed else 0.0
        slopes = np.array([*by, 1.0, force_n / 60e-3 - 0.5])
        found.append(
            KnownForce(
                force_n=force_n * float(np.exp(slopes @ off)),
                library_n=force_n,
                sd_n=relative_sd * force_n,
                modulus_pa=known.modulus.mean_pa,
                rigidity=known.globe.mean if known.globe else 0.0,
                by_modulus=by[0],
                by_rigidity=by[1],
            )
        )
    return found


def found_off(read: Sequence[KnownForce], known: Known) -> tuple[np.ndarray, np.ndarray]:
    """Return what the regression finds, off the filter's, and its covariance."""
    found = regression(read, known, place_of(known))
    return found.mean - [*place_of(known), 0.0, 0.0], found.covariance


def test_without_a_frame_nothing_is_known_but_what_the_filter_and_eyes_have() -> None:
    off, covariance = found_off([], filtered())
    np.testing.assert_array_equal(off, np.zeros(4))
    of_filter = np.array([[0.02**2, -0.5 * 0.02 * 0.05], [-0.5 * 0.02 * 0.05, 0.05**2]])
    np.testing.assert_allclose(covariance[:2, :2], of_filter, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance))[2:], [0.02, 0.035])


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.1, 0.8), (0.0, 0.0, 0.0, -0.4), (-0.4, 0.0, 0.0, 0.0)])
def test_many_frames_tell_what_is_off(off: tuple[float, ...]) -> None:
    """What no slope tells apart is shared among the four; the forces that follow are those of the eye."""
    known = filtered(OPEN)
    read = frames(np.linspace(4e-3, 55e-3, 40), off, known)
    found, _ = found_off(read, known)
    for frame in read:
        slopes = [frame.by_modulus, 0.0, 1.0, frame.library_n / 60e-3 - 0.5]
        assert np.exp(slopes @ found) == pytest.approx(frame.force_n / frame.library_n, rel=0.01)


def test_a_filter_that_was_led_astray_is_not_believed() -> None:
    known = filtered()
    off, _ = found_off(frames((15e-3, 30e-3, 50e-3), (-0.5, 0.0, 0.0, 0.0), known), known)
    assert off[0] == pytest.approx(-0.5, abs=0.12)
    sure, _ = found_off(frames((15e-3, 30e-3, 50e-3), (-0.02, 0.0, 0.0, 0.0), known), known)
    assert abs(sure[2]) < 0.02


def test_three_frames_of_tissue_that_stiffens_are_believed_and_noise_of_an_even_wall_is_not() -> None:
    known, forces_n = filtered(OPEN), (17e-3, 30e-3, 38e-3)
    stiffening, _ = found_off(frames(forces_n, (0.0, 0.0, 0.15, 1.2), known), known)
    assert stiffening[3] == pytest.approx(1.2, abs=0.25)
    noise, _ = found_off(frames((18e-3, 38e-3, 57e-3), (0.0, 0.0, 0.0, 0.04), known), known)
    assert abs(noise[3]) < 0.03


def test_the_four_together_are_surer_than_each() -> None:
    """The force at a dent like those of the frames is known, however it is shared among the four."""
    known = filtered()
    read = frames((20e-3, 40e-3, 57e-3), (0.0, 0.0, 0.0, 0.0), known, relative_sd=0.01)
    _, covariance = found_off(read, known)
    slopes = np.array([read[1].by_modulus, read[1].by_rigidity, 1.0, read[1].library_n / 60e-3 - 0.5])
    alone = np.sqrt(slopes**2 @ np.diag(covariance))
    assert np.sqrt(slopes @ covariance @ slopes) < 0.011 < 0.5 * alone


def test_the_mean_is_where_the_loss_is_least() -> None:
    """Against a minimum that is searched for without derivatives, of the loss written down once more."""
    known = filtered()
    read = frames((12e-3, 25e-3, 41e-3, 55e-3), (0.1, -0.2, 0.05, 0.3), known)
    scale = np.linalg.inv(np.array([[0.02**2, -0.5 * 0.02 * 0.05], [-0.5 * 0.02 * 0.05, 0.05**2]]))

    def loss(off: np.ndarray) -> float:
        total = 4.0 * np.log1p(off[:2] @ scale @ off[:2] / 4.0)
        total += 4.0 * np.log1p((off[2] / 0.02) ** 2 / 4.0) + 4.0 * np.log1p((off[3] / 0.035) ** 2 / 4.0)
        for frame in read:
            slopes = np.array([frame.by_modulus, frame.by_rigidity, 1.0, frame.library_n / 60e-3 - 0.5])
            variance = (frame.sd_n / frame.library_n) ** 2 + (LABEL_SD_N / frame.force_n) ** 2
            total += (np.log(frame.force_n / frame.library_n) - slopes @ off) ** 2 / variance
        return float(total)

    found, _ = found_off(read, known)
    near = minimize(loss, found, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10, "maxiter": 8000})
    np.testing.assert_allclose(found, near.x, atol=1e-4)
    assert regression(read, known, found[:2] + place_of(known)).loss == pytest.approx(loss(found), rel=1e-6)
    assert regression(read, known, place_of(known)).loss > loss(found)


def test_frames_that_agree_promise_nothing_and_others_scatter() -> None:
    """Whatever the four explain is no scatter; what they leave is, over what is expected of each frame."""
    known, forces_n = filtered(OPEN), (18e-3, 38e-3, 57e-3)
    assert regression([], known, place_of(known)).scatter == 1.0
    agreeing = frames(forces_n, (0.0, 0.0, 0.0, 0.0), known)
    assert regression(agreeing, known, place_of(known)).scatter == 1.0
    shifts = (0.05, -0.05, 0.04)
    scattered = [
        replace(frame, force_n=frame.force_n * np.exp(shift)) for frame, shift in zip(agreeing, shifts, strict=True)
    ]
    off, _ = found_off(scattered, known)
    squares = 0.0
    for frame in scattered:
        slopes = np.array([frame.by_modulus, frame.by_rigidity, 1.0, frame.library_n / 60e-3 - 0.5])
        rest = np.log(frame.force_n / frame.library_n) - slopes @ off
        squares += rest**2 / ((frame.sd_n / frame.library_n) ** 2 + (LABEL_SD_N / frame.force_n) ** 2)
    scatter = regression(scattered, known, place_of(known)).scatter
    assert scatter == pytest.approx(np.sqrt((5.0 + squares / 0.17) / 8.0))
    assert scatter > 2.0


def test_frames_of_tissue_that_stiffens_do_not_scatter_for_it() -> None:
    known = filtered(OPEN)
    stiffening = regression(frames((17e-3, 30e-3, 38e-3), (0.0, 0.0, 0.15, 1.2), known), known, place_of(known))
    assert stiffening.scatter == 1.0


def test_frames_that_were_read_with_another_modulus_tell_the_same() -> None:
    known = filtered(OPEN)
    read = frames((12e-3, 30e-3, 50e-3), (0.0, 0.0, 0.02, 0.0), known)
    stiffer = [
        replace(frame, modulus_pa=1.1 * frame.modulus_pa, library_n=frame.library_n * 1.1**frame.by_modulus)
        for frame in read
    ]
    moved = [replace(frame, sd_n=0.015 * frame.library_n) for frame in stiffer]
    np.testing.assert_allclose(found_off(moved, known)[0], found_off(read, known)[0], atol=0.002)


def test_frames_in_any_order_tell_the_same() -> None:
    known = filtered()
    some = frames((12e-3, 30e-3, 50e-3), (0.0, 0.1, 0.02, 0.5), known)
    np.testing.assert_allclose(found_off(some, known)[0], found_off(some[::-1], known)[0], rtol=1e-6)
