"""The console's page in a real browser: what a person sees."""

import os
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from chromium import NEEDS_CHROMIUM
from console_monitor import TOKEN, ConsoleMonitor, reading
from playwright.sync_api import Browser, Dialog, Page, WebSocket, expect
from waiting import FUSE_S, wait_until

from scleraforce.live.companions.process_messages import (
    Outline,
    ResetAnswered,
    ResetAsked,
    WrongTokens,
)
from scleraforce.records.remark import Remark

pytestmark = NEEDS_CHROMIUM
NOTHING = "\u2013"  # what stands for a value that is not known

BRIGHT = np.zeros((64, 96), np.uint16)
BRIGHT[20:40] = 4000


class Opened:
    """A page with all that it complained of and all that it asked for."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.asked: list[str] = []
        self.heard = 0  # messages of the console
        page.on("console", lambda message: self.complaints.append(message.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.asked.append(request.url))
        page.on("websocket", self._listen)
        page.on("dialog", self._refuse)

    def _listen(self, link: WebSocket) -> None:
        self.asked.append(link.url)
        link.on("framereceived", self._hear)

    def _hear(self, _: str | bytes) -> None:
        self.heard += 1

    def _refuse(self, dialog: Dialog) -> None:
        self.complaints.append(f"window.{dialog.type}")
        dialog.dismiss()

    def shows(self, **texts: str) -> None:
        """Wait until elements show texts, by their id."""
        for name, text in texts.items():
            expect(self.page.locator(f"#{name.replace('_', '-')}")).to_have_text(text)

    def has_view(self, view: str) -> None:
        """Wait for a view."""
        expect(self.page.locator("body")).to_have_attribute("data-view", view)

    def wait_until(self, holds: Callable[[], bool]) -> None:
        """Wait until something holds; what comes from the page is heard meanwhile."""
        wait_until(lambda: self.page.evaluate("true") and holds())

    def looks_live(self) -> bool:
        """Return whether anything looks like a live value: a number, a lit lamp, a
        picture without its stamp.
        """
        return bool(
            self.page.evaluate("""() => {
                  const text = (id) => document.getElementById(id).textContent;
                  const texts = ["force", "class", "class-bounds", "interval", "rate", "latency", "worst", "lost"];
                  const numbers = [...texts, "clients", "who"].some((id) => /[0-9]/.test(text(id)));
                  const lights = [...document.querySelectorAll(".light")];
                  const lit = lights.some((light) => getComputedStyle(light).fill !== "none");
                  const shown = ["scan-stamp", "graph-stamp"].some((id) => text(id) !== "NOT LIVE");
                  return numbers || lit || shown || !document.getElementById("ask").disabled;
                }""")
        )


@pytest.fixture
def opened(browser: Browser) -> Iterator[Callable[..., Opened]]:
    contexts = []

    def open_page(address: str, **options: Any) -> Opened:
        contexts.append(browser.new_context(**options))
        found = Opened(contexts[-1].new_page())
        found.page.set_default_timeout(1e3 * FUSE_S)
        expect.set_options(timeout=1e3 * FUSE_S)
        found.page.goto(address)
        return found

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture
def shown(opened: Callable[..., Opened]) -> Iterator[tuple[ConsoleMonitor, Opened]]:
    """A monitor and its open page."""
    with ConsoleMonitor() as monitor:
        yield monitor, opened(monitor.address)


@contextmanager
def repeating(tell: Callable[[], object], every_s: float = 0.02) -> Iterator[None]:
    """Let a monitor tell something again and again meanwhile."""
    done = Event()

    def run() -> None:
        while not done.wait(every_s):
            tell()

    thread = Thread(target=run, daemon=True)
    thread.start()

    try:
        yield
    finally:
        done.set()
        thread.join(FUSE_S)


def watching(
    monitor: ConsoleMonitor, force_mn: float = 12.3, **said: Any
) -> Callable[[], None]:
    """Frames of one force, with their outline and the rates."""

    def tell() -> None:
        frame = monitor.frame(
            BRIGHT, "WATCHING", f"class 1; {force_mn} mN", **reading(force_mn), **said
        )
        monitor.tell(
            Outline(frame=frame, step=4, outer=(20.0,) * 24, inner=(40.0,) * 24)
        )
        monitor.rates()

    return tell


def colours_at(page: Page, *rows: float) -> list[list[int]]:
    """Colours of the B-scan in its middle column, at rows of the frame."""
    script = """(rows) => { const canvas = document.getElementById("scan");
      const image = canvas.getContext("2d").getImageData(canvas.width / 2, 0, 1, canvas.height);
      return rows.map((row) => Math.floor(row / 64 * canvas.height) * 4)
        .map((at) => [...image.data.slice(at, at + 3)]); }"""
    return list(page.evaluate(script, rows))


def wall_is_drawn(page: Page) -> bool:
    """Return whether the bright wall, the dark above it and its outline are shown."""
    wall, above, surface = colours_at(page, 30, 10, 20.5)
    return min(wall) > 240 and max(above) < 10 and surface == [0xE6, 0x9F, 0x00]


def test_the_page_shows_what_the_monitor_decided_and_says_at_once_when_it_has_gone(
    opened,
):
    """State, class, force, interval, rates, the picture with its outline, the reason;
    then nothing that looks live.
    """
    monitor = ConsoleMonitor()
    with monitor:
        found = opened(monitor.address, viewport={"width": 1280, "height": 720})
        with repeating(watching(monitor)):
            found.shows(
                word="WATCHING",
                force="12.3",
                interval="90 % interval 10.3 to 14.3 mN",
                rate="100",
                lost="0",
            )
            found.shows(
                class_bounds="5 to 30 mN",
                latency="1.1",
                worst="1.1",
                clients="2",
                scan_stamp="",
                graph_stamp="",
            )
            expect(found.page.locator("#class")).to_have_text("1")
            found.has_view("WATCHING")
            expect(found.page.locator("#remarks")).to_be_hidden()
            found.wait_until(found.looks_live)
            expect(found.page.locator("#ask")).to_be_disabled()
            found.wait_until(lambda: wall_is_drawn(found.page))

        reason = "up to 31.0 mN, the bound is 30.0 mN"
        with repeating(
            lambda: monitor.entry("WITHDRAW", f"{reason}; class 1; 28.0 mN", "BOUND")
        ):
            found.shows(
                word="WITHDRAW",
                sentence="Now: The force may have reached the bound.",
                detail=reason,
            )
            expect(found.page.locator("#held")).to_have_text(
                re.compile(r"Held since \d\d:\d\d:\d\d\.")
            )
            expect(found.page.locator("#ask")).to_be_enabled()

        scroll = (
            "[document.documentElement.scrollHeight,"
            " document.documentElement.scrollWidth]"
        )
        assert found.page.evaluate(scroll) == [720, 1280]
        assert found.page.evaluate("document.activeElement.tagName") == "BODY"
        found.page.keyboard.press("Tab")
        assert found.page.evaluate("document.activeElement.id") == "ask"
        assert found.complaints == []
        assert {url.split("/")[2] for url in found.asked} == {
            f"127.0.0.1:{monitor.port}"
        }

    found.shows(word="NO ANSWER")
    found.has_view("LOST")
    assert not found.looks_live()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_time_until_the_bound_is_a_bar_that_shrinks_and_words_also_on_a_narrow_page(
    opened, scheme
):
    with ConsoleMonitor() as monitor:
        found = opened(
            monitor.address, viewport={"width": 400, "height": 800}, color_scheme=scheme
        )
        bar = (
            "[document.getElementById('until-text').textContent,"
            " getComputedStyle(document.querySelector('#until i'), '::before').width]"
        )
        widths = []

        def shows_bar(words):
            said, width = found.page.evaluate(bar)
            if said == words:
                widths.append(float(width.removesuffix("px")))
            return bool(said == words)

        for median_ms, ends_ms, words in (
            (None, None, "bound: not within 2 s"),
            (None, (1500.0, None), "bound: more than 2 s (90 % 1.50 to more than 2 s)"),
            (1200.0, (900.0, None), "bound in 1.20 s (90 % 0.90 to more than 2 s)"),
            (400.0, (250.0, 700.0), "bound in 0.40 s (90 % 0.25 to 0.70 s)"),
            (0.0, (0.0, 0.0), "the bound is reached"),
        ):
            time = {"time_to_bound_ms": median_ms, "time_to_bound_ms_interval": ends_ms}
            with repeating(watching(monitor, **time)):
                wait_until(lambda: shows_bar(words))  # noqa: B023 - called at once

        assert widths[0] == widths[1] > 300.0
        assert widths[2:] == pytest.approx(
            [0.6 * widths[0], 0.2 * widths[0], 0.0], abs=0.5
        )
        assert found.page.evaluate("document.documentElement.scrollWidth") == 400
        assert found.complaints == []


REMARKS = (
    Remark("outside-training", "IOP 40 mmHg, the model was trained on 1 to 30 mmHg"),
    Remark("other-eye", "another eye than its calibration's", about="eye-a"),
    Remark("lean-unknown", "the needle's lean is not given: " + 20 * "and so on, "),
)


@pytest.mark.parametrize("size", [(1280, 720), (400, 800)])
def test_remarks_are_one_line_with_the_most_serious_first_until_they_are_opened(
    opened, size
):
    width, height = size
    with ConsoleMonitor(remarks=REMARKS) as monitor:
        found = opened(monitor.address, viewport={"width": width, "height": height})
        with repeating(watching(monitor)):
            found.shows(
                word="WATCHING",
                remark_count="3 remarks",
                remark_first="doubt: eye-a: another eye than its calibration's",
            )
            rows = found.page.locator("#remark-list li")
            expect(rows.first).to_be_hidden()
            line = found.page.locator("#remarks").bounding_box()
            assert line["height"] < 40
            found.page.locator("#remarks summary").click()
            expect(rows).to_have_text(
                [
                    "doubt: eye-a: another eye than its calibration's",
                    f"caution: {REMARKS[0].words}",
                    re.compile("^caution: the needle's lean is not given"),
                ]
            )
            expect(rows.last).to_be_visible()
            listed = found.page.locator("#remark-list").bounding_box()
            word = found.page.locator("#word").bounding_box()
            assert (
                word["x"] + word["width"] <= listed["x"]
                or word["y"] >= listed["y"] + listed["height"]
            )
            scroll = (
                "[document.documentElement.scrollHeight,"
                " document.documentElement.scrollWidth]"
            )
            high, wide = found.page.evaluate(scroll)
            assert wide == width
            assert high == height or width < 960
            assert found.complaints == []


def test_a_withdrawal_shows_what_is_true_now_larger_than_its_first_cause(
    opened,
):
    with ConsoleMonitor() as monitor:
        found = opened(
            monitor.address, viewport={"width": 1280, "height": 720}, timezone_id="UTC"
        )
        held = {"cause": "SILENCE", "withdrawn_s": 1.8e9}
        present = {
            "present_cause": "BOUND",
            "present": "up to 40.5 mN, the bound is 30.0 mN",
        }
        pixels = np.zeros((64, 96), np.uint16)

        with repeating(
            lambda: monitor.frame(
                pixels, "WITHDRAW", "no frame", **held, **present, **reading(39.0)
            )
        ):
            found.shows(
                sentence="Now: The force may have reached the bound.",
                force="39.0",
                detail=present["present"],
            )
            found.shows(
                held="Held since 08:00:00: No frame came from the scanner for too long."
            )
            sizes = (
                "id =>"
                " parseFloat(getComputedStyle(document.getElementById(id)).fontSize)"
            )
            now, first = (
                found.page.evaluate(sizes, name) for name in ("sentence", "held")
            )
            assert now > first

        harmless = {"present_cause": None, "present": ""}
        with repeating(
            lambda: monitor.frame(
                pixels, "WITHDRAW", "no frame", **held, **harmless, **reading(4.0)
            )
        ):
            found.shows(
                sentence=(
                    "Now: the frames are harmless. The withdrawal is held until a"
                    " reset."
                ),
                force="4.0",
            )
            found.shows(
                held=(
                    "Held since 08:00:00: No frame came from the scanner for too long."
                ),
                detail="",
            )

        pierced = {
            "cause": "PIERCED",
            "withdrawn_s": 1.8e9,
            "present_cause": "PIERCED",
            "present": "it fell",
        }
        with repeating(
            lambda: monitor.frame(
                pixels, "WITHDRAW", "it fell", **pierced, **reading(4.0)
            )
        ):
            found.shows(
                force=NOTHING,
                interval="not judged: the dent no longer tells the force",
                until_text=NOTHING,
            )


def test_a_monitor_that_is_silent_is_as_loud_as_a_withdrawal_and_comes_back(
    shown,
):
    monitor, found = shown
    found.shows(
        sentence="The monitor has said nothing yet. Treat this as a withdrawal."
    )

    for _ in range(2):
        with repeating(watching(monitor)):
            found.shows(word="WATCHING", force="12.3")

        found.shows(
            word="NO ANSWER",
            sentence="The monitor does not answer. Treat this as a withdrawal.",
        )
        assert not found.looks_live()

    assert found.complaints == []


# one may be there for a moment only
REMEMBER_SENTENCES = """() => {
  const sentence = document.getElementById("sentence");
  window.sentences = [];
  new MutationObserver(() => sentences.push(sentence.textContent))
    .observe(sentence, { childList: true, characterData: true, subtree: true });
}"""


def test_a_server_that_hangs_is_shown_within_half_a_second_and_comes_back_by_itself(
    shown,
):
    """Stopped, the server leaves its connections open: only silence tells."""
    monitor, found = shown
    with repeating(watching(monitor)):
        found.shows(word="WATCHING")

    found.page.evaluate(REMEMBER_SENTENCES)
    connections = len(found.asked)
    os.kill(monitor.child.process.pid, signal.SIGSTOP)

    try:
        found.page.wait_for_function(
            "sentence => sentences.includes(sentence)",
            arg="The console's server does not answer. Treat this as a withdrawal.",
        )
        found.shows(word="NO ANSWER")
        assert not found.looks_live()
        # the page tries another connection
        found.wait_until(lambda: len(found.asked) > connections)
    finally:
        os.kill(monitor.child.process.pid, signal.SIGCONT)

    with repeating(watching(monitor)):
        found.shows(word="WATCHING", force="12.3")


def test_the_reset_asks_sends_the_token_keeps_it_nowhere_and_shows_the_answer(
    shown,
):
    monitor, found = shown
    page = found.page

    def withdrawn():
        monitor.entry("WITHDRAW", "class 2", "DANGEROUS_CLASS")

    def answer(granted, message):
        asked = monitor.hear(ResetAsked)
        monitor.tell(
            ResetAnswered(request=asked.request, granted=granted, message=message)
        )
        return asked

    with repeating(withdrawn, 0.1):
        found.shows(word="WITHDRAW")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        expect(page.locator("#dialog")).to_be_visible()
        page.keyboard.press("Escape")
        expect(page.locator("#dialog")).to_be_hidden()
        page.locator("#ask").click()
        page.locator("#send").click()  # without a token
        assert monitor.child.channel.receive() == []
        page.keyboard.type("wrong")
        page.keyboard.press("Enter")
        found.shows(
            refusal=(
                "Refused: the token or code is wrong; the monitor printed the right"
                " ones"
            )
        )
        assert monitor.hear(WrongTokens).count == 1
        assert page.locator("#token").input_value() == ""
        page.keyboard.type(TOKEN)
        page.keyboard.press("Enter")
        assert answer(True, "WATCHING").token == TOKEN
        expect(page.locator("#dialog")).to_be_hidden()
        expect(page.locator("#answer")).to_contain_text("Reset granted at")

    assert page.locator("#token").input_value() == ""
    assert (
        page.evaluate(
            "localStorage.length + sessionStorage.length + document.cookie.length"
        )
        == 0
    )
    assert found.complaints == []


def test_an_unanswered_reset_says_so_and_its_dialog_does_not_hide_that_the_connection_is_lost(
    opened,
):
    with ConsoleMonitor() as monitor:
        found = opened(monitor.address)
        with repeating(
            lambda: monitor.entry("WITHDRAW", "class 2", "DANGEROUS_CLASS"), 0.1
        ):
            found.page.locator("#ask").click()
            found.page.keyboard.type(TOKEN)
            found.page.keyboard.press("Enter")
            found.shows(refusal="Refused: the monitor does not answer")
            expect(found.page.locator("#dialog")).to_be_visible()

    found.shows(word="NO ANSWER")
    expect(found.page.locator("#dialog")).to_be_hidden()


@pytest.mark.parametrize(
    ("event", "script"),
    [
        ("an exception", "setTimeout(() => { throw new Error('x'); })"),
        ("a promise", "void Promise.reject(new Error('x'))"),
    ],
)
def test_a_page_that_fails_shows_nothing_that_looks_live(shown, event, script):
    monitor, found = shown
    with repeating(watching(monitor)):
        found.shows(word="WATCHING")
        found.page.evaluate(script)
        found.shows(
            sentence="This page has failed: load it again. Treat this as a withdrawal."
        )
        heard = found.heard
        found.wait_until(lambda: found.heard > heard + 2)
        assert found.page.evaluate("document.body.dataset.view") == "LOST", event
        assert not found.looks_live()


def test_frames_that_cannot_be_judged_show_no_force_and_the_reason(shown):
    monitor, found = shown

    def empty():
        monitor.frame(
            BRIGHT,
            "NOT_READY",
            "no wall",
            usable=False,
            reason="no wall",
            predicted=2,
            force_mn=9.0,
        )

    with repeating(empty):
        found.shows(
            word="NOT READY",
            force=NOTHING,
            interval="not judged: no wall",
            detail="no wall",
            scan_stamp="",
        )
        assert found.page.locator("#class").inner_text() == NOTHING
