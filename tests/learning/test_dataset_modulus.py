import hashlib
from pathlib import Path

import pytest
from small_recordings import calibration_text

from scleraforce.learning.dataset import read_population_modulus


def test_the_populations_modulus_is_read_with_its_provenance(tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.27, mechanics="linear"))
    found = read_population_modulus(file)
    assert found.youngs_modulus_pa == pytest.approx(0.27e6)
    assert (found.mechanics, found.path) == ("linear", str(file))
    assert found.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
