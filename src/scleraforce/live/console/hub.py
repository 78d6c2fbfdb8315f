"""The console's end of the channel to the monitor, its pictures, and the share of each
page.
"""

import asyncio
import json
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from time import monotonic
from typing import Any

import cv2
import numpy as np
from fastapi import WebSocket, WebSocketDisconnect

from scleraforce.base.errors import MessageError
from scleraforce.live.companions import process_messages
from scleraforce.live.companions.process_channel import Channel, ChannelClosedError
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.console.board import Board
from scleraforce.live.network.operator_reset import CODE, TOO_MANY, ResetToken

LATE_S = 0.015  # a wake-up of the console this late is a sign
SLOW_MS = 10.0  # an answer that takes longer, too
# signs within this time: the machine is short
SIGNS = 3
WITHIN_S = 1.0
HELD_S = 1.0  # at least, before less is shown again
CALM_S = 5.0  # without a sign, before more is shown again
WHITE_PERCENTILE = 99.5
# how slowly the white level fades from picture to picture, so that a single bright
# frame does not darken the next ones
FADING = 0.99
ANSWER_S = 3.0
# how much earlier than its turn a picture may come, since updates have their own rhythm
SLACK_S = 0.01
MOST_UNSEEN = 4  # messages under way that the page has not acknowledged
WRONG_S = 0.5  # delay of the answer to a wrong token
MOST_PAGES = 32

ResetAnswer = tuple[bool, str]


@dataclass(frozen=True, kw_only=True)
class PageShare:
    """The share of a page: at most one update every `update_s`, one picture every
    `picture_s`, of `pixels` a side.
    """

    level: int
    update_s: float
    picture_s: float
    pixels: int


SHARES = (
    PageShare(level=0, update_s=1 / 30, picture_s=1 / 30, pixels=640),
    PageShare(level=1, update_s=0.1, picture_s=0.2, pixels=320),
    PageShare(
        level=2, update_s=0.2, picture_s=0.5, pixels=320
    ),  # slower, and a page would call it not live
)


class Thrift:
    """Chooses the share of the pages by signs that the machine is short."""

    def __init__(self) -> None:
        self._signs: deque[float] = deque(maxlen=SIGNS)
        self._level = 0
        self._since_s = float("-inf")
        self._behind = 0

    def woke(self, late_s: float, now_s: float) -> None:
        """Take the delay of a wake-up of the console."""
        if late_s > LATE_S:
            self._signs.append(now_s)

    def answered(self, latency_ms: float | None, behind: int, now_s: float) -> None:
        """Take the latency of an answer, and the number of frames that were overtaken
        since the start.
        """
        if behind > self._behind or (latency_ms is not None and latency_ms > SLOW_MS):
            self._signs.append(now_s)
        self._behind = behind

    def share(self, now_s: float) -> PageShare:
        """Return the share from now on."""
        held = now_s - self._since_s >= HELD_S
        short = len(self._signs) == SIGNS and now_s - self._signs[0] <= WITHIN_S
        calm = not self._signs or now_s - self._signs[-1] > CALM_S

        if short and held and self._level < len(SHARES) - 1:
            self._level = self._level + 1
            self._since_s = now_s
            self._signs.clear()
        elif calm and self._level and now_s - self._since_s > CALM_S:
            self._level = self._level - 1
            self._since_s = now_s

        return SHARES[self._level]


class FramePictures:
    """Makes pictures of frames, each once, however many pages show it.

    A picture is the length of its header (4 bytes, little-endian), the header (JSON:
    `frame`, its `plane`, `rows`, `columns` of the pixels that follow, `outline`), the
    pixels (row, column), one byte each.
    """

    def __init__(self, ring: FrameRing) -> None:
        self._ring = ring
        self._made: tuple[tuple[int, int], bytes] = ((0, 0), b"")
        self._white = 1.0

    def of(
        self, frame: int, outline: process_messages.Outline | None, most_pixels: int
    ) -> bytes | None:
        """Return the picture of a frame, of `most_pixels` along either side; None if
        the frame is gone.
        """
        if self._made[0] == (frame, most_pixels):
            return self._made[1]

        pixels = self._ring.get(frame)
        if pixels is None:
            return None

        white = float(np.percentile(pixels[::4, ::4], WHITE_PERCENTILE))
        self._white = max(white, FADING * self._white, 1.0)

        rows, columns = (min(length, most_pixels) for length in pixels.shape)
        if (rows, columns) != pixels.shape:
            pixels = cv2.resize(
                pixels, (columns, rows), interpolation=cv2.INTER_AREA
            ).astype(np.uint16)

        shown = cv2.convertScaleAbs(pixels, alpha=255 / self._white)
        lines = (
            {"step": outline.step, "outer": outline.outer, "inner": outline.inner}
            if outline
            else None
        )
        plane = outline.plane if outline else None
        header = json.dumps(
            {
                "frame": frame,
                "plane": plane,
                "rows": rows,
                "columns": columns,
                "outline": lines,
            }
        ).encode()
        self._made = (
            (frame, most_pixels),
            len(header).to_bytes(4, "little") + header + shown.tobytes(),
        )

        return self._made[1]


class Hub:
    """Connects the channel with the pages of one event loop; it never waits for a page,
    so the channel is always read.

    `when_ended` is called once, when the monitor has ended or died.
    """

    def __init__(
        self,
        channel: Channel,
        pictures: FramePictures,
        token: ResetToken,
        when_ended: Callable[[], None],
    ) -> None:
        self.board = Board(monotonic())
        self.pictures = pictures
        self.thrift = Thrift()
        self.pages: set[OpenPage] = set()
        self._channel = channel
        self._token = token
        self._when_ended = when_ended
        self._numbers = count(1)
        self._waiting: dict[int, asyncio.Future[ResetAnswer]] = {}
        self._wrong_tokens = 0

    def listen(self) -> None:
        """Read the channel from now on."""
        asyncio.get_running_loop().add_reader(self._channel.fileno(), self.read)

    def send(self, message: process_messages.CompanionMessage) -> None:
        """Send a message to the monitor, if it still runs."""
        try:
            self._channel.send(message)
        except ChannelClosedError:
            self._end()

    def read(self) -> None:
        """Read all messages that wait in the channel; after an invalid one, the board
        shows a silent monitor.
        """
        try:
            heard = self._channel.receive()
        except ChannelClosedError:
            self._end()
            return
        except MessageError as fault:
            self.send(
                process_messages.SelfReport(
                    detail=f"the monitor does not keep to the protocol: {fault}"
                )
            )
            return

        now_s = monotonic()
        urgent = False

        for message in heard:
            if isinstance(message, process_messages.ResetAnswered):
                future = self._waiting.pop(message.request, None)
                if future is not None and not future.done():
                    future.set_result((message.granted, message.message))

            if isinstance(message, process_messages.Decided):
                self.thrift.answered(
                    message.entry.latency_ms, message.entry.overtaken, now_s
                )

            urgent = self.board.take(message, now_s) or urgent

        if urgent:
            self._wake()

    def _end(self) -> None:
        if not asyncio.get_running_loop().remove_reader(self._channel.fileno()):
            return

        self.board.end()
        for future in self._waiting.values():
            future.set_result((False, "the monitor has ended"))

        self._waiting.clear()
        self._wake()
        self._when_ended()

    def _wake(self) -> None:
        for page in self.pages:
            page.wake.set()

    def enter(self, page: "OpenPage") -> None:
        """Give a page a place; if all are taken, the page that has been silent longest
        loses its place.
        """
        if len(self.pages) >= MOST_PAGES:
            silent = min(self.pages, key=lambda page: page.heard_s)
            silent.gone.set()
            self.pages.discard(silent)
        self.pages.add(page)

    async def reset(self, token: str) -> ResetAnswer:
        """Ask the monitor for a reset; return whether it was granted, and the monitor's
        message.

        Only the right token and a few codes reach the monitor, so wrong ones can never
        keep the operator waiting.
        """
        is_code = bool(CODE.fullmatch(token))
        too_many = is_code and not self._token.answers_wrong(monotonic())
        if (too_many or not is_code) and not self._token.knows(token):
            self._wrong_tokens += 1
            if self._wrong_tokens == 1:
                # the monitor gets one message on all that come within `WRONG_S`
                asyncio.get_running_loop().call_later(WRONG_S, self._send_wrong)

            await asyncio.sleep(WRONG_S)
            wrong = "the token or code is wrong; the monitor printed the right ones"
            return False, TOO_MANY if too_many else wrong

        number = next(self._numbers)
        future = self._waiting[number] = asyncio.get_running_loop().create_future()
        self.send(process_messages.ResetAsked(request=number, token=token))

        try:
            return await asyncio.wait_for(future, ANSWER_S)
        except TimeoutError:
            return False, "the monitor does not answer"
        finally:
            self._waiting.pop(number, None)

    def _send_wrong(self) -> None:
        self.send(process_messages.WrongTokens(count=self._wrong_tokens))
        self._wrong_tokens = 0


@dataclass(eq=False)
class OpenPage:
    """An open page: its accepted `socket`, and what it was sent and has acknowledged.

    A page answers each message with `{"seen": number}` and each picture with `{"drawn":
    frame}`. A page that stalls gets nothing until it answers, and then the newest
    state. `wake` sends the newest state at once; `gone` closes the page; `heard_s` is
    when it last sent something. `picture` is the last frame sent; of the history, the
    page has all before number `step`.
    """

    socket: WebSocket
    hub: Hub
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    gone: asyncio.Event = field(default_factory=asyncio.Event)
    heard_s: float = field(default_factory=monotonic)
    sent: int = 0
    seen: int = 0
    picture: int = 0
    drawn: int = 0
    pictured_s: float = 0.0
    step: int = 0

    async def show(self, settings: dict[str, Any]) -> None:
        """Send all that the page shows, until it leaves or loses its place to
        another.
        """
        self.hub.enter(self)
        tasks: list[asyncio.Task[Any]] = []

        try:
            await self.socket.send_text(json.dumps({"kind": "hello", **settings}))
            tasks = [
                asyncio.create_task(work)
                for work in (self._send(), self._hear(), self.gone.wait())
            ]
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        except WebSocketDisconnect:
            return
        finally:
            self.hub.pages.discard(self)
            for task in tasks:
                task.cancel()

        ends = await asyncio.gather(*tasks, return_exceptions=True)
        if any(isinstance(end, WebSocketDisconnect) for end in ends):
            return  # the page left; the other task's error follows from that

        for end in ends:
            if isinstance(end, Exception):
                raise end

        if self.gone.is_set():
            await self.socket.close(1013, "too many pages")
        elif ends[1] is None:  # it sent something that our page never sends
            await self.socket.close(1008)

    @property
    def _keeps_up(self) -> bool:
        return self.sent - self.seen < MOST_UNSEEN

    async def _send(self) -> None:
        while True:
            self.wake.clear()
            share = self.hub.thrift.share(monotonic())

            if self._keeps_up:
                state = self.hub.board.as_json(monotonic(), self.step)
                if state["steps"]:
                    self.step = state["steps"][-1][0]  # which may still change

                self.sent += 1
                await self.socket.send_text(
                    json.dumps({**state, "thrift": share.level, "number": self.sent})
                )
                await self._send_picture(share)

            due_s = monotonic() + share.update_s
            try:
                await asyncio.wait_for(self.wake.wait(), share.update_s)
            except TimeoutError:
                now_s = monotonic()
                self.hub.thrift.woke(now_s - due_s, now_s)

    async def _send_picture(self, share: PageShare) -> None:
        chosen = self.hub.board.picture()
        now_s = monotonic()
        if chosen is None or self.drawn != self.picture or chosen[0] == self.picture:
            return
        if now_s - self.pictured_s < share.picture_s - SLACK_S:
            return

        picture = self.hub.pictures.of(*chosen, share.pixels)
        if picture is not None:
            self.picture = chosen[0]
            self.pictured_s = now_s
            await self.socket.send_bytes(picture)

    async def _hear(self) -> None:
        """Take the page's answers; return if it sends anything else."""
        while True:
            try:
                answer = json.loads(await self.socket.receive_text())
            except (ValueError, KeyError, RecursionError):  # no JSON, or no text
                return

            self.heard_s = monotonic()
            seen, drawn = (
                answer.get(name) if isinstance(answer, dict) else None
                for name in ("seen", "drawn")
            )
            stalled = not self._keeps_up

            if isinstance(seen, int):
                self.seen = max(self.seen, min(seen, self.sent))
            elif isinstance(drawn, int):
                self.drawn = drawn
            else:
                return

            if stalled and self._keeps_up:
                self.wake.set()
