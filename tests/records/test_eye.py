"""An eye: its declared values and a calibration's, the discrepancy of its forces."""

from dataclasses import dataclass, replace
from math import nan

import numpy as np
import pytest
from small_recordings import calibration_text

from scleraforce.base.errors import StudyError
from scleraforce.base.normal_distribution import MOST_CORRELATED
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.records.calibration_file import (
    foreign_modulus,
    globe_entry,
    known_of_eye,
    read_calibration,
)
from scleraforce.records.decoder import parse_record
from scleraforce.records.eye import NO_DISCREPANCY, Eye, ForceDiscrepancy, Modulus
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
DIVERGED = {"mean_mpa": 0.1, "status": "diverged: by 4 sd"}
EYES = {
    "mine": {"mean_mpa": 0.3, "sd_mpa": 0.004, "globe": globe_entry(CALIBRATED)},
    "lost": DIVERGED,
    "contradicted": {**DIVERGED, "globe": globe_entry(UNKNOWN)},
    "undeclared": {"globe": globe_entry(FOUND)},
}


@pytest.fixture
def calibrated(tmp_path):
    """What is known of an eye, by its name, once eyes were calibrated."""

    def known(name, eyes, sd_mpa=0.05, **declared):
        population = {"mean_mpa": 0.25, "sd_mpa": sd_mpa}
        file = tmp_path / "calibration.json"
        file.write_text(calibration_text(0.25, eyes, population=population))
        summary = read_calibration(file)
        eye = known_of_eye(Setup(eye=Eye(**declared)), summary, name).eye
        return eye, foreign_modulus(summary, name)

    return known


def test_an_eye_has_its_own_modulus_and_another_that_of_its_population_with_its_spread(
    calibrated,
):
    own, said = calibrated("mine", EYES)
    assert own.modulus == Modulus(mean_pa=0.3e6, sd_pa=4e3, source="own")
    assert said is None
    other, said = calibrated("stranger", EYES)
    assert other.modulus == Modulus(mean_pa=0.25e6, sd_pa=0.05e6, source="population")
    assert said.endswith("read with the population's modulus, 0.25 MPa +- 20 %")


def test_an_eye_whose_calibration_diverged_is_read_as_one_of_unknown_modulus_or_globe_and_a_sentence_says_so(
    calibrated,
):
    declared = {"iop_pa": 270.0, "thickness_m": 0.6e-3, "globe": OPEN}
    lost, said = calibrated("lost", EYES, **declared)
    assert lost == Eye(**declared)
    assert said.startswith("lost is not usable (diverged: by 4 sd) in ")
    assert "4 eyes (mine, lost, contradicted, undeclared)" in said
    contradicted, said = calibrated("contradicted", EYES, **declared)
    assert contradicted == Eye(**declared | {"globe": None})
    assert said.endswith("unknown modulus in an unknown globe")


@pytest.mark.parametrize("declared", [None, SEALED])
def test_an_eye_takes_the_globe_that_its_calibration_found_unless_another_kind_is_declared(
    calibrated, declared
):
    for name, found in (("mine", CALIBRATED), ("undeclared", FOUND)):
        globe = calibrated(name, EYES, globe=declared)[0].globe
        assert (globe.kind, globe.calibrated) == (found.kind, True)
        assert globe.correlation == found.correlation
        assert (globe.mean, globe.sd) == pytest.approx((found.mean, found.sd))

    assert calibrated("stranger", EYES, globe=declared)[0].globe is declared
    assert calibrated("mine", EYES, globe=OPEN)[0].globe is OPEN


@pytest.mark.parametrize(
    ("sd_mpa", "spread"),
    # one eye says nothing of the spread
    [(0.0, 0.12), (None, 0.12 * 2**0.5)],
)
def test_an_eye_of_the_population_has_at_least_the_spread_of_eyes(
    calibrated, sd_mpa, spread
):
    modulus = calibrated("stranger", {"mine": {}}, sd_mpa)[0].modulus
    assert modulus.relative_sd == pytest.approx(spread)


def test_no_modulus_is_that_of_a_population_whose_eyes_all_diverged(calibrated):
    assert calibrated("stranger", {"lost": DIVERGED})[0].modulus is None


@pytest.mark.parametrize(
    ("other", "lean_rad"), [({"lean_deg": 30.0}, np.radians(25.0)), ({}, None)]
)
def test_an_eye_of_the_population_leans_as_the_calibrated_ones_if_all_of_them_state_it(
    calibrated, other, lean_rad
):
    eyes = {"a": {"lean_deg": 20.0}, "b": other}
    found = calibrated("stranger", eyes)[0].calibrated_lean_rad
    assert found == (lean_rad and pytest.approx(lean_rad))


LIBRARY_N = np.array([0.0, 5e-3, 30e-3, 55e-3])
STIFFENING = ForceDiscrepancy(
    level=0.05, growth=0.4, level_sd=0.02, growth_sd=0.1, correlation=-0.6
)


def test_forces_grow_by_level_and_growth_and_beyond_the_range_by_no_more():
    np.testing.assert_array_equal(NO_DISCREPANCY.corrected_n(LIBRARY_N), LIBRARY_N)
    expected = LIBRARY_N * np.exp(0.05 + 0.4 * (LIBRARY_N / 60e-3 - 0.5))
    np.testing.assert_allclose(STIFFENING.corrected_n(LIBRARY_N), expected)
    beyond_n = STIFFENING.corrected_n(np.array([90e-3]))
    assert beyond_n[0] == pytest.approx(90e-3 * np.exp(0.05 + 0.2))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_most_correlated_eye_has_a_prior_to_draw_from(sign):
    own = Modulus(mean_pa=0.3e6, sd_pa=3e3, source="own")
    globe = replace(SEALED, correlation=sign * MOST_CORRELATED, calibrated=True)
    prior = prior_of(Setup(eye=Eye(modulus=own, globe=globe)), ReaderStudy())
    drawn = np.linalg.inv(np.linalg.cholesky(prior.calibrated))
    assert drawn.max() == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"iop_pa": -1.0}, "iop_pa: -1 is below the smallest allowed value 0"),
        ({"iop_pa": nan}, "iop_pa: nan is not a finite number"),
        ({"iop_pa": "2000"}, "iop_pa: found str '2000'; give a number"),
        ({"iop_pa": True}, "iop_pa: found bool True; give a number"),
        ({"iop_pa": 2e3, "iop_sd_pa": 16e3}, "iop_sd_pa: 16000 is above .* 15000"),
        ({"thickness_m": 0.6}, "thickness_m: 0.6 is .*; did you mean 0.0006 m"),
        ({"thickness_m": np.float32(650.0)}, "thickness_m: 650 is above"),
        (
            {"thickness_m": 6e-4, "thickness_sd_m": 0.0},
            "thickness_sd_m: 0 is below .* 1e-07",
        ),
        ({"radius_m": 2e-3}, "radius_m: 0.002 is below .* 0.003"),
        ({"radius_m": 0.01, "radius_sd_m": 0.011}, "radius_sd_m: 0.011 is above"),
        ({"stiffening": nan}, "stiffening: nan is not a finite number"),
        ({"stiffening": -0.1}, "stiffening: -0.1; give 0 or more"),
        ({"modulus": 3e5}, "modulus: found float 300000.0; give a Modulus"),
        ({"globe": "open"}, "globe: found str 'open'; give a Globe"),
        ({"name": 5}, "name: found int 5; give a str"),
        ({"name": " "}, "name: empty; give the eye a name"),
        ({"name": "a\nb"}, "name: .* has a line break"),
        ({"name": "e" * 300}, "name: 300 characters"),
        ({"iop_sd_pa": 50.0}, "iop_sd_pa: the uncertainty of iop_pa, which is missing"),
        ({"thickness_sd_m": 1e-4}, "thickness_sd_m: the uncertainty of thickness_m"),
        ({"radius_sd_m": 1e-4}, "radius_sd_m: the uncertainty of radius_m"),
    ],
)
def test_a_value_of_an_eye_that_cannot_be_is_refused(values, said):
    with pytest.raises(StudyError, match=f"^{said}"):
        Eye(**values)


@pytest.mark.parametrize(
    ("mean_pa", "sd_pa", "source", "said"),
    [
        (nan, 1e3, "own", "modulus: nan ± 1000"),
        (1e5, -1.0, "own", "modulus: 100000.0 ±"),
        (1e5, 1.0, "mine", "modulus: source: "),
    ],
)
def test_a_modulus_that_cannot_be_is_refused(mean_pa, sd_pa, source, said):
    with pytest.raises(StudyError, match=f"^{said}"):
        Modulus(mean_pa=mean_pa, sd_pa=sd_pa, source=source)


def test_a_stated_modulus_of_another_unit_is_refused():
    with pytest.raises(StudyError, match=r"^youngs_modulus_pa: 0.3 is below .*0.3 MPa"):
        Modulus.stated(0.3)


@dataclass(frozen=True)
class EyeFile:
    """A file that has an eye alone."""

    eye: Eye


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("id = 'e'\niop_sd_pa = 50.0", "3: eye.iop_sd_pa: the uncertainty of iop_pa"),
        ("id = 'e'\nage = 1", "3: eye.age: unknown key; known here: id, thickness_m"),
        # what only a calibration finds
        ("id = 'e'\nmodulus = 1", "3: eye.modulus: unknown key"),
        ("iop_pa = 2000.0", "1: eye.id: missing"),
    ],
)
def test_a_fault_in_a_file_is_named_with_its_line(lines, said):
    with pytest.raises(StudyError, match=f"^r.toml:{said}"):
        parse_record(EyeFile, f"[eye]\n{lines}\n", "r.toml")


def test_what_was_declared_of_an_eye_has_no_finding_of_a_calibration():
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
