"""What the commands print of a globe with which eyes are read."""

import pytest

from scleraforce.cli.monitor import globe_words
from scleraforce.known import OPEN, REFERENCE_RIGIDITY, SEALED, UNKNOWN, Known, KnownGlobe, known_globe

CALIBRATED = KnownGlobe(
    kind="unknown", lowest=0.0, highest=UNKNOWN.highest, mean=REFERENCE_RIGIDITY, sd=0.02 * REFERENCE_RIGIDITY,
    calibrated=True,
)  # fmt: skip


@pytest.mark.parametrize(
    ("globe", "words"),
    [
        (None, "unknown: give --globe; intervals are wider and withdrawals come earlier"),
        (OPEN, "open"),
        (SEALED, "sealed, k between 0.005 and 0.06 mmHg^(1/3)/µl"),
        (known_globe("sealed", REFERENCE_RIGIDITY), "sealed, k between 0.026 and 0.034 mmHg^(1/3)/µl"),
        (CALIBRATED, "open or sealed, k between 0.029 and 0.031 mmHg^(1/3)/µl (calibrated)"),
    ],
)
def test_a_globe_is_named_with_its_rigidities_or_with_what_it_costs_not_to_know_it(
    globe: KnownGlobe | None, words: str
) -> None:
    assert globe_words(Known(globe=globe), reads_force=True) == words


def test_a_classifier_is_said_to_take_every_globe_for_open() -> None:
    assert globe_words(Known(globe=SEALED), reads_force=False).startswith("taken for open: a classifier knows no other")
