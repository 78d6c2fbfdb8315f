"""The second opinion: a process that reads the monitor's frames again, independently, with the whole model.

The monitor answers with the network, in a few milliseconds. Here the whole chain runs on the raw frame, including the
fit to the response library, which takes several times as long. The process reads the newest frame, at most 50 a second,
and skips those that come meanwhile.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from select import select
from time import monotonic, sleep
from typing import Any

from scleraforce.known.eye import Known, Modulus
from scleraforce.reader import load_model
from scleraforce.reader.answers import Answer
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.companions.channel import Channel, ChannelClosedError
from scleraforce.service.companions.child import settings_of_child
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.priority import OPINION_PRIORITY, run_in_real_time

__all__ = ["main", "opinion_settings"]

LEAST_S = 0.02  # from frame to frame, which leaves some of the core to other programs


def opinion_settings(model: Path, known: Known, scale: PixelScale, ring: FrameRing) -> dict[str, Any]:
    """Return the settings of the process."""
    return {
        "model": str(model),
        "known": asdict(known),
        "scale": asdict(scale),
        "ring": ring.settings(),
    }


def main(arguments: Sequence[str]) -> None:
    """Read the frames that the monitor names, until its channel closes."""
    run_in_real_time(OPINION_PRIORITY)
    channel, settings = settings_of_child(arguments)
    try:
        _serve(channel, settings)
    except ChannelClosedError:
        return
    except Exception as fault:
        channel.send({"kind": "fault", "detail": f"{type(fault).__name__}: {fault}"})
        raise


def _serve(channel: Channel, settings: Mapping[str, Any]) -> None:
    reader = load_model(Path(settings["model"]))
    known, scale = _known(settings["known"]), PixelScale(**settings["scale"])
    ring = FrameRing(**settings["ring"])
    while True:
        select([channel], [], [])
        begun_s = monotonic()
        frame = channel.receive()[-1]
        pixels = ring.get(frame["number"])
        if pixels is not None:
            answer = reader.read(pixels, scale, known)
            channel.send(_told(frame["order"], answer))
        sleep(max(0.0, begun_s + LEAST_S - monotonic()))


def _known(record: Mapping[str, Any]) -> Known:
    modulus = record["modulus"]
    return Known(**{**record, "modulus": None if modulus is None else Modulus(**modulus)})


def _told(order: int, answer: Answer) -> dict[str, Any]:
    return {
        "kind": "opinion",
        "frame": order,
        "usable": answer.usable,
        "reason": answer.reason,
        "predicted": answer.predicted,
        "probabilities": answer.probabilities,
        "force_n": answer.force_n,
        "interval_n": answer.interval_n,
    }


if __name__ == "__main__":
    main(sys.argv)
