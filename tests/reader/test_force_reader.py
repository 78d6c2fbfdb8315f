"""The library that a force reader reads an eye with: of its tissue, at its contact."""

from pathlib import Path

import pytest
from analytic_frames import STUDY
from analytic_library import made_up_library
from small_models import FIVE_MN, FixedNetwork

from scleraforce.errors import InputError
from scleraforce.known import Known
from scleraforce.reader.kinds import ForceReader

LIBRARY = made_up_library()


@pytest.fixture
def reader() -> ForceReader:
    return ForceReader(Path("model"), STUDY, {}, FixedNetwork(FIVE_MN), LIBRARY, "fit")


def test_an_eye_is_read_with_walls_of_its_tissue_at_its_contact(reader: ForceReader) -> None:
    found = reader.library_for(Known(polar_rad=0.4, stiffening=5.0))
    assert (found.contact_polar_rad, found.stiffening) == (0.4, 5.0)
    assert (found.force_ratio_tpd == LIBRARY.for_stiffening(5.0).force_ratio_tpd).all()
    assert reader.library_for(Known(polar_rad=0.4, stiffening=5.0, iop_pa=300.0)) is found
    assert reader.library_for(Known(polar_rad=0.4)).stiffening == 0.0
    assert reader.library_for(Known(stiffening=5.0)).contact_polar_rad == LIBRARY.contact_polar_rad
    assert reader.library_for(Known(polar_rad=2.0, stiffening=5.0)).contact_polar_rad == LIBRARY.polar_rad[-1]


def test_an_eye_of_other_tissue_than_the_library_s_is_refused_and_the_refusal_says_so(reader: ForceReader) -> None:
    stiff = Known(stiffening=40.0)
    with pytest.raises(InputError, match="stiffening: 40 is outside the library's range, 0 to 30"):
        reader.library_for(stiff)
    assert reader.refusal(stiff) == "stiffening 40 of the tissue, the model was trained on 0 to 30"
    assert reader.refusal(Known(stiffening=30.0)) is None
