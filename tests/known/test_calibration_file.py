import hashlib
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import pytest
from small_recordings import calibration_text

from scleraforce.errors import CalibrationError
from scleraforce.known import OPEN, SEALED, UNKNOWN, ForceDiscrepancy, Known, KnownGlobe, known_globe
from scleraforce.known.calibration_file import globe_entry, known_of_eye, read_calibration

EYES = {
    "a": {"frames": [{"file": "1.png", "sha256": "1f"}, {"file": "2.png", "sha256": "2f"}], "mean_mpa": 0.31},
    "b": {"status": "diverged: by 4 sd", "frames": [{"file": "1.png", "sha256": "3f"}]},
}


def test_eyes_population_and_provenance_are_read(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.27, EYES))
    found = read_calibration(file)
    assert (found.population_mean_pa, found.population_sd_pa) == pytest.approx((0.27e6, 0.03e6))
    assert found.eyes["a"].mean_pa == pytest.approx(0.31e6)
    assert found.eyes["a"].sd_pa == pytest.approx(5e3)
    assert found.eyes["a"].thickness_m == pytest.approx(0.7e-3)
    assert [eye.usable for eye in found.eyes.values()] == [True, False]
    assert found.digests == {"1f", "2f", "3f"}
    assert found.eyes["b"].frames[0].file == "1.png"
    assert (found.mechanics, found.path) == ("finite-strain", str(file))
    assert found.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


def refusal(file: Path, text: str) -> str:
    """The one line that refuses a file of this text, after the file's name."""
    file.write_text(text, encoding="latin-1")
    with pytest.raises(CalibrationError) as fault:
        read_calibration(file)
    assert str(fault.value).startswith(f"{file}: ")
    assert "\n" not in str(fault.value)
    return str(fault.value).removeprefix(f"{file}: ")


def test_a_file_that_is_not_json_or_of_another_format_is_refused(tmp_path: Path) -> None:
    whole, broken = calibration_text(), tmp_path / "calibration.json"
    for text in (
        "{", "\xff", calibration_text(float("nan")), calibration_text(float("inf")), whole.replace("0.27", "1e999"),
        whole.replace("0.27", "9" * 5000), "[" * 100_000, whole.replace('"population"', '"format": 3, "population"'),
    ):  # fmt: skip
        assert refusal(broken, text).startswith("not JSON: ")
    for text in ("[]", "{}", calibration_text(format=1), calibration_text(format=2)):
        assert refusal(broken, text).startswith("format: ")
    for mechanics in ("magic", ["linear"], None):
        assert refusal(broken, calibration_text(mechanics=mechanics)).startswith("mechanics: ")
    for eye in ("a\nb", "\ud800"):
        assert refusal(broken, calibration_text(0.2, {eye: {}})).startswith("eyes: ")


def test_a_key_that_is_missing_or_cannot_be_is_refused_by_its_place(tmp_path: Path) -> None:
    whole, broken = calibration_text(), tmp_path / "calibration.json"
    for population, key in (
        ({}, ".mean_mpa"), (3, ": "), (None, ": "), ({"mean_mpa": 0.2}, ".sd_mpa"),
        ({"mean_mpa": "stiff"}, ".mean_mpa"), ({"mean_mpa": True}, ".mean_mpa"), ({"mean_mpa": -1}, ".mean_mpa"),
        ({"mean_mpa": 0.2, "sd_mpa": "x"}, ".sd_mpa"), ({"mean_mpa": 0.2, "sd_mpa": -1}, ".sd_mpa"),
    ):  # fmt: skip
        assert refusal(broken, calibration_text(population=population)).startswith(f"population{key}")
    for eyes, place in (("[]", "eyes: "), ('{"x": []}', "eyes")):
        assert refusal(broken, whole.replace('"eyes": {}', f'"eyes": {eyes}')).startswith(place)
    for entry, key in (
        ({"frames": "1.png"}, "frames"), ({"frames": ["1.png"]}, "frames[0]"),
        ({"frames": [{"file": "1.png"}]}, "frames[0].sha256"),
        ({"frames": [{"file": "1\n", "sha256": ""}]}, "frames[0].file"),
        ({"mean_mpa": None}, "mean_mpa"), ({"mean_mpa": 1e300}, "mean_mpa"), ({"sd_mpa": -1}, "sd_mpa"),
        ({"thickness_um": 0}, "thickness_um"), ({"status": 0}, "status"), ({"status": "a\u2028b"}, "status"),
        ({"discrepancy": 3}, "discrepancy"), ({"globe": None}, "globe"), ({"globe": []}, "globe"),
    ):  # fmt: skip
        assert refusal(broken, calibration_text(0.2, {"x": entry})).startswith(f"eyes.x.{key}")
    for value in (-0.1, 200.1, "stiff", True, None, [1.0]):
        assert refusal(broken, calibration_text(0.27, {"x": {"stiffening": value}})).startswith("eyes.x.stiffening: ")
        population = {"mean_mpa": 0.27, "sd_mpa": 0.03, "stiffening": value}
        assert refusal(broken, calibration_text(0.27, population=population)).startswith("population.stiffening: ")


def test_a_refusal_says_what_was_found_and_the_unit_that_may_be_meant(tmp_path: Path) -> None:
    said = refusal(tmp_path / "c.json", calibration_text(270.0))
    assert "found 270.0" in said
    assert "did you mean 0.27 MPa" in said
    assert "scleraforce calibrate" in said


GLOBES = {
    "open": OPEN,
    "unknown": UNKNOWN,
    "stated": known_globe("sealed", 1e8, "logarithmic"),
    "calibrated": replace(SEALED, mean=1.3e8, sd=4e6, correlation=-0.4, calibrated=True),
    "nearly open": replace(UNKNOWN, mean=-1e5, sd=1e6, correlation=0.7, calibrated=True),
}


@pytest.mark.parametrize("globe", GLOBES.values(), ids=GLOBES)
def test_a_globe_is_read_as_it_was_written_with_its_band_for_people(tmp_path: Path, globe: KnownGlobe) -> None:
    file, entry = tmp_path / "calibration.json", globe_entry(globe)
    file.write_text(calibration_text(0.27, {"a": {"globe": entry}}))
    found = read_calibration(file).eyes["a"].globe
    assert [value if isinstance(value, str | bool) else pytest.approx(value) for value in astuple(globe)] == list(
        astuple(found)
    )
    low, high = (entry["rigidity_mmhg13_per_ul"][end] for end in ("low", "high"))
    assert 0.0 <= low <= high <= 0.06


def test_an_eye_without_a_globe_was_calibrated_as_an_open_one(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.27, {"a": {}}))
    assert read_calibration(file).eyes["a"].globe is OPEN


K = "rigidity_mmhg13_per_ul"


def test_a_globe_that_cannot_be_is_refused_with_its_key(tmp_path: Path) -> None:
    cases: list[tuple[str, Any]] = [
        ("kind", "shut"), ("kind", ["open"]), ("rigidity_law", "linear"), ("calibrated", 1), ("rigidity_told", 0),
        (K, 0.03), (f"{K}.mean", "stiff"), (f"{K}.mean", -3.0), (f"{K}.sd", -0.1), (f"{K}.lowest", -0.01),
        (f"{K}.highest", 1e9), ("correlation", 1.0), ("correlation", True),
    ]  # fmt: skip
    cases += [(f"{K}.{name}", None) for name in ("lowest", "highest", "mean", "sd")]
    for place, value in cases:
        globe = globe_entry(GLOBES["calibrated"])
        *parents, last = place.split(".")
        target = globe[parents[0]] if parents else globe
        assert last in target
        target[last] = value
        text = calibration_text(0.27, {"a": {"globe": globe}})
        assert refusal(tmp_path / "c.json", text).startswith(f"eyes.a.globe.{place}"), place
    for changed in ({"sd": 0.0}, {"lowest": 0.07}):  # each number can be, not all together
        globe = globe_entry(GLOBES["calibrated"])
        globe[K] |= changed
        text = calibration_text(0.27, {"a": {"globe": globe}})
        assert refusal(tmp_path / "c.json", text).startswith(f"eyes.a.globe.{K}: ")


@pytest.mark.parametrize("name", ["lowest", "highest", "mean", "sd"])
def test_a_globe_that_lacks_a_number_is_refused(tmp_path: Path, name: str) -> None:
    entry = globe_entry(GLOBES["calibrated"])
    del entry[K][name]
    text = calibration_text(0.27, {"a": {"globe": entry}})
    assert refusal(tmp_path / "c.json", text).startswith(f"eyes.a.globe.{K}.{name} is missing")


def test_a_population_of_one_eye_has_no_spread(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(population={"mean_mpa": 0.27, "sd_mpa": None}))
    assert read_calibration(file).population_sd_pa is None


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"nothing\.json: No such file"):
        read_calibration(tmp_path / "nothing.json")


def test_the_stiffening_of_eyes_and_of_their_population_is_read_and_goes_with_the_modulus(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    eyes = {"a": {"stiffening": 12.5}, "b": {}, "c": {"stiffening": 3.0, "status": "diverged: by 4 sd"}}
    population = {"mean_mpa": 0.27, "sd_mpa": 0.03, "stiffening": 6.0}
    file.write_text(calibration_text(0.27, eyes, population=population))
    summary = read_calibration(file)
    assert [summary.eyes[eye].stiffening for eye in "abc"] == [12.5, 0.0, 3.0]
    assert summary.population_stiffening == 6.0
    assert known_of_eye(Known(stiffening=1.0), summary, "a").stiffening == 12.5
    assert known_of_eye(Known(stiffening=1.0), summary, "b").stiffening == 0.0
    assert known_of_eye(Known(stiffening=1.0), summary, "stranger").stiffening == 6.0
    assert known_of_eye(Known(), summary, "c").stiffening is None  # nor is its modulus known


DISCREPANCY = {"level": 0.02, "growth": 0.4, "level_sd": 0.01, "growth_sd": 0.05, "correlation": -0.3}


def test_the_discrepancy_of_the_forces_goes_with_an_eye_s_own_modulus_alone(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    diverged = {"discrepancy": DISCREPANCY, "status": "diverged: by 4 sd"}
    file.write_text(calibration_text(0.27, {"a": {"discrepancy": DISCREPANCY}, "b": {}, "c": diverged}))
    summary = read_calibration(file)
    assert summary.eyes["a"].discrepancy == ForceDiscrepancy(**DISCREPANCY)
    assert known_of_eye(Known(), summary, "a").discrepancy == ForceDiscrepancy(**DISCREPANCY)
    assert [known_of_eye(Known(), summary, eye).discrepancy for eye in ("b", "c", "stranger")] == [None] * 3


def test_the_largest_force_that_an_eye_was_calibrated_on_is_read_where_a_file_has_it(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    entries = {"a": {"largest_n": 31e-3}, "b": {"largest_n": None}, "c": {}}
    file.write_text(calibration_text(0.27, {eye: {"discrepancy": DISCREPANCY | more} for eye, more in entries.items()}))
    found = [eye.discrepancy for eye in read_calibration(file).eyes.values()]
    assert [None if one is None else one.largest_n for one in found] == [31e-3, None, None]


def test_a_discrepancy_that_cannot_be_is_refused_with_its_key(tmp_path: Path) -> None:
    for key, value in (
        ("growth", "steep"), ("growth", 3.0), ("level", None), ("level_sd", -0.1), ("growth_sd", 2.1),
        ("correlation", 1.0), ("largest_n", 31.0), ("widest_gap", 1.5), ("level_by", [0.1]), ("growth_by", [3.0, 0.0]),
        ("scatter", -0.1),
    ):  # fmt: skip
        text = calibration_text(0.27, {"a": {"discrepancy": {**DISCREPANCY, key: value}}})
        assert refusal(tmp_path / "c.json", text).startswith(f"eyes.a.discrepancy.{key}")
