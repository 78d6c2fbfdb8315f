"""Known inputs of an eye: their sources, its globe, the discrepancy of its forces."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_recordings import calibration_text

from scleraforce.base.normal_distribution import MOST_CORRELATED
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.records.calibration_file import (
    CalibrationSummary,
    calibrated_modulus,
    foreign_modulus,
    globe_entry,
    known_of_eye,
    read_calibration,
)
from scleraforce.records.eye import (
    NO_DISCREPANCY,
    EyeInfo,
    ForceDiscrepancy,
    Known,
    Modulus,
    completed_eye,
    stated_globe,
)
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, known_globe
from scleraforce.records.needle import NeedleInfo
from scleraforce.records.recording_info import RecordingInfo, known_of_recording
from scleraforce.records.scan import OctInfo
from scleraforce.records.study import ReaderStudy
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

CALIBRATED = replace(SEALED, mean=1.3e8, sd=4e6, correlation=-0.4, calibrated=True)


def test_a_recordings_statements_are_known_and_all_else_is_unknown() -> None:
    info = RecordingInfo(
        EyeInfo("e", thickness_m=0.6e-3),
        OctInfo(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3),
        NeedleInfo(gauge=22, slice_gap_m=0.5e-3, polar_angle_rad=0.6),
    )
    assert known_of_recording(info) == Known(
        modulus=None, iop_pa=None, thickness_m=0.6e-3, gap_m=0.5e-3, polar_rad=0.6
    )
    turned = replace(info, oct=replace(info.oct, plane_direction_rad=0.8))
    assert known_of_recording(turned) == replace(
        known_of_recording(info), direction_rad=0.8
    )


FOUND = replace(
    UNKNOWN,
    mean=0.4 * UNKNOWN.mean,
    sd=0.1 * UNKNOWN.sd,
    correlation=-0.8,
    calibrated=True,
)
EYES = {
    "mine": {"mean_mpa": 0.3, "sd_mpa": 0.004, "globe": globe_entry(CALIBRATED)},
    "lost": {"mean_mpa": 0.1, "status": "diverged: by 4 sd"},
    "contradicted": {
        "mean_mpa": 0.1,
        "status": "diverged: by 4 sd",
        "globe": globe_entry(UNKNOWN),
    },
    "undeclared": {"globe": globe_entry(FOUND)},
}


@pytest.fixture
def summary(tmp_path: Path) -> CalibrationSummary:
    file = tmp_path / "calibration.json"
    file.write_text(
        calibration_text(0.25, EYES, population={"mean_mpa": 0.25, "sd_mpa": 0.05})
    )
    return read_calibration(file)


def test_an_eye_has_its_own_modulus_and_another_that_of_its_population_with_its_spread(
    summary: CalibrationSummary,
) -> None:
    assert calibrated_modulus(summary, "mine") == Modulus(
        mean_pa=0.3e6, sd_pa=4e3, source="own"
    )
    assert calibrated_modulus(summary, "stranger") == Modulus(
        mean_pa=0.25e6, sd_pa=0.05e6, source="population"
    )
    assert foreign_modulus(summary, "mine") is None
    assert str(foreign_modulus(summary, "stranger")).endswith(
        "read with the population's modulus, 0.25 MPa +- 20 %"
    )


def test_an_eye_whose_calibration_diverged_is_read_as_one_of_unknown_modulus_or_globe_and_a_sentence_says_so(
    summary: CalibrationSummary,
) -> None:
    given = Known(iop_pa=270.0, thickness_m=0.6e-3, globe=OPEN)
    assert calibrated_modulus(summary, "lost") is None
    assert known_of_eye(given, summary, "lost") == given
    assert known_of_eye(given, summary, "contradicted") == replace(given, globe=None)
    assert str(foreign_modulus(summary, "contradicted")).endswith(
        "unknown modulus in an unknown globe"
    )
    assert (
        foreign_modulus(summary, "lost")
        == f"lost is not usable (diverged: by 4 sd) in {summary.path}, which has "
        "4 eyes (mine, lost, contradicted, undeclared): read "
        "as one of unknown modulus"
    )


def test_an_eye_takes_the_globe_that_its_calibration_found_unless_another_kind_is_declared(
    summary: CalibrationSummary,
) -> None:
    for declared in (None, SEALED):
        found = known_of_eye(
            Known(thickness_m=0.6e-3, globe=declared), summary, "mine"
        ).globe
        assert found is not None
        assert (found.kind, found.calibrated, found.correlation) == (
            "sealed",
            True,
            CALIBRATED.correlation,
        )
        assert (found.mean, found.sd) == pytest.approx((CALIBRATED.mean, CALIBRATED.sd))
        assert (
            known_of_eye(Known(globe=declared), summary, "stranger").globe is declared
        )
        globe = known_of_eye(
            Known(globe=declared), summary, "undeclared"
        ).globe  # E was found with it, and no other
        assert globe is not None
        assert (globe.kind, globe.correlation, globe.mean) == (
            "unknown",
            -0.8,
            pytest.approx(FOUND.mean),
        )

    assert known_of_eye(Known(globe=OPEN), summary, "mine").globe is OPEN


def test_a_recording_states_a_globe_or_none() -> None:
    for said, globe in (
        ({}, None),
        ({"globe": "open"}, OPEN),
        ({"globe": "sealed"}, SEALED),
        ({"globe": "sealed", "rigidity_pa13_per_m3": 1e8}, known_globe("sealed", 1e8)),
    ):
        assert stated_globe(EyeInfo("e", **said)) == globe


def test_an_eye_of_the_population_has_at_least_the_spread_of_eyes_and_no_modulus_if_all_diverged(
    tmp_path,
) -> None:
    file = tmp_path / "calibration.json"
    for sd_mpa, spread in (
        (0.0, 0.12),
        (None, 0.12 * 2**0.5),
    ):
        # one eye says nothing of the spread
        file.write_text(
            calibration_text(
                0.25, {"mine": {}}, population={"mean_mpa": 0.25, "sd_mpa": sd_mpa}
            )
        )
        assert calibrated_modulus(
            read_calibration(file), "stranger"
        ).relative_sd == pytest.approx(spread)

    file.write_text(calibration_text(0.25, {"lost": EYES["lost"]}))
    assert calibrated_modulus(read_calibration(file), "stranger") is None


def test_an_eye_of_the_population_leans_as_the_calibrated_ones_if_all_of_them_state_it(
    tmp_path: Path,
) -> None:
    file = tmp_path / "calibration.json"
    lean = {"lean_deg": 20.0}

    for eyes, lean_rad in (
        ({"a": lean, "b": {"lean_deg": 30.0}}, np.radians(25.0)),
        ({"a": lean, "b": {}}, None),
    ):
        file.write_text(calibration_text(0.25, eyes))
        found = known_of_eye(
            Known(), read_calibration(file), "stranger"
        ).calibrated_lean_rad
        assert found == (lean_rad and pytest.approx(lean_rad))


PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]


def test_a_globe_is_open_or_as_rigid_as_its_declaration_allows() -> None:
    assert known_globe(None) is UNKNOWN
    assert (UNKNOWN.lowest / PER_UL, UNKNOWN.highest / PER_UL) == pytest.approx(
        (0.0, 0.06)
    )
    assert known_globe("open", 1e8, "logarithmic") is OPEN
    assert (OPEN.band, OPEN.can_be_sealed, OPEN.globe(OPEN.mean).is_sealed) == (
        (0.0, 0.0),
        False,
        False,
    )
    assert known_globe("sealed") == SEALED
    assert (SEALED.lowest / PER_UL, SEALED.highest / PER_UL) == pytest.approx(
        (0.005, 0.06)
    )

    for globe in (UNKNOWN, SEALED):
        assert globe.can_be_sealed
        even = np.linspace(globe.lowest, globe.highest, 100_001)
        assert (globe.mean, globe.sd) == pytest.approx(
            (even.mean(), even.std()), rel=1e-4
        )
        assert 0.9 <= ((even >= globe.band[0]) & (even <= globe.band[1])).mean() < 0.96


def test_a_stated_rigidity_is_known_to_some_percent_under_its_law() -> None:
    for law in (None, *RIGIDITY_LAWS):
        globe = known_globe("sealed", 0.02 * PER_UL, law)
        assert (globe.kind, globe.law, globe.calibrated) == (
            "sealed",
            law or "cube-root",
            False,
        )
        low, high = globe.band
        assert (low / PER_UL, high / PER_UL) == pytest.approx(
            (0.0174, 0.0226), abs=1e-4
        )
        assert globe.lowest < low < 0.02 * PER_UL < high < globe.highest
        assert known_globe("sealed", law=law) == replace(SEALED, law=law or "cube-root")


def test_a_rigidity_makes_the_globe_of_its_law() -> None:
    for law in RIGIDITY_LAWS:
        globe = known_globe("sealed", law=law).globe(np.array([0.01, 0.03]) * PER_UL)
        assert globe.law == law
        slopes = globe.stiffness(SI_PER_UNIT["mmhg"][1] * 15.0)
        assert slopes[1] == pytest.approx(3.0 * slopes[0])
        # Pa a microlitre at 15 mmHg, where all laws agree
        assert slopes[1] * 1e-9 == pytest.approx(73.0, abs=0.1)


LIBRARY_N = np.array([0.0, 5e-3, 30e-3, 55e-3])
STIFFENING = ForceDiscrepancy(
    level=0.05, growth=0.4, level_sd=0.02, growth_sd=0.1, correlation=-0.6
)


def test_forces_grow_by_level_and_growth_and_beyond_the_range_by_no_more() -> None:
    np.testing.assert_array_equal(NO_DISCREPANCY.corrected_n(LIBRARY_N), LIBRARY_N)
    expected = LIBRARY_N * np.exp(0.05 + 0.4 * (LIBRARY_N / 60e-3 - 0.5))
    np.testing.assert_allclose(STIFFENING.corrected_n(LIBRARY_N), expected)
    assert STIFFENING.corrected_n(np.array([90e-3]))[0] == pytest.approx(
        90e-3 * np.exp(0.05 + 0.2)
    )


def test_the_most_correlated_eye_has_a_prior_to_draw_from() -> None:
    own = Modulus(mean_pa=0.3e6, sd_pa=3e3, source="own")
    for sign in (-1.0, 1.0):
        globe = replace(SEALED, correlation=sign * MOST_CORRELATED, calibrated=True)
        precision = prior_of(Known(modulus=own, globe=globe), ReaderStudy()).calibrated
        assert np.linalg.inv(np.linalg.cholesky(precision)).max() == pytest.approx(
            1.0, rel=1e-6
        )


def test_a_given_globe_is_completed_by_a_stated_one_of_its_kind_alone() -> None:
    stated = known_globe("sealed", 0.02 * PER_UL, "logarithmic")
    number = known_globe("sealed", 0.03 * PER_UL)

    for given, said, globe in [
        (SEALED, stated, stated),
        (number, stated, replace(number, law="logarithmic")),
        (OPEN, stated, OPEN),
        (None, stated, stated),
        (OPEN, None, OPEN),
    ]:
        assert completed_eye(Known(globe=given), Known(globe=said)).globe == globe
