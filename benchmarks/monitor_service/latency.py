"""From an image's last byte to the STATUS, beside an echo in plain Python: what the
machine itself takes.

A control runs in the same seconds: on the monitor's core, with its priority, a server
takes the same bytes into one buffer and answers with 100. It gets every tenth frame,
halfway between two frames of the monitor.
"""

import socket
import subprocess
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

from scleraforce.base.worker_processes import no_interrupts
from scleraforce.live.companions.watchdog import MONITOR_PRIORITY, run_in_real_time
from scleraforce.live.network.openigtlink import Status, encode
from scleraforce.live.replay.scanner_player import ScannerClient

from .figures import QUANTILES, Progress, print_table, quantiles, quantiles_ms
from .monitors import Monitor, cores, pin, real_monitor
from .scanner import OK, WITHDRAW, Frames, Operator, Pace, be_the_peer

CONTROL_EVERY = 10
WARM_UP = 100
RESET_AFTER = 20  # frames
ECHO_BYTES = 100


def add_options(parser: ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument(
        "--frames", type=int, default=100_000, help="measured, of each variant"
    )
    parser.add_argument("--rate-hz", type=float, default=100.0)
    parser.add_argument(
        "--without",
        action="store_true",
        help="only the variant without the second opinion",
    )


def run(given: Namespace) -> dict[str, Any]:
    """Measure both variants."""
    frames = Frames(given.recording)
    real_time = be_the_peer()
    print(
        f"{given.frames} frames at {given.rate_hz:g} Hz; monitor on core {cores()[0]},"
        f" all others on {cores()[1]}; real-time priority:"
        f" {'yes' if real_time else 'no'}"
    )
    results: dict[str, Any] = {
        "frames": given.frames,
        "rate_hz": given.rate_hz,
        "real_time": real_time,
    }
    variants = {
        "without the second opinion": ["--no-second-opinion"],
        "with the second opinion": [],
    }

    for name, options in list(variants.items())[: 1 if given.without else 2]:
        with (
            real_monitor(given.model, given.recording, *options) as monitor,
            echo_server() as port,
        ):
            results[name] = measure(monitor, port, frames, given, name)

        show(name, results[name])

    return results


def measure(
    monitor: Monitor, echo_port: int, frames: Frames, given: Namespace, name: str
) -> dict[str, Any]:
    """Send frames at their times; a frame without an answer when the next is due counts
    as such.
    """
    pace = Pace(monitor.port, frames, given.rate_hz)
    progress = Progress(name, given.frames)
    operator = Operator(monitor.port, monitor.token)
    echoes = list[float]()
    control_s = list[float]()
    echo = ScannerClient("127.0.0.1", echo_port, lambda at_s, *_: echoes.append(at_s))
    withdrawals = list[str]()
    since_withdrawal = 0

    try:
        pace.warm_up(WARM_UP, operator)
        for number in range(given.frames):
            pace.send()
            pace.rest(0.5)
            if number % CONTROL_EVERY == 0:
                control_s.append(_echo(echo, echoes, pace.data))

            pace.rest()
            if pace.log.code != WITHDRAW:
                since_withdrawal = 0
            elif since_withdrawal == 0:
                withdrawals.append(pace.log.status.message if pace.log.status else "")

            since_withdrawal += pace.log.code == WITHDRAW
            if since_withdrawal > RESET_AFTER and operator.settled() is not True:
                operator.reset()

            progress.show(number + 1)
            monitor.prune()

        pace.client.listen(monotonic() + 1.0, lambda: pace.log.last is not None)
    finally:
        progress.end()
        pace.client.close()
        echo.close()
        operator.close()

    found = pace.log.answers
    return {
        "client": quantiles_ms(answer.took_s for answer in found),
        "server": quantiles(
            answer.server_ms for answer in found if answer.server_ms is not None
        ),
        "echo": quantiles_ms(control_s),
        "unanswered": pace.sent - len(found),
        "withdrawals": withdrawals,
        "ok": sum(answer.code == OK for answer in found),
        "latest_frame_ms": 1e3 * pace.latest_s,
    }


def _echo(client: ScannerClient, echoes: list[float], data: bytearray) -> float:
    """Return the round trip of the control, from the last byte, s."""
    echoes.clear()
    sent_s = client.send(data)
    client.listen(sent_s + 1.0, lambda: bool(echoes))
    return echoes[0] - sent_s if echoes else float("nan")


def show(name: str, result: dict[str, Any]) -> None:
    """Print the table of a variant."""
    lines = {
        "last byte sent to STATUS heard (client)": "client",
        "last byte received to STATUS sent (server)": "server",
        f"the same bytes, {ECHO_BYTES} back from plain Python": "echo",
    }
    rows = [
        [line, *(result[key][column] for column in QUANTILES)]
        for line, key in lines.items()
    ]
    print_table(f"{name}, ms", ["", *QUANTILES], rows)
    ratio = [
        (
            result["client"][column] / result["echo"][column]
            if result["echo"][column]
            else None
        )
        for column in QUANTILES[1:]
    ]
    print(
        "  client / echo:"
        f" {', '.join('-' if each is None else f'{each:.2f}' for each in ratio)}"
    )
    print(
        f"  OK {result['ok']}, without an answer {result['unanswered']}, withdrawals"
        f" {len(result['withdrawals'])}, latest frame {result['latest_frame_ms']:.2f}"
        " ms late"
    )

    for message in result["withdrawals"][:5]:
        print(f"    {message}")


@contextmanager
def echo_server() -> Iterator[int]:
    """Run the control in a process of its own."""
    with no_interrupts():
        process = subprocess.Popen(
            [sys.executable, "-m", __name__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[1],
        )

    assert process.stdin is not None
    assert process.stdout is not None

    try:
        port = int(process.stdout.readline())
        pin(process.pid, cores()[0])
        yield port
    finally:
        process.stdin.close()
        process.kill()
        process.wait()
        process.stdout.close()


def serve_echo() -> None:
    """Take messages of whatever size their headers state; answer each."""
    bare = len(encode(Status(1, message=""), "Echo"))
    answer = encode(Status(1, message=" " * (ECHO_BYTES - bare)), "Echo")
    assert len(answer) == ECHO_BYTES
    run_in_real_time(MONITOR_PRIORITY)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        print(listener.getsockname()[1], flush=True)
        link, _ = listener.accept()
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        room = memoryview(bytearray(1 << 21))

        while True:
            have = 0
            size = 58

            while have < size:
                count = link.recv_into(room[have:size])
                if not count:
                    return

                have += count
                if have == 58:
                    size = 58 + int.from_bytes(room[42:50], "big")

            link.sendall(answer)


if __name__ == "__main__":
    serve_echo()
