"""Measure the delay from the monitor's decision to the browser's picture, and the
console's load.

    python benchmarks/bench_console.py changes [--changes 100]
    python benchmarks/bench_console.py session MODEL RECORDING [--seconds 600]
        [--rate-hz 100] [--remote]

changes: a monitor decides 100 times a second on frames of 512 x 512, with 25 outlines a
second, and changes its state at random moments. Times start before the entry is sent
and end when the page's text has changed, and when the browser has painted it (the
second animation frame after that). "late" counts changes that a page had not shown when
the next one came, 0.3 to 0.5 s later. Needs chromium. The lateness of this process's
own sleeps is printed beside them.

session: the monitor that users start, with its console open in Chromium and a scanner
at 100 frames a second, all on one machine: latency and false withdrawals. See
`monitor_service/session.py`.
"""

import argparse
import select
from pathlib import Path
from time import monotonic, sleep, time

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, sync_playwright

from monitor_service.browser import CHROMIUM, browser_pids, cpu_s
from monitor_service.session import add_options, run as run_session
from scleraforce.live.companions.process_channel import Child
from scleraforce.live.companions.process_messages import (
    CompanionMessage,
    ConsoleSettings,
    Decided,
    Entry,
    ListensAt,
    Outline,
    Rates,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor import listen
from scleraforce.records.scan import PixelScale
from scleraforce.records.verdict import Verdict

SIZE = 512
FRAME_S = 0.01
VERDICT = Verdict(
    predicted=1,
    probabilities=(0.02, 0.96, 0.02),
    usable=True,
    reason=None,
    force_n=0.012,
    interval_n=(0.01, 0.014),
)
OBSERVE = """() => {
  window.seen = [];
  const now = () => performance.timeOrigin + performance.now();
  new MutationObserver(() => {
    const change = [document.getElementById("word").textContent, now(), null];
    window.seen.push(change);
    requestAnimationFrame(() => requestAnimationFrame(() => (change[2] = now())));
  }).observe(document.getElementById("word"), { childList: true });
}"""


class Session:
    """The monitor's end of the channel."""

    def __init__(self) -> None:
        rng = np.random.default_rng(0)
        self.ring = FrameRing.create(100, SIZE, SIZE)
        listener = listen("127.0.0.1", 0)
        settings = ConsoleSettings(
            host="127.0.0.1",
            listener=listener.fileno(),
            token_digest="",
            ring=self.ring.place,
            scale=PixelScale(lateral_m=29e-6, depth_m=8e-6),
            limits=MonitorLimits(),
            class_bounds_n=(5e-3, 30e-3),
            model="bench",
            eye="",
            remarks=(),
        )
        self.child = Child(
            "scleraforce.live.console.server",
            settings,
            [self.ring.place.descriptor, listener.fileno()],
        )
        listener.close()
        select.select([self.child.channel], [], [], 30)
        (listens,) = self.child.channel.receive()
        assert isinstance(listens, ListensAt), listens
        self.address = listens.url
        self.pictures = [
            rng.integers(0, 4096, (SIZE, SIZE), dtype=np.uint16) for _ in range(8)
        ]
        self.curve = tuple(np.linspace(100, 140, SIZE // 4).tolist())
        self.state = "WATCHING"
        self.frames = self.refused = 0
        self.sending_s: list[float] = []
        self.late_s: list[float] = []

    def frame(self) -> float:
        """Decide on a frame, as the monitor does; return the time before its entry was
        sent.
        """
        self.frames += 1
        self.ring.put(self.frames, self.pictures[self.frames % 8])
        entry = Entry(
            number=self.frames,
            time_s=time(),
            at_s=monotonic(),
            event="frame",
            state=self.state,
            code=1,
            sub_code=0,
            cause=None,
            message=f"{self.state}: class 1; 12.0 mN",
            frame=self.frames,
            frame_id=self.frames,
            verdict=VERDICT,
            latency_ms=1.0,
        )
        sent_s = time()
        self.send(Decided(entry=entry))

        if self.frames % 4 == 0:
            self.send(
                Outline(frame=self.frames, step=4, outer=self.curve, inner=self.curve)
            )

        if self.frames % 50 == 0:
            self.send(Rates(frames_per_second=100.0, lost=0, clients=()))

        return sent_s

    def send(self, message: CompanionMessage) -> None:
        """Send a message, and note how long that took."""
        begin_s = monotonic()
        self.refused += not self.child.channel.send(message)
        self.sending_s.append(monotonic() - begin_s)


def run(session: Session, pages: list[Page], changes: int) -> list[NDArray[np.float64]]:
    """Return for each page the times (change, [shown, painted]) in ms after the entry
    was sent.
    """
    rng = np.random.default_rng(1)
    begin_s = monotonic()
    moments = begin_s + 1.0 + np.cumsum(rng.uniform(0.3, 0.5, changes))
    sent_s: list[float] = []
    due_s = begin_s

    while len(sent_s) < changes or monotonic() < moments[-1] + 0.5:
        change = len(sent_s) < changes and monotonic() >= moments[len(sent_s)]
        if change:
            session.state = "WITHDRAW" if session.state == "WATCHING" else "WATCHING"

        at_s = session.frame()
        if change:
            sent_s.append(at_s)

        due_s = max(due_s + FRAME_S, monotonic() - 0.1)
        sleep(max(0.0, due_s - monotonic()))
        session.late_s.append(monotonic() - due_s)

    return [times_ms(page, sent_s) for page in pages]


def times_ms(page: Page, sent_s: list[float]) -> NDArray[np.float64]:
    """Pair the changes that a page showed with the ones sent; a change that it never
    showed is infinite.
    """
    seen = [
        (text, shown, painted or np.inf)
        for text, shown, painted in page.evaluate("window.seen")
    ]
    texts = ("WITHDRAW", "WATCHING")
    found = []

    for number, at_s in enumerate(sent_s):
        until_s = sent_s[number + 1] if number + 1 < len(sent_s) else np.inf
        matching = [
            (shown, painted)
            for text, shown, painted in seen
            if text == texts[number % 2] and 1e3 * at_s - 1 <= shown < 1e3 * until_s
        ]
        shown, painted = matching[0] if matching else (np.inf, np.inf)
        found.append((shown - 1e3 * at_s, painted - 1e3 * at_s))

    return np.array(found)


def show_changes(changes: int) -> None:
    """Print the table."""
    print(
        "| pages | shown: median | 99 % | worst | painted: median | 99 % | worst | late"
        " | CPU: console | browser |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    sending: list[str] = []

    with sync_playwright() as playwright:
        for count in (1, 4):
            browser = playwright.chromium.launch(
                executable_path=CHROMIUM, args=["--no-sandbox"]
            )
            session = Session()
            session.frame()
            pages = [
                browser.new_page(viewport={"width": 1280, "height": 720})
                for _ in range(count)
            ]

            for page in pages:
                page.goto(session.address)
                page.evaluate(OBSERVE)

            shares = [
                cpu_s([session.child.process.pid]),
                cpu_s(browser_pids()),
                monotonic(),
            ]
            session.sending_s.clear()
            found = np.concatenate(run(session, pages, changes))
            used = np.subtract(
                [
                    cpu_s([session.child.process.pid]),
                    cpu_s(browser_pids()),
                    monotonic(),
                ],
                shares,
            )
            cells = [
                text
                for column in found.T
                for text in spread(column[np.isfinite(column)])
            ]
            late = int(np.isinf(found[:, 0]).sum())
            shares_used = [f"{100 * part / used[2]:.0f} %" for part in used[:2]]
            print(
                "| " + " | ".join([str(count), *cells, str(late), *shares_used]) + " |",
                flush=True,
            )
            sending_us = 1e6 * np.array(session.sending_s)
            late_ms = 1e3 * np.array(session.late_s)
            sending.append(
                f"pages: {count}. A message to the console took the monitor"
                f" {np.median(sending_us):.0f} us (median), {session.refused} of"
                f" {len(sending_us)} were not taken. Sleeps ended late by"
                f" {np.median(late_ms):.1f} ms (median),"
                f" {np.percentile(late_ms, 99):.1f} ms (99 %), {late_ms.max():.1f} ms"
                " (worst)"
            )
            browser.close()
            session.child.end()

    print(*sending, sep="\n")


def spread(times: NDArray[np.float64]) -> list[str]:
    """Median, 99th percentile and maximum; dashes where there is nothing."""
    if not len(times):
        return ["-"] * 3
    return [
        f"{value:.1f} ms" for value in (*np.percentile(times, [50, 99]), times.max())
    ]


def main() -> None:
    """Run one of the two."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parts = parser.add_subparsers(dest="part", required=True)
    parts.add_parser("changes").add_argument("--changes", type=int, default=100)
    session = parts.add_parser("session")
    session.add_argument("model", type=Path)
    session.add_argument("recording", type=Path)
    add_options(session)
    session.set_defaults(pages=1, seconds=600.0, rate_hz=100.0)

    given = parser.parse_args()
    if given.part == "changes":
        show_changes(given.changes)
    else:
        run_session(given)


if __name__ == "__main__":
    main()
