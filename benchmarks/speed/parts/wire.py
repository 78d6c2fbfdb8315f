"""The answer on the wire: the monitor that users start, beside servers that take the
same frames and read nothing.

Then a scanner of 1,000 frames a second, and the memory of the running monitor.
"""

import socket
from collections import defaultdict
from time import perf_counter, sleep
from typing import Any

import numpy as np

from markdown_tables import quantiles_ms
from monitor.real_monitor import server_process
from scleraforce.live.network.openigtlink import Image, encode
from scleraforce.recordings.recording_folder import read_recording
from speed.parts import session
from speed.parts.frame import CRUDE, plain_median_and_otsu
from speed.parts.recording import made_recording
from speed.record import Table, rows_beside
from speed.run import Run

PAUSE_S = 0.01
OURS = "the monitor's answer"
PLAIN = "an echo in plain Python"
PYIGTL = "an echo by pyigtl"
GOALS_MS = {"median": 1.0, "99 %": 1.8}
SETTINGS = """From the last byte of a frame in the sender's socket to the STATUS in its
hands; 512 x 512 pixels of 16 bits, 100 frames a second, the shipped reader, on this
machine. `python -m monitor session --no-opinion` starts monitor and plain echo: the
monitor on the first core with real-time priority where the machine grants it, the echo
on the same core and with the same priority every tenth frame. pyigtl's echo is an
ordinary process between such runs; it waits on a timer, so plain median and Otsu of a
frame, which tells the machine's speed, is timed there, too."""
WORDS = {
    OURS: "decoded, its checksum checked, read, decided, answered",
    PLAIN: "the bytes into one buffer, 100 back",
    PYIGTL: (
        "`OpenIGTLinkServer` takes the same frames and answers each with a string; it"
        " looks for something to send only after 10 ms in which nothing came"
    ),
    CRUDE: "in this process, with a pause of 10 ms between two frames",
}


def measure(run: Run) -> Table:
    """Measure the monitor and the echoes by turns."""
    taken_ms: dict[str, list[float]] = defaultdict(list)
    for _ in range(run.count(3, 1)):
        found = session.monitor_session(run, run.count(1000, 60), "--no-opinion")
        latency = found["latency"]
        pyigtl_s = _pyigtl_s(run, run.count(300, 20))
        answers_ms: dict[str, Any] = {
            OURS: latency["last byte sent to STATUS heard"],
            PLAIN: latency["echo"],
            PYIGTL: quantiles_ms(pyigtl_s),
            CRUDE: quantiles_ms(_crude_s(run, run.count(300, 20))),
        }
        for name, shares in answers_ms.items():
            for share in GOALS_MS:
                taken_ms[f"{name}, {share}"].append(shares[share])

    over_crude = {
        f"{OURS}, {share}": {
            f"over {CRUDE}": float(
                np.median(taken_ms[f"{OURS}, {share}"])
                / np.median(taken_ms[f"{CRUDE}, {share}"])
            )
        }
        for share in GOALS_MS
    }
    rows = [
        row
        for share, goal in GOALS_MS.items()
        for row in rows_beside(
            {f"{name}, {share}": taken_ms[f"{name}, {share}"] for name in WORDS},
            f"{PYIGTL}, {share}",
            "ms",
            settings={f"{name}, median": words for name, words in WORDS.items()},
            goals={f"{OURS}, {share}": goal},
            more=over_crude,
        )
    ]
    crude_ms = float(np.median(taken_ms[f"{CRUDE}, median"]))
    return Table(
        "The answer on the wire",
        f"{SETTINGS} {session.SETTINGS}",
        (*rows, *session.session_rows(run, crude_ms)),
    )


def _crude_s(run: Run, frames: int) -> list[float]:
    """Return how long plain median and Otsu take for each frame."""
    scan = read_recording(made_recording(run))
    pixels = [scan.frame(entry) for entry in scan.frames[:20]]
    taken_s = []
    for number in range(frames):
        sleep(PAUSE_S)
        start_s = perf_counter()
        plain_median_and_otsu(pixels[number % len(pixels)])
        taken_s.append(perf_counter() - start_s)
    return taken_s


def _pyigtl_s(run: Run, frames: int) -> list[float]:
    """Return how long pyigtl's echo takes for each frame."""
    scan = read_recording(made_recording(run))
    messages = [
        encode(Image(scan.frame(entry)[None]), "Scanner", version=1)
        for entry in scan.frames[:20]
    ]
    taken_s = []
    with (
        server_process("speed.pyigtl_echo") as (port, _),
        socket.create_connection(("127.0.0.1", port)) as link,
    ):
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for number in range(frames):
            sleep(PAUSE_S)
            link.sendall(messages[number % len(messages)])
            sent_s = perf_counter()
            if not link.recv(65536):
                raise RuntimeError("pyigtl's server has closed the connection")

            taken_s.append(perf_counter() - sent_s)

    return taken_s
