"""Calibration files: what is read of them, and what is refused by its place."""

import hashlib
import json
import re
from dataclasses import asdict, astuple, replace

import pytest
from small_recordings import calibration_text

from scleraforce.base.errors import CalibrationError
from scleraforce.base.normal_distribution import MOST_CORRELATED
from scleraforce.records.calibration_file import (
    globe_entry,
    known_of_eye,
    read_calibration,
)
from scleraforce.records.eye import ForceDiscrepancy
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import HoldFinding, Relaxation

DIVERGED = "diverged: by 4 sd"
POPULATION = {"mean_mpa": 0.27, "sd_mpa": 0.03}


def read(folder, eyes=None, **keys):
    file = folder / "calibration.json"
    file.write_text(calibration_text(0.27, eyes, **keys))
    return read_calibration(file)


def refusal(file, text):
    """The one line that refuses a file of this text, after the file's name."""
    file.write_text(text, encoding="latin-1")
    with pytest.raises(CalibrationError, match=re.escape(f"{file}: ")) as fault:
        read_calibration(file)
    assert "\n" not in str(fault.value)
    return str(fault.value).removeprefix(f"{file}: ")


def test_eyes_population_and_provenance_are_read(tmp_path):
    frames = [{"file": f"{n}.png", "sha256": f"{n}f"} for n in range(3)]
    eyes = {
        "a": {"frames": frames[:2], "mean_mpa": 0.31},
        "b": {"frames": frames[2:], "status": DIVERGED},
    }
    found = read(tmp_path, eyes)
    file = tmp_path / "calibration.json"
    assert found.population_mean_pa == pytest.approx(0.27e6)
    assert found.population_sd_pa == pytest.approx(0.03e6)
    eye = found.eyes["a"].eye
    assert (eye.modulus.mean_pa, eye.modulus.sd_pa) == pytest.approx((0.31e6, 5e3))
    assert (eye.modulus.source, eye.thickness_m) == ("own", pytest.approx(0.7e-3))
    assert [each.usable for each in found.eyes.values()] == [True, False]
    assert found.eyes["b"].frames[0].file == "2.png"
    assert found.digests == {"0f", "1f", "2f"}
    assert (found.mechanics, found.path) == ("finite-strain", str(file))
    assert found.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON: "),
        ("\xff", "not JSON: "),
        (calibration_text(float("nan")), "not JSON: "),
        (calibration_text().replace("0.27", "1e999"), "not JSON: "),
        (calibration_text().replace("0.27", "9" * 5000), "not JSON: "),
        ("[" * 100_000, "not JSON: "),
        (calibration_text().replace("{", '{"format": 3, ', 1), "not JSON: "),
        ("[]", "format: "),
        ("{}", "format: "),
        (calibration_text(format=2), "format: "),
        (calibration_text(mechanics="magic"), "mechanics: "),
        (calibration_text(mechanics=["linear"]), "mechanics: "),
        (calibration_text(eyes={"a\nb": {}}), "eyes: "),
        (calibration_text(eyes={"\ud800": {}}), "eyes: "),
    ],
    ids=range(14),
)
def test_a_file_that_is_not_json_or_of_another_format_is_refused(tmp_path, text, said):
    assert refusal(tmp_path / "calibration.json", text).startswith(said)


DISCREPANCY = {
    "level": 0.02,
    "growth": 0.4,
    "level_sd": 0.01,
    "growth_sd": 0.05,
    "correlation": -0.3,
}
CALIBRATED = replace(SEALED, mean=1.3e8, sd=4e6, correlation=-0.4, calibrated=True)
RELAXATION = asdict(Relaxation.declared([[0.1, 1.0], [0.05, 10.0]]))
ENTRY = {
    "frames": [{"file": "1.png", "sha256": "1f"}],
    "discrepancy": DISCREPANCY,
    "globe": globe_entry(CALIBRATED),
    "stiffening": 2.0,
    "relaxation": RELAXATION,
}
K = "rigidity_mmhg13_per_ul"


def with_value(place, value):
    """Return a whole file but for one value; `...`: without it."""
    content = json.loads(calibration_text(0.27, {"x": ENTRY}, population=POPULATION))
    *parents, last = place.replace("[0]", ".0").split(".")
    table = content
    for key in parents:
        table = table[int(key) if key.isdigit() else key]

    if value is ...:
        del table[last]
    else:
        table[int(last) if last.isdigit() else last] = value
    return json.dumps(content)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("population", 3),
        ("population", None),
        ("population.mean_mpa", ...),
        ("population.mean_mpa", "stiff"),
        ("population.mean_mpa", True),
        ("population.mean_mpa", -1),
        ("population.sd_mpa", ...),
        ("population.sd_mpa", -1),
        ("population.stiffening", 200.1),
        ("eyes", []),
        ("eyes.x", []),
        ("eyes.x.frames", "1.png"),
        ("eyes.x.frames[0]", "1.png"),
        ("eyes.x.frames[0].sha256", ...),
        ("eyes.x.frames[0].file", "1\n"),
        ("eyes.x.mean_mpa", None),
        ("eyes.x.mean_mpa", 1e300),
        ("eyes.x.sd_mpa", -1),
        ("eyes.x.thickness_um", 0),
        ("eyes.x.status", 0),
        ("eyes.x.status", "a\u2028b"),
        ("eyes.x.stiffening", -0.1),
        ("eyes.x.stiffening", None),
        ("eyes.x.stiffening", [1.0]),
        ("eyes.x.discrepancy", 3),
        ("eyes.x.discrepancy.growth", "steep"),
        ("eyes.x.discrepancy.growth", 3.0),
        ("eyes.x.discrepancy.level", None),
        ("eyes.x.discrepancy.level_sd", -0.1),
        ("eyes.x.discrepancy.growth_sd", 2.1),
        ("eyes.x.discrepancy.correlation", 1.0),
        ("eyes.x.discrepancy.largest_n", 31.0),
        ("eyes.x.discrepancy.widest_gap", 1.5),
        ("eyes.x.discrepancy.level_by", [0.1]),
        ("eyes.x.discrepancy.growth_by", [3.0, 0.0]),
        ("eyes.x.discrepancy.scatter", -0.1),
        ("eyes.x.globe", None),
        ("eyes.x.globe.kind", "shut"),
        ("eyes.x.globe.kind", ["open"]),
        ("eyes.x.globe.rigidity_law", "linear"),
        ("eyes.x.globe.calibrated", 1),
        ("eyes.x.globe.rigidity_told", 0),
        (f"eyes.x.globe.{K}", 0.03),
        *(
            (f"eyes.x.globe.{K}.{name}", value)
            for name in ("lowest", "highest", "mean", "sd")
            for value in (None, ...)
        ),
        (f"eyes.x.globe.{K}.mean", -3.0),
        (f"eyes.x.globe.{K}.sd", -0.1),
        (f"eyes.x.globe.{K}.lowest", -0.01),
        (f"eyes.x.globe.{K}.highest", 1e9),
        ("eyes.x.globe.correlation", 1.0),
        ("eyes.x.globe.correlation", True),
        ("eyes.x.relaxation.covariance", [[-1e-4, 0.0], [0.0, 1e-4]]),
        ("eyes.x.relaxation.covariance", [[1.0, 2.0], [2.0, 1.0]]),
        ("eyes.x.relaxation.held_covariance", [[1.0, 0.1], [0.2, 1.0]]),
        ("eyes.x.relaxation.before_covariance_n2", [[-1.0, 0], [0, 0]]),
        ("eyes.x.relaxation.after_covariance_n2", [[0, 1e-9], [1e-9, 0]]),
        ("eyes.x.relaxation.shares", [0.6, 0.5]),
        ("eyes.x.relaxation.shares", [0.6]),
        ("eyes.x.relaxation.times_s", [0.0, 1.0]),
    ],
)
def test_a_key_that_is_missing_or_cannot_be_is_refused_by_its_place(
    tmp_path, place, value
):
    said = refusal(tmp_path / "calibration.json", with_value(place, value))
    assert said.startswith(f"{place}: {'missing' if value is ... else ''}")


@pytest.mark.parametrize(
    ("place", "value", "named"),
    [
        (f"globe.{K}.sd", 0.0, f"globe.{K}"),
        (f"globe.{K}.lowest", 0.07, f"globe.{K}"),
        ("relaxation.held_covariance", [[1.0], [0.1]], "relaxation.held"),
        ("relaxation.other", [0.1], "relaxation"),
        ("relaxation.other", [0.6, 0.6], "relaxation"),
    ],
)
def test_numbers_that_do_not_go_together_are_refused_by_their_place(
    tmp_path, place, value, named
):
    said = refusal(tmp_path / "c.json", with_value(f"eyes.x.{place}", value))
    assert said.startswith(f"eyes.x.{named}")


def test_a_refusal_names_the_value_and_the_unit_that_may_be_meant(tmp_path):
    said = refusal(tmp_path / "c.json", calibration_text(270.0))
    assert said.startswith("population.mean_mpa: 270 is above")
    assert "did you mean 0.27 MPa (270 kPa)" in said
    with pytest.raises(CalibrationError, match=r"nothing\.json: No such file"):
        read_calibration(tmp_path / "nothing.json")


@pytest.mark.parametrize(
    "globe",
    [
        OPEN,
        UNKNOWN,
        Globe.declared("sealed", 1e8, "logarithmic"),
        CALIBRATED,
        replace(UNKNOWN, mean=-1e5, sd=1e6, correlation=0.7, calibrated=True),
        replace(SEALED, correlation=-MOST_CORRELATED, calibrated=True),
    ],
)
def test_a_globe_is_read_as_it_was_written_with_its_band_for_people(tmp_path, globe):
    entry = globe_entry(globe)
    found = read(tmp_path, {"a": {"globe": entry}, "early": {}}).eyes
    assert found["early"].eye.globe is OPEN
    for value, wanted in zip(
        astuple(found["a"].eye.globe), astuple(globe), strict=True
    ):
        assert value == (wanted if isinstance(wanted, str) else pytest.approx(wanted))
    assert 0.0 <= entry[K]["low"] <= entry[K]["high"] <= 0.06


def test_stiffening_and_discrepancy_go_with_the_modulus_that_an_eye_has(tmp_path):
    found = DISCREPANCY | {"largest_n": 31e-3}
    eyes = {
        "a": {"stiffening": 12.5, "discrepancy": found},
        "b": {},
        "c": {"stiffening": 3.0, "discrepancy": DISCREPANCY, "status": DIVERGED},
    }
    population = {"mean_mpa": 0.27, "sd_mpa": None, "stiffening": 6.0}
    summary = read(tmp_path, eyes, population=population)
    assert [summary.eyes[eye].eye.stiffening for eye in "abc"] == [12.5, 0.0, 3.0]
    assert summary.eyes["a"].eye.discrepancy == ForceDiscrepancy(**found)
    assert (summary.population_stiffening, summary.population_sd_pa) == (6.0, None)
    known = [known_of_eye(Setup(), summary, eye).eye for eye in (*"abc", "stranger")]
    assert [eye.stiffening for eye in known] == [12.5, 0.0, None, 6.0]
    discrepancies = [ForceDiscrepancy(**found), None, None, None]
    assert [eye.discrepancy for eye in known] == discrepancies


def test_a_relaxation_of_an_early_file_has_no_finding(tmp_path):
    found = asdict(Relaxation.declared([(0.12, 1.2)])) | {"source": "holds"}
    early = {name: found[name] for name in found if name not in ("other", "finding")}
    relaxation = read(tmp_path, {"a": {"relaxation": early}}).eyes["a"].eye.relaxation
    assert (relaxation.shares, relaxation.other) == ((0.12,), ())
    assert relaxation.finding is None


def test_what_the_holds_have_shown_comes_back_from_a_file(tmp_path):
    finding = HoldFinding(
        cause="undecided", hold_s=7.1, fall=0.12, chance=0.25, not_estimated_s=(30.0,)
    )
    written = replace(
        Relaxation.declared([(0.0, 1.2)]),
        source="holds",
        other=(0.12,),
        finding=finding,
    )
    summary = read(tmp_path, {name: {"relaxation": asdict(written)} for name in "ab"})
    assert summary.eyes["a"].eye.relaxation == written
    stranger = known_of_eye(Setup(), summary, "stranger").eye.relaxation
    assert stranger.other == pytest.approx((0.12,))
