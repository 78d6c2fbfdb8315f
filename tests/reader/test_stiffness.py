"""The stiffness of a known wall: what a withdrawal explains of a fall."""

from dataclasses import replace

import pytest

from scleraforce.known import OPEN, SEALED, Known, Modulus
from scleraforce.models import SHIPPED_READER
from scleraforce.reader import load_force_reader
from scleraforce.reader.model import LiveReader


def test_the_stiffness_is_a_known_open_walls_and_grows_with_its_modulus() -> None:
    reader = load_force_reader(SHIPPED_READER)
    modulus = Modulus(mean_pa=0.3e6, sd_pa=0.0, source="own")
    known = Known(modulus=modulus, thickness_m=600e-6, iop_pa=266.0, globe=OPEN)
    soft, hard = (
        reader.steepest_n_m(replace(known, modulus=replace(modulus, mean_pa=pa), iop_pa=266.0 * pa / 0.3e6))
        for pa in (0.2e6, 0.4e6)
    )
    assert soft is not None
    assert hard == pytest.approx(2.0 * soft)
    assert 10.0 < soft < 25.0
    unsure = replace(modulus, mean_pa=0.3e6, sd_pa=0.05e6)
    live = LiveReader(reader, replace(known, modulus=unsure), 1.0)
    sure = live.adopt(replace(known, modulus=replace(unsure, sd_pa=0.01e6)))
    assert sure == pytest.approx(reader.steepest_n_m(replace(known, modulus=replace(modulus, mean_pa=0.32e6))))
    assert live.adopt(replace(known, modulus=replace(modulus, mean_pa=99e6))) is None  # the reader does not read it
    assert reader.steepest_n_m(replace(known, globe=SEALED)) is None
    assert reader.steepest_n_m(replace(known, thickness_m=None)) is None
