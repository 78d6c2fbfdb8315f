"""A user's session: nothing is pinned, the scanner is a normal process, a browser may
show the console.

The robot is this process too, on a connection of its own; `--receiver` starts Debian's
C++ `ReceiveClient` beside it. The frames stay below 25 mN, so every withdrawal is
false: it is printed and reset, and the session continues.
"""

import gc
import os
import subprocess
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

from scleraforce.base.errors import InputError
from scleraforce.base.worker_processes import no_interrupts
from scleraforce.live.companions.watchdog import run_in_real_time

from .browser import browser_pids, cpu_s, open_pages
from .figures import QUANTILES, Progress, print_table, quantiles, quantiles_ms
from .monitors import Monitor, real_monitor, resources
from .scanner import SCANNER_PRIORITY, WITHDRAW, Frames, Operator, Pace

RECEIVER = Path(
    "/usr/share/doc/openigtlink-examples/examples/Receiver/ReceiveClient.cxx"
)
WARM_UP = 50
RESET_AFTER = 20  # frames


def add_options(parser: ArgumentParser) -> None:
    """Add the options of this part."""
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate-hz", type=float, default=1000.0)
    parser.add_argument(
        "--pages", type=int, default=0, help="of the console, open in headless Chromium"
    )
    parser.add_argument(
        "--receiver",
        action="store_true",
        help="attach a C++ client that prints what it hears",
    )
    parser.add_argument(
        "--remote",
        action="store_true",
        help="give the scanner priority, as if it were elsewhere",
    )
    parser.add_argument(
        "--no-real-time", action="store_true", help="as a user without rights for it"
    )
    parser.add_argument(
        "--options", default="", help="further ones of `scleraforce monitor`"
    )


def run(given: Namespace) -> dict[str, Any]:
    """Play one session."""
    frames = Frames(given.recording)
    if given.remote:
        run_in_real_time(SCANNER_PRIORITY)

    options = given.options.split() + (["--web-port", "0"] if given.pages else [])
    with ExitStack() as stack:
        monitor = stack.enter_context(
            real_monitor(
                given.model,
                given.recording,
                *options,
                pinned=False,
                real_time=not given.no_real_time,
            )
        )
        said = stack.enter_context(receiver(monitor.port)) if given.receiver else None

        if given.pages:
            stack.enter_context(open_pages(monitor.console, given.pages))

        result = measure(monitor, frames, given)
        if said is not None:
            result["receiver heard"] = said.read_text("latin-1").count(" Code      : ")

    show(result)
    return result


def measure(monitor: Monitor, frames: Frames, given: Namespace) -> dict[str, Any]:
    """Send frames at their times, and reset what was withdrawn from."""
    total = round(given.seconds * given.rate_hz)
    pace = Pace(monitor.port, frames, given.rate_hz, observed=True)
    progress = Progress("session", total)
    operator = Operator(monitor.port, monitor.token)
    withdrawals = list[str]()
    since_withdrawal = 0
    gc.collect()
    # among the answers of half a minute a collection takes 60 ms, in which no frame
    # would be sent
    gc.disable()

    try:
        pace.warm_up(WARM_UP, operator)
        lost = pace.log.reading.get("lost", 0)
        used = shares(monitor)
        begun_s = monotonic()

        for number in range(total):
            pace.send()
            pace.rest()

            if pace.log.code != WITHDRAW:
                since_withdrawal = 0
            elif since_withdrawal == 0:
                status = pace.log.status
                withdrawals.append(
                    f"{monotonic() - begun_s:.1f} s: {status.name}: {status.message}"
                    if status
                    else ""
                )

            since_withdrawal += pace.log.code == WITHDRAW
            if since_withdrawal > RESET_AFTER and operator.settled() is not True:
                operator.reset()

            progress.show(number + 1, f"{len(withdrawals)} withdrawals")
            monitor.prune()

        took_s = monotonic() - begun_s
        used = {
            name: (now - used.get(name, 0.0)) / took_s
            for name, now in shares(monitor).items()
        }
        pace.client.listen(monotonic() + 1.0, lambda: pace.log.last is not None)
    finally:
        gc.enable()
        progress.end()
        pace.client.close()
        operator.close()

    answers = pace.log.answers
    return {
        "sent": pace.sent,
        "seconds": took_s,
        "answered_per_s": len(answers) / took_s,
        "overtaken": pace.log.reading.get("overtaken", 0),
        "lost": pace.log.reading.get("lost", 0) - lost,
        "withdrawals": withdrawals,
        "client": quantiles_ms(answer.took_s for answer in answers),
        "server": quantiles(
            answer.server_ms for answer in answers if answer.server_ms is not None
        ),
        "longest_silence_ms": 1e3 * pace.log.longest_silence_s,
        "latest_frame_ms": 1e3 * pace.latest_s,
        "cores": used,
        "memory_mb": {
            role: (1.024e-3 * held.rss_kb, 1.024e-3 * held.pss_kb)
            for role, pid in monitor.pids.items()
            if (held := resources(pid))
        },
    }


def show(result: dict[str, Any]) -> None:
    """Print the tables."""
    print_table(
        "answers, ms",
        ["", *QUANTILES],
        [
            ["last byte sent to STATUS heard (client)", *result["client"].values()],
            ["last byte received to STATUS sent (server)", *result["server"].values()],
        ],
    )
    said = {
        "frames sent": result["sent"],
        "seconds": result["seconds"],
        "answered a second": result["answered_per_s"],
        "overtaken": result["overtaken"],
        "lost": result["lost"],
        "longest time between two STATUS, ms": result["longest_silence_ms"],
        "latest frame went out late by, ms": result["latest_frame_ms"],
    }
    print_table("session", ["", ""], list(said.items()))
    print(
        "  cores: "
        + ", ".join(f"{name} {share:.2f}" for name, share in result["cores"].items())
    )
    print(
        "  memory, MB (RSS, PSS): "
        + ", ".join(
            f"{name} {rss:.0f}, {pss:.0f}"
            for name, (rss, pss) in result["memory_mb"].items()
        )
    )
    print(f"  withdrawals, all of them false: {len(result['withdrawals'])}")

    for line in result["withdrawals"][:20]:
        print(f"    {line}")


def shares(monitor: Monitor) -> dict[str, float]:
    """Return processor seconds used so far: by the monitor's processes, the browser,
    and this scanner.
    """
    used = {role: cpu_s([pid]) for role, pid in monitor.pids.items()}
    browser = browser_pids()
    return {
        **used,
        **({"browser": cpu_s(browser)} if browser else {}),
        "scanner": cpu_s([os.getpid()]),
    }


@contextmanager
def receiver(port: int) -> Iterator[Path]:
    """Run Debian's C++ receiver beside the session; what it prints is in the file that
    this gives.
    """
    with TemporaryDirectory(prefix="bench-receiver-") as folder:
        program = Path(folder, "receiver")
        said = Path(folder, "said")
        command = [
            "g++",
            "-w",
            "-O1",
            "-I/usr/include/openigtlink",
            str(RECEIVER),
            "-o",
            str(program),
        ]
        subprocess.run([*command, "-lOpenIGTLink", "-lpthread"], check=True)

        with said.open("wb") as out, no_interrupts():
            process = subprocess.Popen(
                [program, "127.0.0.1", str(port)], stdout=out, stderr=subprocess.STDOUT
            )

        try:
            yield said
            if process.poll() is not None:
                raise InputError(
                    f"{RECEIVER.stem}: ended with {process.returncode} before the"
                    " session did"
                )
        finally:
            process.kill()
            process.wait()
