import hashlib
import json
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import pytest
from calibration_file import calibration_text

from scleraforce.errors import CalibrationError
from scleraforce.known.calibration_file import globe_entry, known_of_eye, read_calibration, summary_of_eye
from scleraforce.known.eye import OPEN, SEALED, UNKNOWN, ForceDiscrepancy, Known, KnownGlobe, known_globe

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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("\xff", "not JSON"),
        ("[]", "format: expected"),
        ("{}", "format: expected"),
        (calibration_text(format=1), "format: expected"),
        (calibration_text(mechanics="magic"), "mechanics: expected .*'magic'"),
        (calibration_text(population={}), "population.mean_mpa is missing"),
        (calibration_text(population=3), "population: missing"),
        (calibration_text(population={"mean_mpa": 0.2}), "population.sd_mpa is missing"),
        (calibration_text("stiff"), "population.mean_mpa: expected a number"),
        (calibration_text(True), "population.mean_mpa: expected a number"),
        (calibration_text(float("nan")), "not JSON: NaN is no number"),
        (calibration_text(float("inf")), "not JSON: Infinity is no number"),
        (calibration_text().replace("0.27", "1e999"), "not JSON: 1e999 is too large"),
        (calibration_text().replace("0.27", "9" * 5000), "not JSON: 9{20}... has 5000 digits"),
        ("[" * 100_000, "not JSON: nested too deep"),
        (calibration_text().replace('"population"', '"format": 3, "population"'), "'format' stands twice"),
        (calibration_text(format=2), "expected a JSON object with format 3, found 2; .* of this version"),
        (calibration_text(mechanics=["linear"]), "mechanics: expected"),
        (calibration_text(0.2, {"a\nb": {}}), "eyes: 'a.*line break"),
        (calibration_text(0.2, {"\ud800": {}}), "eyes: .*unprintable"),
        (calibration_text(-1), "not between"),
        (calibration_text(270000), "not between"),
        (calibration_text().replace('"eyes": {}', '"eyes": []'), "eyes: missing"),
        (calibration_text().replace('"eyes": {}', '"eyes": {"x": []}'), "eyes.x: expected"),
        (calibration_text(0.2, {"x": {"frames": "1.png"}}), "eyes.x.frames"),
        (calibration_text(0.2, {"x": {"frames": ["1.png"]}}), r"eyes.x.frames\[0\]: expected an object"),
        (calibration_text(0.2, {"x": {"frames": [{"file": "1.png"}]}}), r"eyes.x.frames\[0\].sha256: expected a text"),
        (calibration_text(0.2, {"x": {"mean_mpa": None}}), "eyes.x.mean_mpa: expected a number"),
        (calibration_text(0.2, {"x": {"sd_mpa": -1}}), "eyes.x.sd_mpa: -1 is not between"),
        (calibration_text(0.2, {"x": {"thickness_um": 0}}), "eyes.x.thickness_um: 0 is not between"),
        (calibration_text(0.2, {"x": {"status": 0}}), "eyes.x.status"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_by_name_and_key(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(text, encoding="latin-1")
    with pytest.raises(CalibrationError, match=message) as fault:
        read_calibration(file)
    assert str(file) in str(fault.value)


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


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ([], None, "globe: missing"),
        ([], [], "globe: missing, or no object"),
        (["kind"], "shut", "globe: kind, rigidity_law, calibrated or rigidity_told"),
        (["kind"], ["open"], "globe: kind, rigidity_law, calibrated or rigidity_told"),
        (["rigidity_law"], "linear", "globe: kind, rigidity_law, calibrated or rigidity_told"),
        (["calibrated"], 1, "globe: kind, rigidity_law, calibrated or rigidity_told"),
        ([K], 0.03, f"globe: {K}: missing"),
        ([K, "mean"], "stiff", f"globe.{K}.mean: expected a number"),
        ([K, "mean"], -3.0, f"globe.{K}.mean: -3 is not between"),
        ([K, "sd"], -0.1, f"globe.{K}.sd: -0.1 is not between"),
        ([K, "sd"], 0.0, f"globe.{K}: .* sd not above 0"),
        ([K, "lowest"], 0.07, f"globe.{K}: lowest above highest"),
        ([K, "lowest"], -0.01, f"globe.{K}.lowest: -0.01 is not between"),
        ([K, "highest"], 1e9, f"globe.{K}.highest: 1e\\+09 is not between"),
        (["correlation"], 1.0, "globe.correlation: 1 is not between"),
        (["correlation"], True, "globe.correlation: expected a number"),
    ],
)
def test_a_globe_that_cannot_be_is_refused_in_one_line_with_its_key(
    tmp_path: Path, path: list[str], value: Any, message: str
) -> None:
    file, entry = tmp_path / "calibration.json", {"globe": globe_entry(GLOBES["calibrated"])}
    target: Any = entry
    *parents, last = ["globe", *path]
    for parent in parents:
        target = target[parent]
    assert last in target
    target[last] = value
    file.write_text(calibration_text(0.27, {"a": entry}))
    with pytest.raises(CalibrationError, match=rf"eyes\.a(\.|: ){message}") as fault:
        read_calibration(file)
    assert str(fault.value).startswith(f"{file}: eyes.a")
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize("name", ["lowest", "highest", "mean", "sd"])
def test_a_globe_that_lacks_a_number_is_refused(tmp_path: Path, name: str) -> None:
    file, entry = tmp_path / "calibration.json", globe_entry(GLOBES["calibrated"])
    del entry[K][name]
    file.write_text(calibration_text(0.27, {"a": {"globe": entry}}))
    with pytest.raises(CalibrationError, match=rf"eyes\.a\.globe\.{K}\.{name} is missing"):
        read_calibration(file)


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


def test_a_file_of_an_earlier_version_says_nothing_of_a_stiffening_which_is_0(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.27, EYES))
    assert "stiffening" not in file.read_text()
    summary = read_calibration(file)
    assert [eye.stiffening for eye in summary.eyes.values()] == [0.0, 0.0]
    assert summary.population_stiffening == 0.0


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (-0.1, "-0.1 is not between 0 and 200"),
        (200.1, "200.1 is not between 0 and 200"),
        ("stiff", "expected a number, found 'stiff'"),
        (True, "expected a number, found True"),
        (None, "expected a number, found None"),
        ([1.0], r"expected a number, found \[1.0\]"),
    ],
)
def test_a_stiffening_that_cannot_be_is_refused_in_one_line_with_its_key(
    tmp_path: Path, value: Any, message: str
) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.27, {"x": {"stiffening": value}}))
    with pytest.raises(CalibrationError, match=rf"^\S*: eyes\.x\.stiffening: {message}$"):
        read_calibration(file)
    population = {"mean_mpa": 0.27, "sd_mpa": 0.03, "stiffening": value}
    file.write_text(calibration_text(0.27, population=population))
    with pytest.raises(CalibrationError, match=rf"^\S*: population\.stiffening: {message}$"):
        read_calibration(file)


def test_a_stiffening_that_is_not_a_number_is_no_json_and_no_entry(tmp_path: Path) -> None:
    file, entry = tmp_path / "calibration.json", {"x": {"stiffening": float("nan")}}
    file.write_text(calibration_text(0.27, entry))
    with pytest.raises(CalibrationError, match=r"not JSON: NaN is no number"):
        read_calibration(file)
    content = json.loads(calibration_text(0.27, entry))
    with pytest.raises(CalibrationError, match=r"^f: eyes\.x\.stiffening: nan is not between 0 and 200$"):
        summary_of_eye(content["eyes"]["x"], "f: eyes.x")


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


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("growth", "steep", "growth: expected a number"),
        ("growth", 3.0, "growth: 3 is not between"),
        ("level", None, "level: expected a number"),
        ("level_sd", -0.1, "level_sd: -0.1 is not between"),
        ("correlation", 1.0, "correlation: 1 is not between"),
        ("largest_n", 31.0, "largest_n: 31 is not between 0 and 3"),
    ],
)
def test_a_discrepancy_that_cannot_be_is_refused_with_its_key(
    tmp_path: Path, key: str, value: Any, message: str
) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.27, {"a": {"discrepancy": {**DISCREPANCY, key: value}}}))
    with pytest.raises(CalibrationError, match=rf"eyes\.a\.discrepancy\.{message}"):
        read_calibration(file)
