import hashlib
from pathlib import Path

import pytest
from calibration_file import calibration_text

from scleraforce.errors import CalibrationError
from scleraforce.known.calibration_file import read_calibration

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


def test_a_population_of_one_eye_has_no_spread(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(population={"mean_mpa": 0.27, "sd_mpa": None}))
    assert read_calibration(file).population_sd_pa is None


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"nothing\.json: No such file"):
        read_calibration(tmp_path / "nothing.json")
