"""An eye: its declared values and a calibration's, the discrepancy of its forces."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from small_recordings import calibration_text

from scleraforce.base.errors import StudyError
from scleraforce.base.normal_distribution import MOST_CORRELATED
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.records.calibration_file import (
    CalibrationSummary,
    calibrated_modulus,
    foreign_modulus,
    globe_entry,
    known_of_eye,
    read_calibration,
)
from scleraforce.records.decoder import parse_record
from scleraforce.records.eye import (
    NO_DISCREPANCY,
    Eye,
    ForceDiscrepancy,
    Modulus,
)
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy
from scleraforce.records.tissue_relaxation import Relaxation

CALIBRATED = replace(SEALED, mean=1.3e8, sd=4e6, correlation=-0.4, calibrated=True)


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
    given = Setup(eye=Eye(iop_pa=270.0, thickness_m=0.6e-3, globe=OPEN))
    assert calibrated_modulus(summary, "lost") is None
    assert known_of_eye(given, summary, "lost") == given
    assert known_of_eye(given, summary, "contradicted") == replace(
        given, eye=replace(given.eye, globe=None)
    )
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
            Setup(eye=Eye(thickness_m=0.6e-3, globe=declared)), summary, "mine"
        ).eye.globe
        assert found is not None
        assert (found.kind, found.calibrated, found.correlation) == (
            "sealed",
            True,
            CALIBRATED.correlation,
        )
        assert (found.mean, found.sd) == pytest.approx((CALIBRATED.mean, CALIBRATED.sd))
        assert (
            known_of_eye(Setup(eye=Eye(globe=declared)), summary, "stranger").eye.globe
            is declared
        )
        globe = known_of_eye(
            Setup(eye=Eye(globe=declared)), summary, "undeclared"
        ).eye.globe  # E was found with it, and no other
        assert globe is not None
        assert (globe.kind, globe.correlation, globe.mean) == (
            "unknown",
            -0.8,
            pytest.approx(FOUND.mean),
        )

    assert known_of_eye(Setup(eye=Eye(globe=OPEN)), summary, "mine").eye.globe is OPEN


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
            Setup(), read_calibration(file), "stranger"
        ).eye.calibrated_lean_rad
        assert found == (lean_rad and pytest.approx(lean_rad))


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
        precision = prior_of(
            Setup(eye=Eye(modulus=own, globe=globe)), ReaderStudy()
        ).calibrated
        assert np.linalg.inv(np.linalg.cholesky(precision)).max() == pytest.approx(
            1.0, rel=1e-6
        )


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"iop_pa": -1.0}, "iop_pa: -1 is below the smallest allowed value 0"),
        ({"iop_pa": nan}, "iop_pa: nan is not a finite number"),
        (
            {"thickness_m": 0.6},
            "thickness_m: 0.6 is above .* 0.003; did you mean 0.0006 m",
        ),
        ({"thickness_m": nan}, "thickness_m: nan is not a finite number"),
        ({"iop_pa": 2e3, "iop_sd_pa": 16e3}, "iop_sd_pa: 16000 is above .* 15000"),
        ({"iop_pa": 2e3, "iop_sd_pa": 0.0}, "iop_sd_pa: 0 is below .* 0.001"),
        (
            {"thickness_m": 6e-4, "thickness_sd_m": 4e-3},
            "thickness_sd_m: 0.004 is above .* 0.003",
        ),
        (
            {"thickness_m": 6e-4, "thickness_sd_m": 0.0},
            "thickness_sd_m: 0 is below .* 1e-07",
        ),
        ({"radius_m": 2e-3}, "radius_m: 0.002 is below .* 0.003"),
        ({"radius_m": 31e-3}, "radius_m: 0.031 is above .* 0.03"),
        (
            {"radius_m": 12e-3, "radius_sd_m": 11e-3},
            "radius_sd_m: 0.011 is above .* 0.01",
        ),
        ({"radius_m": 12e-3, "radius_sd_m": 0.0}, "radius_sd_m: 0 is below .* 1e-06"),
        ({"stiffening": nan}, "stiffening: nan is not a finite number"),
        ({"name": " "}, "name: empty; give the eye a name"),
        ({"name": "a\nb"}, "name: .* has a line break"),
    ],
)
def test_a_value_of_an_eye_that_cannot_be_is_refused(
    values: dict[str, Any], said: str
) -> None:
    with pytest.raises(StudyError, match=f"^{said}"):
        Eye(**values)


@pytest.mark.parametrize("of_value", ["iop_pa", "thickness_m", "radius_m"])
def test_an_uncertainty_is_refused_without_its_value(of_value: str) -> None:
    quantity, _, unit = of_value.rpartition("_")
    sd = f"{quantity}_sd_{unit}"
    with pytest.raises(
        StudyError, match=f"^{sd}: the uncertainty of {of_value}, which is missing; "
    ):
        Eye(**{sd: 1e-4 if unit == "m" else 50.0})

    lines = f"[eye]\nid = 'e'\n{sd} = {1e-4 if unit == 'm' else 50.0}\n"
    with pytest.raises(StudyError, match=f"^r.toml:3: eye.{sd}: the uncertainty of"):
        parse_record(EyeFile, lines, "r.toml")


@dataclass(frozen=True)
class EyeFile:
    """A file that has an eye alone."""

    eye: Eye


EYE_KEYS = (
    "id, thickness_m, thickness_sd_m, iop_pa, iop_sd_pa, radius_m, radius_sd_m, globe,"
    " rigidity_mmhg13_per_ul, rigidity_law, leak_time_s, relaxation"
)


@pytest.mark.parametrize(
    "key", ["age", "modulus", "stiffening", "discrepancy", "calibrated_lean_rad"]
)
def test_an_unknown_key_is_answered_with_all_keys_of_an_eye(key: str) -> None:
    with pytest.raises(
        StudyError, match=f"^r.toml:3: eye.{key}: unknown key; known here: {EYE_KEYS}$"
    ):
        parse_record(EyeFile, f"[eye]\nid = 'e'\n{key} = 1\n", "r.toml")


def test_an_eye_without_its_name_is_refused_in_a_file() -> None:
    with pytest.raises(StudyError, match=r"^r.toml:1: eye.id: missing"):
        parse_record(EyeFile, "[eye]\niop_pa = 2000.0\n", "r.toml")


def test_what_was_declared_of_an_eye_has_no_finding_of_a_calibration() -> None:
    declared = Eye(
        "mine",
        thickness_m=6e-4,
        thickness_sd_m=2e-5,
        iop_pa=2e3,
        iop_sd_pa=50.0,
        radius_m=12e-3,
        radius_sd_m=2e-4,
        globe=Globe.declared("sealed", leak_time_s=20.0),
        relaxation=Relaxation.declared([[0.1, 2.0]]),
    )
    found = replace(
        declared,
        modulus=Modulus.stated(0.3e6),
        stiffening=4.0,
        discrepancy=STIFFENING,
        calibrated_lean_rad=0.2,
        unlearned=declared,
    )
    assert found.declared() == declared
    findings = replace(
        found,
        globe=replace(found.globe, mean=1e8, sd=1e6, calibrated=True),
        relaxation=replace(found.relaxation, source="holds"),
    )
    assert findings.declared() == replace(declared, relaxation=None)
    assert Eye(globe=UNKNOWN).declared() == Eye()
    assert (found.before_learning, declared.before_learning) == (declared, declared)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Modulus(mean_pa=nan, sd_pa=1e3, source="own"), "modulus: nan ± 1000"),
        (lambda: Modulus(mean_pa=1e5, sd_pa=-1.0, source="own"), "modulus: 100000.0 ±"),
        (lambda: Modulus(mean_pa=1e5, sd_pa=1.0, source="mine"), "modulus: source: "),
        (lambda: Modulus.stated(0.3), "youngs_modulus_pa: 0.3 is below .*0.3 MPa"),
        (lambda: Eye(stiffening=-0.1), "stiffening: -0.1; give 0 or more"),
        (lambda: Eye(modulus=3e5), "modulus: found float 300000.0; give a Modulus"),
        (lambda: Eye(globe="open"), "globe: found str 'open'; give a Globe"),
        (lambda: Eye(5), "name: found int 5; give a str"),
        (lambda: Eye(iop_pa="2000"), "iop_pa: found str '2000'; give a number"),
        (lambda: Eye(iop_pa=True), "iop_pa: found bool True; give a number"),
        (lambda: Eye(thickness_m=np.float32(650.0)), "thickness_m: 650 is above"),
    ],
)
def test_values_of_another_kind_are_refused_with_their_field(
    make: Callable[[], object], words: str
) -> None:
    with pytest.raises(StudyError, match=f"^{words}"):
        make()


def test_a_number_of_numpy_is_a_number() -> None:
    eye = Eye(iop_pa=np.float64(266.0), thickness_m=np.float32(6e-4))
    assert eye.iop_pa == 266.0
