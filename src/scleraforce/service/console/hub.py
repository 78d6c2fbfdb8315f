"""The console's end of the channel to the monitor: it puts messages on the board and sends resets."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from time import monotonic

from scleraforce.errors import MessageError
from scleraforce.service.companions.channel import Channel, ChannelClosedError
from scleraforce.service.companions.messages import (
    CompanionMessage,
    Decided,
    ResetAnswered,
    ResetAsked,
    SelfReport,
    WrongTokens,
)
from scleraforce.service.console.board import Board
from scleraforce.service.console.pictures import Pictures
from scleraforce.service.console.thrift import Thrift
from scleraforce.service.reset_token import ResetToken

ANSWER_S = 3.0
WRONG_S = 0.5  # delay of the answer to a wrong token
MOST_PAGES = 32

ResetAnswer = tuple[bool, str]


@dataclass(eq=False)
class PagePlace:
    """The place of one page.

    Attributes:
        wake: set when the page must be told at once.
        gone: set when the page must leave.
        heard_s: when it last sent something.
    """

    wake: asyncio.Event = field(default_factory=asyncio.Event)
    gone: asyncio.Event = field(default_factory=asyncio.Event)
    heard_s: float = field(default_factory=monotonic)


class Hub:
    """Connects the channel with the pages of one event loop; it never waits for a page, so the channel is always read.

    Args:
        channel: to the monitor.
        pictures: of its frames.
        token: of the operator's reset.
        when_ended: called once, when the monitor has ended or died.
    """

    def __init__(self, channel: Channel, pictures: Pictures, token: ResetToken, when_ended: Callable[[], None]) -> None:
        self.board, self.pictures, self.thrift = Board(monotonic()), pictures, Thrift()
        self.pages: set[PagePlace] = set()
        self._channel, self._token, self._when_ended = channel, token, when_ended
        self._numbers = count(1)
        self._waiting: dict[int, asyncio.Future[ResetAnswer]] = {}
        self._wrong_tokens = 0

    def listen(self) -> None:
        """Read the channel from now on."""
        asyncio.get_running_loop().add_reader(self._channel.fileno(), self.read)

    def tell(self, message: CompanionMessage) -> None:
        """Send a message to the monitor, if it still runs."""
        try:
            self._channel.send(message)
        except ChannelClosedError:
            self._end()

    def read(self) -> None:
        """Read all messages that wait in the channel; after one that is none, the board shows a silent monitor."""
        try:
            messages = self._channel.receive()
        except ChannelClosedError:
            self._end()
            return
        except MessageError as fault:
            self.tell(SelfReport(detail=f"the monitor does not keep to the protocol: {fault}"))
            return
        now_s = monotonic()
        urgent = False
        for message in messages:
            if isinstance(message, ResetAnswered):
                self._answer(message)
            if isinstance(message, Decided):
                self.thrift.answered(message.entry.latency_ms, message.entry.overtaken, now_s)
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

    def enter(self) -> PagePlace:
        """Return a place for a page; if all are taken, the page that has been silent longest loses its place."""
        if len(self.pages) >= MOST_PAGES:
            silent = min(self.pages, key=lambda page: page.heard_s)
            silent.gone.set()
            self.pages.discard(silent)
        place = PagePlace()
        self.pages.add(place)
        return place

    def _answer(self, answered: ResetAnswered) -> None:
        future = self._waiting.pop(answered.request, None)
        if future is not None and not future.done():
            future.set_result((answered.granted, answered.message))

    async def reset(self, token: str) -> ResetAnswer:
        """Ask the monitor for a reset; return whether it was granted, and the monitor's message.

        Only the right token reaches the monitor, so wrong ones can never keep the operator waiting.
        """
        if not self._token.knows(token):
            self._count_wrong()
            await asyncio.sleep(WRONG_S)
            return False, "the token is wrong; the monitor printed the right one at its start"
        number = next(self._numbers)
        future = self._waiting[number] = asyncio.get_running_loop().create_future()
        self.tell(ResetAsked(request=number, token=token))
        try:
            return await asyncio.wait_for(future, ANSWER_S)
        except TimeoutError:
            return False, "the monitor does not answer"
        finally:
            self._waiting.pop(number, None)

    def _count_wrong(self) -> None:
        """Count a wrong token; the monitor is told the number of those within `WRONG_S` at once."""
        self._wrong_tokens += 1
        if self._wrong_tokens == 1:
            asyncio.get_running_loop().call_later(WRONG_S, self._tell_wrong)

    def _tell_wrong(self) -> None:
        self.tell(WrongTokens(count=self._wrong_tokens))
        self._wrong_tokens = 0
