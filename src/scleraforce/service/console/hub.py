"""The console's end of the channel to the monitor: what comes is put on the board, resets are sent and answered."""

import asyncio
from collections.abc import Callable
from itertools import count
from time import monotonic
from typing import Any

from scleraforce.service.channel import Channel, ChannelClosedError
from scleraforce.service.console.board import Board
from scleraforce.service.console.pictures import Pictures

__all__ = ["Hub", "ResetAnswer"]

ANSWER_S = 3.0
REFUSED_S = 0.5  # until the next try: a token is not to be guessed

ResetAnswer = tuple[bool, str]


class Hub:
    """Belongs to one event loop; nothing here waits for a page, so that the channel is always read.

    Args:
        channel: to the monitor.
        pictures: of its frames.
        when_ended: called once, when the monitor has ended or died.
    """

    def __init__(self, channel: Channel, pictures: Pictures, when_ended: Callable[[], None]) -> None:
        self.board, self.pictures = Board(monotonic()), pictures
        self.pages: set[asyncio.Event] = set()  # of each page, to be set where it has to be told at once
        self._channel, self._when_ended = channel, when_ended
        self._numbers = count(1)
        self._waiting: dict[int, asyncio.Future[ResetAnswer]] = {}
        self._one_reset = asyncio.Lock()
        self._next_reset_s = 0.0

    def listen(self) -> None:
        """Read the channel from now on."""
        asyncio.get_running_loop().add_reader(self._channel.fileno(), self.read)

    def tell(self, message: dict[str, Any]) -> None:
        """Tell the monitor something; nothing where it has gone."""
        try:
            self._channel.send(message)
        except ChannelClosedError:
            self._end()

    def read(self) -> None:
        """Take all that waits in the channel."""
        try:
            messages = self._channel.receive()
        except ChannelClosedError:
            self._end()
            return
        now_s = monotonic()
        urgent = False
        for message in messages:
            if message["kind"] == "reset-answer":
                self._answer(message)
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
            page.set()

    def _answer(self, message: dict[str, Any]) -> None:
        future = self._waiting.pop(message["request"], None)
        if future is not None and not future.done():
            future.set_result((bool(message["granted"]), str(message["message"])))

    async def reset(self, token: str) -> ResetAnswer:
        """Ask the monitor for a reset; return whether it was granted, and what the monitor says."""
        async with self._one_reset:
            await asyncio.sleep(max(0.0, self._next_reset_s - monotonic()))
            number = next(self._numbers)
            future = self._waiting[number] = asyncio.get_running_loop().create_future()
            self.tell({"kind": "reset", "request": number, "token": token})
            try:
                granted, said = await asyncio.wait_for(future, ANSWER_S)
            except TimeoutError:
                granted, said = False, "the monitor does not answer"
            finally:
                self._waiting.pop(number, None)
            if not granted:
                self._next_reset_s = monotonic() + REFUSED_S
            return granted, said
