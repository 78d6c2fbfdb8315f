"""The end of a request: work that nobody waits for any more ends at its next step."""

import asyncio
from contextlib import suppress
from contextvars import ContextVar
from threading import Event

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from scleraforce.base.errors import InputError

AHEAD = 4  # messages of a body that wait for the application: it sets the pace

_ended: ContextVar[Event | None] = ContextVar("ended", default=None)


class RequestEndedError(InputError):
    """The page that asked has gone."""


def check_wanted() -> None:
    """Raise a `RequestEndedError` if the request that this thread works for has ended;
    to be called between the steps of long work.
    """
    ended = _ended.get()
    if ended is not None and ended.is_set():
        raise RequestEndedError("the page that asked has gone")


class EndsWithRequest:
    """Wraps an ASGI application: listens to each client while the application works, so
    that `check_wanted` knows.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        ended = Event()
        messages = asyncio.Queue[Message](AHEAD)

        async def listen() -> None:
            while True:
                message = await receive()
                if message["type"] == "http.disconnect":
                    ended.set()
                await messages.put(message)

        _ended.set(ended)  # of this request's task, and of the threads that it asks
        listener = asyncio.create_task(listen())
        try:
            await self._app(scope, messages.get, send)
        finally:
            listener.cancel()
            with suppress(asyncio.CancelledError):
                await listener
