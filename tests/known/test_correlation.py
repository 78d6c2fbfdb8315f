"""Correlations that rounding would put beyond one: they are stored, read again and inverted like all others."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_recordings import calibration_text

from scleraforce.known import MOST_CORRELATED, SEALED, Known, Modulus, correlation_of
from scleraforce.known.calibration_file import globe_entry, read_calibration
from scleraforce.library.prior import prior_of
from scleraforce.study import ReaderStudy


def test_two_unknowns_that_are_as_good_as_one_are_never_correlated_beyond_one() -> None:
    rng = np.random.default_rng(0)
    roots = rng.uniform(1e-4, 1e2, (2000, 2)) * rng.choice([-1.0, 1.0], (2000, 2))
    found = np.array([correlation_of(np.outer(root, root), 0, 1) for root in roots])
    assert found == pytest.approx(np.sign(roots.prod(axis=1)), abs=1e-8)
    assert np.abs(found).max() == MOST_CORRELATED


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_most_correlated_eye_is_read_again_and_has_a_prior_to_draw_from(tmp_path: Path, sign: float) -> None:
    globe = replace(SEALED, correlation=sign * MOST_CORRELATED, calibrated=True)
    (tmp_path / "calibration.json").write_text(calibration_text(0.27, {"a": {"globe": globe_entry(globe)}}))
    read = read_calibration(tmp_path / "calibration.json").eyes["a"].globe
    assert read.correlation == globe.correlation
    own = Modulus(mean_pa=0.3e6, sd_pa=3e3, source="own")
    precision = prior_of(Known(modulus=own, globe=read), ReaderStudy()).calibrated
    assert np.linalg.inv(np.linalg.cholesky(precision)).max() == pytest.approx(1.0, rel=1e-6)
