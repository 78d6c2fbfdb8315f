"""From a reading to the answer: what of it cannot be used, and why."""

from scleraforce.reader.answers import Answer, unusable
from scleraforce.reader.readings import Reading
from scleraforce.reader.verdicts import contact_outside
from scleraforce.study import Study
from scleraforce.units import from_si

WIDEST_N = 6e-3  # of the interval of a dent that leaves the window: what its flanks tell must be as sure as this


def judged_answer(reading: Reading, name: str, leaves: bool, study: Study) -> Answer:
    """Return the answer that one method gives.

    Args:
        reading: of the method.
        name: of the method.
        leaves: whether the dent leaves the window.
        study: of the model.
    """
    classes = len(study.classes.bounds_n) + 1
    if not reading.finite:
        return unusable(classes, f"what the {name} reads is no number")
    reason = contact_outside(reading, study.reader)
    if reason:
        return unusable(classes, reason)
    if leaves and not reading.width_n < WIDEST_N:
        return unusable(
            classes,
            "the dent leaves the window of the slice, and its flanks leave the force open by "
            f"{from_si(reading.width_n, 'mn'):.0f} mN",
        )
    return Answer(
        predicted=reading.predicted,
        probabilities=reading.probabilities,
        usable=True,
        reason=None,
        force_n=reading.force_n,
        interval_n=reading.interval_n,
        contact_m=reading.contact_m,
    )
