import hashlib
from pathlib import Path

import pytest
from calibration_file import calibration_text

from scleraforce.calibration.summary import read_calibration
from scleraforce.errors import CalibrationError

EYES = {
    "a": {"frames": ["1.png", "2.png"], "mean_mpa": 0.31},
    "b": {"status": "diverged: by 4 sd", "frames": ["1.png"]},
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
    assert found.frames == {("a", "1.png"), ("a", "2.png"), ("b", "1.png")}
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
        (calibration_text(float("nan")), "not between"),
        (calibration_text(-1), "not between"),
        (calibration_text(270000), "not between"),
        (calibration_text().replace('"eyes": {}', '"eyes": []'), "eyes: missing"),
        (calibration_text().replace('"eyes": {}', '"eyes": {"x": []}'), "eyes.x: expected"),
        (calibration_text(0.2, {"x": {"frames": "1.png"}}), "eyes.x.frames"),
        (calibration_text(0.2, {"x": {"frames": [1]}}), "eyes.x.frames"),
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


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"nothing\.json: No such file"):
        read_calibration(tmp_path / "nothing.json")
