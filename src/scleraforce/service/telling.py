"""The messages of the monitor to its clients: STATUS `ForceMonitor`, STRING and SENSOR `ForceReading`."""

from collections.abc import Callable
from math import nan

from scleraforce.monitor import Decision
from scleraforce.monitor.events import Verdict
from scleraforce.openigtlink import Message, Sensor, Status, Text, encode
from scleraforce.service.entry import Entry

STATUS_DEVICE, READING_DEVICE, RESET_DEVICE = "ForceMonitor", "ForceReading", "ForceReset"
NOT_READ = Verdict(predicted=0, probabilities=None, usable=False, reason=None, force_n=None, interval_n=None)
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
    verdict = entry.verdict or NOT_READ
    shares = (verdict.probabilities or (nan, nan, nan))[:3]
    numbers = (
        nan if entry.frame is None else float(entry.frame),
        float(verdict.predicted) if entry.verdict else nan,
        *shares, *(nan,) * (3 - len(shares)),
        nan if verdict.force_n is None else verdict.force_n,
        *(verdict.interval_n or (nan, nan)),
        float(verdict.usable),
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
