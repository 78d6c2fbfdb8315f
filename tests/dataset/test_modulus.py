import hashlib

import pytest

from scleraforce.dataset.modulus import read_population_modulus
from scleraforce.errors import CalibrationError


def test_the_populations_modulus_is_read_with_its_provenance(tmp_path):
    file = tmp_path / "calibration.json"
    file.write_text('{"population": {"mean_mpa": 0.27, "sd_mpa": 0.03}, "eyes": {}}')
    found = read_population_modulus(file)
    assert found.youngs_modulus_pa == pytest.approx(0.27e6)
    assert found.path == str(file)
    assert found.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[]", "population.mean_mpa is missing"),
        ('{"population": {}}', "population.mean_mpa is missing"),
        ('{"population": {"mean_mpa": "stiff"}}', "expected a number"),
        ('{"population": {"mean_mpa": true}}', "expected a number"),
        ('{"population": {"mean_mpa": NaN}}', "not between"),
        ('{"population": {"mean_mpa": -1}}', "not between"),
        ('{"population": {"mean_mpa": 270000}}', "not between"),
    ],
)
def test_a_file_without_a_usable_modulus_is_refused_by_name(tmp_path, text, message):
    file = tmp_path / "calibration.json"
    file.write_text(text)
    with pytest.raises(CalibrationError, match=message) as fault:
        read_population_modulus(file)
    assert str(file) in str(fault.value)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(CalibrationError, match=r"nothing\.json: No such file"):
        read_population_modulus(tmp_path / "nothing.json")
