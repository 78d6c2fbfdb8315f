"""The answer on the wire: the monitor that users start, beside servers that take the
same frames and read nothing.

Then a scanner of 1,000 frames a second, and the memory of the running monitor.
"""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter, sleep

import numpy as np

from scleraforce.live.network.openigtlink import Image, encode
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.model_folder import SHIPPED_READER
from speed.parts import session
from speed.parts.recording import made_recording
from speed.record import Row, Table
from speed.run import ROOT, Run

PAUSE_S = 0.01
VARIANT = "without the second opinion"
OURS = "the monitor's answer"
PLAIN = "an echo in plain Python"
PYIGTL = "an echo by pyigtl"
GOALS_MS = {"median": 1.0, "99 %": 1.8}
SETTINGS = """From the last byte of a frame in the sender's socket to the STATUS in its
hands; 512 x 512 pixels of 16 bits, 100 frames a second, the shipped reader, on this
machine. `benchmarks/bench_monitor.py latency` starts monitor and plain echo: the
monitor on the first core with real-time priority where the machine grants it, the echo
on the same core and with the same priority every tenth frame. pyigtl's echo is an
ordinary process between such runs."""
WORDS = {
    OURS: "decoded, its checksum checked, read, decided, answered",
    PLAIN: "the bytes into one buffer, 100 back",
    PYIGTL: (
        "`OpenIGTLinkServer` takes the same frames and answers each with a string; it"
        " looks for something to send only after 10 ms in which nothing came"
    ),
}


def measure(run: Run) -> Table:
    """Measure the monitor and the echoes by turns."""
    recording = made_recording(run)
    taken: dict[str, dict[str, list[float]]] = {
        name: {share: [] for share in GOALS_MS} for name in WORDS
    }

    for number in range(run.count(3, 1)):
        found = _latency(
            recording, run.folder / f"latency-{number}.json", run.count(1000, 60)
        )
        pyigtl_ms = _pyigtl_ms(recording, run.count(300, 20))

        for share in GOALS_MS:
            taken[OURS][share].append(found["client"][share])
            taken[PLAIN][share].append(found["echo"][share])
            taken[PYIGTL][share].append(
                float(np.quantile(pyigtl_ms, 0.5 if share == "median" else 0.99))
            )

    return Table(
        "The answer on the wire",
        f"{SETTINGS} {session.SETTINGS}",
        (*_rows(taken), *session.session_rows(run)),
    )


def _rows(taken: dict[str, dict[str, list[float]]]) -> Iterator[Row]:
    """Yield the rows: the median over the runs of each one's median and 99 %."""
    for share, goal in GOALS_MS.items():
        beside = float(np.median(taken[PYIGTL][share]))
        for name in WORDS:
            yield Row(
                what=f"{name}, {share}",
                unit="ms",
                value=float(np.median(taken[name][share])),
                spread=(min(taken[name][share]), max(taken[name][share])),
                beside="" if name == PYIGTL else PYIGTL,
                beside_value=None if name == PYIGTL else beside,
                goal=goal if name == OURS else None,
                settings=WORDS[name] if share == "median" else "",
            )


def _latency(recording: Path, answer: Path, frames: int) -> dict[str, dict[str, float]]:
    """Run the monitor's own benchmark; return quantiles in ms by name."""
    command = [
        sys.executable,
        str(ROOT / "benchmarks" / "bench_monitor.py"),
        "latency",
        str(SHIPPED_READER),
    ]
    command += [
        str(recording),
        "--frames",
        str(frames),
        "--without",
        "--json",
        str(answer),
    ]
    subprocess.run(command, stdout=sys.stderr, check=True)
    found: dict[str, dict[str, float]] = json.loads(answer.read_text(encoding="utf-8"))[
        VARIANT
    ]

    return found


def _pyigtl_ms(recording: Path, frames: int) -> list[float]:
    """Return how long pyigtl's echo takes for each frame."""
    scan = read_recording(recording)
    messages = [
        encode(Image(scan.frame(entry)[None]), "Scanner", version=1)
        for entry in scan.frames[:20]
    ]
    taken = []

    with (
        _pyigtl_server() as port,
        socket.create_connection(("127.0.0.1", port)) as link,
    ):
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for number in range(frames):
            sleep(PAUSE_S)
            link.sendall(messages[number % len(messages)])
            sent = perf_counter()
            if not link.recv(65536):
                raise RuntimeError("pyigtl's server has closed the connection")

            taken.append(1e3 * (perf_counter() - sent))

    return taken


@contextmanager
def _pyigtl_server() -> Iterator[int]:
    """Run the echo in a process of its own."""
    command = [sys.executable, "-m", "speed.pyigtl_echo"]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None

    try:
        yield int(process.stdout.readline())
    finally:
        process.stdin.close()
        process.kill()
        process.wait()
        process.stdout.close()
