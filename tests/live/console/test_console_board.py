"""The console's board, and the share of its pages."""

import asyncio
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from console_monitor import reading
from small_monitor import decision, verdict
from starlette.types import Message, Receive, Scope, Send

from scleraforce.live.companions.process_messages import (
    CompanionMessage,
    Decided,
    Entry,
    Outline,
    Rates,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.console.board import (
    HISTORY_S,
    STEP_S,
    Board,
    StepHistory,
    sentence_of,
)
from scleraforce.live.console.hub import SHARES, FramePictures, Thrift
from scleraforce.live.console.server import OwnPagesOnly
from scleraforce.live.decision.events import Cause

MOST_PIXELS = SHARES[0].pixels


def entry(
    at_s: float, state: str = "WATCHING", cause: str | None = None, **said: Any
) -> Entry:
    return decision(
        state,
        at_s=at_s,
        cause=cause,
        message=f"{state}: because; class 1; 7.0 mN",
        **said,
    )


def take(board: Board, message: Entry | CompanionMessage, now_s: float) -> bool:
    return board.take(
        Decided(entry=message) if isinstance(message, Entry) else message, now_s
    )


def board_with(*messages: tuple[float, Entry | CompanionMessage]) -> Board:
    board = Board(0.0)
    for now_s, message in messages:
        take(board, message, now_s)
    return board


RATES = Rates(
    frames_per_second=99.0, lost=3, clients=({"address": "a:1", "role": "scanner"},)
)


@pytest.mark.parametrize("cause", Cause.__members__)
def test_every_cause_has_a_sentence_and_no_sentence_is_without_a_cause(
    cause,
):
    assert sentence_of(cause) not in (sentence_of("NONE"), f"Cause: {cause}.")


def test_the_present_cause_is_shown_beside_the_first_one_and_its_time():
    present = {"present_cause": "BOUND", "present": "up to 40.5 mN"}
    held = entry(
        1.0,
        "WITHDRAW",
        "SILENCE",
        frame=7,
        withdrawn_s=1.8e9,
        **present,
        **reading(39.0),
    )
    shown = board_with((1.0, held)).as_json(1.0, 0)
    assert shown["sentence"] == sentence_of("SILENCE")
    assert shown["present"] == sentence_of("BOUND")
    assert (shown["detail"], shown["withdrawn_s"], shown["reading"]["force_mn"]) == (
        "up to 40.5 mN",
        1.8e9,
        39.0,
    )
    over = replace(held, present_cause=None, present="", verdict=verdict(4.0))
    shown = board_with((1.0, held), (1.1, over)).as_json(1.1, 0)
    assert (shown["sentence"], shown["present"], shown["detail"]) == (
        sentence_of("SILENCE"),
        "",
        "",
    )


def test_a_puncture_that_is_only_reported_is_worse_than_not_ready_and_has_its_sentence():
    shown = board_with(
        (1.0, entry(1.0, "PIERCED", "PIERCED", present_cause="PIERCED"))
    ).as_json(1.0, 0)
    assert (shown["state"], shown["present"], shown["withdrawn_s"]) == (
        "PIERCED",
        sentence_of("PIERCED"),
        None,
    )
    history = StepHistory()

    for state in ("NOT_READY", "PIERCED", "WATCHING"):
        history.take(entry(1.0, state))

    assert history.since(0)[-1].state == "PIERCED"


def test_a_change_of_state_or_cause_is_urgent_and_another_frame_is_not():
    board = Board(0.0)
    withdrawn = [entry(at_s, "WITHDRAW", "BOUND") for at_s in (0.02, 0.03)]
    urgent = [
        take(board, one, one.at_s)
        for one in (entry(0.0), entry(0.01), *withdrawn, entry(0.04))
    ]
    assert urgent == [True, False, True, False, True]
    assert not board.take(RATES, 0.05)
    assert take(Board(0.0), entry(0.01, "NOT_READY"), 0.01), (
        "the first decision is urgent"
    )


def test_a_monitor_that_says_nothing_is_silent_and_sooner_while_it_watches():
    assert Board(0.0).monitor(0.1) == "starting"
    not_ready = board_with((1.0, RATES))
    assert not_ready.as_json(1.1, 0)["state"] == "NOT_READY"
    assert [not_ready.monitor(at_s) for at_s in (1.0, 2.1, 2.3)] == [
        "answers",
        "answers",
        "silent",
    ]
    watching = board_with((1.0, entry(1.0)), (1.45, RATES))
    assert [watching.monitor(at_s) for at_s in (1.4, 1.6)] == ["answers", "silent"]
    watching.end()
    assert watching.monitor(1.0) == "ended"


def test_an_old_reading_is_not_shown_as_one_of_now():
    silent = entry(0.9, "WITHDRAW", "SILENCE")
    board = board_with(
        (0.0, entry(0.0, frame=1, plane="across", **reading(12.0))),
        (0.4, RATES),
        (0.9, silent),
    )
    shown = board.as_json(0.4, 0)["reading"]
    assert (shown["force_mn"], shown["plane"]) == (12.0, "across")
    assert board.as_json(0.9, 0)["reading"] is None


def test_a_frame_whose_wall_is_not_found_is_shown_without_an_outline():
    outline = Outline(frame=4, step=4, outer=(), inner=())
    board = board_with(
        (0.0, entry(0.0, frame=4)), (0.0, outline), (0.1, entry(0.1, frame=5))
    )
    assert board.picture() == (4, outline)
    take(board, entry(0.3, frame=6), 0.3)
    assert board.picture() == (6, None)


def test_steps_of_the_history_hold_their_worst_entries():
    """Against all entries of a step, looked at one by one."""
    rng = np.random.default_rng(0)
    history = StepHistory()
    entries = []

    for at_s in np.cumsum(rng.exponential(0.016, 2500)):
        state = str(
            rng.choice(["WATCHING", "NOT_READY", "WITHDRAW"], p=[0.9, 0.09, 0.01])
        )
        said = (
            reading(float(rng.uniform(0, 40)))
            if rng.random() < 0.8
            else {"usable": False}
        )
        entries.append(entry(float(at_s), state, frame=1, **said))
        history.take(entries[-1])

    by_step = {}
    for one in entries:
        by_step.setdefault(int(one.at_s / STEP_S), []).append(one)

    last = max(by_step)
    assert history.since(0)[0].number >= last - HISTORY_S / STEP_S
    assert len(history.since(0)) > 500

    for step in history.since(0):
        within = by_step[step.number]
        good = [one for one in within if one.verdict and one.verdict.usable]
        assert step.force_mn == max((one.force_mn for one in good), default=None)
        assert step.low_mn == min((one.interval_mn[0] for one in good), default=None)
        assert step.high_mn == max((one.interval_mn[1] for one in good), default=None)
        states = {one.state for one in within}
        assert step.state == next(
            one for one in ("WITHDRAW", "NOT_READY", "WATCHING") if one in states
        )

    assert [step.number for step in history.since(last)] == [last]


def test_nan_changes_no_step_of_the_history():
    history = StepHistory()
    for low_mn, force_mn, high_mn in (
        (1.0, 2.0, 3.0),
        (float("nan"), None, 9.0),
        (0.5, 7.0, float("inf")),
    ):
        history.take(
            entry(
                0.01,
                frame=1,
                usable=True,
                predicted=1,
                force_mn=force_mn,
                interval_mn=(low_mn, high_mn),
            )
        )

    (step,) = history.since(0)
    assert step.as_json() == [0, 7.0, 0.5, 9.0, "WATCHING", 1]


def test_a_picture_is_the_frame_in_eight_bits_and_no_larger_than_a_screen():
    rng = np.random.default_rng(1)
    for rows, columns in ((40, 60), (2 * MOST_PIXELS, MOST_PIXELS)):
        ring = FrameRing.create(4, rows, columns)
        frame = rng.integers(0, 4000, (rows, columns), dtype=np.uint16)
        frame[:, :3] = 4000
        frame[: rows // 2] //= 2
        ring.put(1, frame)
        picture = FramePictures(ring).of(1, None, MOST_PIXELS)
        assert picture is not None
        shown = np.frombuffer(
            picture[4 + int.from_bytes(picture[:4], "little") :], np.uint8
        )

        if rows == 40:
            np.testing.assert_allclose(
                shown.reshape(rows, columns),
                np.minimum(frame * (255 / 4000), 255),
                atol=4.0,
            )

        assert len(shown) == min(rows, MOST_PIXELS) * min(columns, MOST_PIXELS)


class Guarded:
    """An app behind the guard: what it gets of an endless request, and the answer."""

    def __init__(self) -> None:
        self.taken = 0
        self.status = 0
        self.app = OwnPagesOnly(self._serve, "localhost", 4096, {"/file": 10_000})

    async def _serve(self, _: Scope, receive: Receive, send: Send) -> None:
        while (message := await receive())["type"] == "http.request":
            self.taken += len(message["body"])
        await send({"type": "http.response.start", "status": 200})

    def ask(
        self,
        headers: Sequence[tuple[str, str]],
        method: str = "GET",
        path: str = "/",
        kind: str = "http",
    ) -> int:
        """Return the status of an answer."""
        self.taken = 0

        async def endless() -> Message:
            return {"type": "http.request", "body": bytes(1000), "more_body": True}

        async def note(message: Message) -> None:
            self.status = message.get("status", self.status)

        scope = {
            "type": kind,
            "method": method,
            "path": path,
            "headers": [
                (name.encode(), value.encode("latin-1")) for name, value in headers
            ],
            "extensions": {"websocket.http.response": {}},
        }
        asyncio.run(self.app(scope, endless, note))
        return self.status


HERE = [("host", "localhost"), ("origin", "http://localhost")]
LENGTHS = ("4097", "99999999999999999999", "0000000000000000100000000", "01", "-1")
LENGTHS += ("+1", "1_0", " 1", "²", "")
OWN = "http://localhost:80"


@pytest.mark.parametrize(
    ("status", "method", "headers"),
    [
        *(
            (200, "GET", [("host", host)])
            for host in ("127.0.0.1:8080", "localhost", "LOCALHOST:1", "[::1]:8080")
        ),
        (200, "GET", [("host", "10.0.0.7")]),
        *(
            (403, "GET", [("host", host)])
            for host in (
                "evil.example:8080",
                "localhost.evil.example",
                "",
                "127.0.0.1.evil.example",
                "[evil]",
            )
        ),
        *((413, "POST", [*HERE, ("content-length", length)]) for length in LENGTHS),
        (413, "POST", HERE),
        (413, "GET", [*HERE, ("content-length", "100000000")]),
        *(
            (413, "GET", [*HERE, ("content-length", "2"), ("content-length", second)])
            for second in ("2", "999")
        ),
        *(
            (411, method, [*HERE, *more, ("transfer-encoding", coding)])
            for method in ("GET", "POST")
            for more in ([], [("content-length", "2")])
            for coding in ("chunked", "identity", "gzip, chunked", "")
        ),
        (403, "GET", [*HERE, ("origin", "http://evil.example")]),
        (403, "GET", [*HERE, ("host", "localhost")]),
    ],
)
def test_requests_come_from_own_names_and_with_a_stated_length(status, method, headers):
    assert Guarded().ask(headers, method) == status


@pytest.mark.parametrize(
    ("status", "origins"),
    [
        (200, [OWN]),
        *(
            (403, origins)
            for origins in (
                [],
                ["null"],
                ["http://localhost:81"],
                ["http://evil.example"],
                [OWN, OWN],
            )
        ),
    ],
)
def test_what_writes_comes_from_the_own_page(status, origins):
    headers = [("host", "localhost:80"), ("content-length", "2")]
    headers += [("origin", origin) for origin in origins]
    assert Guarded().ask(headers, "POST") == status


@pytest.mark.parametrize(
    ("path", "most_bytes"), [("/", 4096), ("/file", 10_000), ("/file/", 4096)]
)
def test_a_server_hands_on_no_more_bytes_than_a_request_may_have(path, most_bytes):
    """Whatever its headers state: the bytes that come are counted."""
    guarded = Guarded()
    guarded.ask([*HERE, ("content-length", "1")], "POST", path)
    assert 0 < guarded.taken <= most_bytes


def test_it_goes_down_a_level_a_second_at_most_and_comes_back_only_after_calm():
    thrift = Thrift()
    for times, begin_s, looks in (
        (3, 10.0, [(10.2, 1)]),
        (3, 10.3, [(10.6, 1)]),
        (3, 11.0, [(11.3, 2)]),
        (20, 11.4, [(13.4, 2), (18.2, 2), (18.4, 1), (18.5, 1), (23.5, 0)]),
    ):
        for n in range(times):
            thrift.woke(0.05, begin_s + 0.1 * n)
        assert [(at_s, thrift.share(at_s).level) for at_s, _ in looks] == looks
