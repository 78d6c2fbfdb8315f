"""The messages of the monitor to its clients: STATUS `ForceMonitor`, STRING and SENSOR `ForceReading`."""

from collections.abc import Callable
from math import nan

from scleraforce.monitor import Decision
from scleraforce.openigtlink import Message, Sensor, Status, Text, encode
from scleraforce.service.entry import Entry
from scleraforce.units import to_si

STATUS_DEVICE, READING_DEVICE, RESET_DEVICE = "ForceMonitor", "ForceReading", "ForceReset"
MESSAGE_CHARACTERS = 1000  # of a STATUS: a reason may quote what a peer sent


def status_message(decision: Decision) -> Status:
    """Return the STATUS of a decision; the error name is that of the cause, or of the state where there is no cause."""
    name = decision.cause.name if decision.cause else "" if decision.code == 1 else decision.state.name
    return Status(decision.code, decision.sub_code, name[:20], decision.message[:MESSAGE_CHARACTERS])


def reading_messages(entry: Entry) -> tuple[Text, Sensor]:
    """Return the STRING and the SENSOR of a decision on a frame.

    The SENSOR holds: frame, class, probabilities of the classes 0, 1 and 2, force, lower and upper end of its interval
    (N), usable (1 or 0), code of the STATUS. Missing values are NaN.
    """
    shares = (entry.probabilities or (nan, nan, nan))[:3]
    low_mn, high_mn = entry.interval_mn or (nan, nan)
    force_mn = nan if entry.force_mn is None else entry.force_mn
    numbers = (
        nan if entry.frame is None else float(entry.frame),
        nan if entry.predicted is None else float(entry.predicted),
        *shares, *(nan,) * (3 - len(shares)),
        to_si(force_mn, "mn"), to_si(low_mn, "mn"), to_si(high_mn, "mn"),
        1.0 if entry.usable else 0.0,
        float(entry.code),
    )  # fmt: skip
    return Text(entry.text), Sensor(numbers)


class Telling:
    """Messages for several clients, encoded once for each header version that is needed."""

    def __init__(self, device: str, messages: tuple[Message, ...], wall_clock: Callable[[], float]) -> None:
        self._device, self._messages, self._time_s = device, messages, wall_clock()
        self._encoded: dict[int, bytes] = {}

    def to(self, version: int) -> bytes:
        """Return the bytes for a client of a header version."""
        if version not in self._encoded:
            parts = [encode(item, self._device, version=version, time_s=self._time_s) for item in self._messages]
            self._encoded[version] = b"".join(parts)
        return self._encoded[version]
