"""What a monitor's recordings state of the eye that it watches."""

import pytest

from scleraforce.known.eye import Known, stated_eye, told_globe
from scleraforce.known.globe import OPEN, REFERENCE_RIGIDITY, SEALED, UNKNOWN, KnownGlobe, known_globe

CALIBRATED = KnownGlobe(
    kind="sealed", lowest=SEALED.lowest, highest=SEALED.highest, mean=REFERENCE_RIGIDITY, sd=1e6, calibrated=True
)


@pytest.mark.parametrize(
    ("known", "stated"),
    [
        (None, None),
        (UNKNOWN, None),
        (OPEN, OPEN),
        (SEALED, SEALED),
        (known_globe("sealed", REFERENCE_RIGIDITY, "logarithmic"),) * 2,
        (CALIBRATED, SEALED),  # its rigidity stands in the calibration
    ],
)
def test_a_recording_states_what_was_told_of_the_globe(known: KnownGlobe | None, stated: KnownGlobe | None) -> None:
    assert told_globe(stated_eye("mine", Known(globe=known))) == stated
