"""The web server of the console: its own pages alone, the newest connections, one event
loop.
"""

import asyncio
import os
import re
import socket
from collections import deque
from collections.abc import Mapping
from ipaddress import ip_address
from types import MappingProxyType
from typing import Any

import h11
import uvicorn
from fastapi import FastAPI, WebSocket
from fastapi.staticfiles import StaticFiles
from pydantic import BaseModel, Field
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from scleraforce.live.companions.process_channel import Channel, run_companion
from scleraforce.live.companions.process_messages import ConsoleSettings, ListensAt
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.console.hub import FramePictures, Hub, OpenPage
from scleraforce.live.network.operator_reset import ResetToken

MOST_BODY_BYTES = 4096
TOO_LONG = 413  # status of an answer
LENGTH = re.compile("0|[1-9][0-9]{0,14}")  # a Content-Length
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self';"
    " connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), geolocation=(), microphone=()",
    "cache-control": "no-store",
}
# maximum connections of each kind; more WebSockets than places for pages, because some
# are being closed
MOST = 128

# oldest first; of the console's process
_requests = deque[asyncio.Transport]()
_sockets = deque[asyncio.Transport]()
LAST_WORDS_S = 1.0  # in which pages learn that the monitor has ended
NICENESS = 5  # the monitor comes first
MOST_MESSAGE_BYTES = 4096


def refusal(
    kind: str,
    method: str,
    headers: list[tuple[bytes, bytes]],
    name: str,
    most_bytes: int = MOST_BODY_BYTES,
) -> tuple[int, str] | None:
    """Return status and reason of the refusal of a request; None if it is accepted.

    A page of another site may point its own name to this address (DNS rebinding); then
    `Host` has that name. An address cannot be rebound, so every address is accepted; of
    the names, only `localhost` and `name`, the console's own. `kind` is "http" or
    "websocket"; the headers' names are in lower case.
    """
    found: dict[bytes, list[str]] = {}
    for key, value in headers:
        found.setdefault(key, []).append(value.decode("latin-1"))

    hosts = found.get(b"host", [])
    origins = found.get(b"origin", [])
    if len(hosts) != 1 or not _own(hosts[0], name):
        return 403, "this host name is not the console's"

    writes = kind == "websocket" or method not in ("GET", "HEAD")
    if (origins or writes) and origins not in (
        [f"http://{hosts[0]}"],
        [f"https://{hosts[0]}"],
    ):
        return 403, "only the console's own page may ask"

    if b"transfer-encoding" in found:
        return 411, "a request needs a Content-Length, and no Transfer-Encoding"

    lengths = found.get(b"content-length", [])
    needs_length = kind == "http" and writes
    if (
        len(lengths) > 1
        or (needs_length and not lengths)
        or not all(
            LENGTH.fullmatch(length) and int(length) <= most_bytes for length in lengths
        )
    ):
        return (
            TOO_LONG,
            f"a request needs a Content-Length of at most {most_bytes} bytes",
        )

    return None


def _own(host: str, name: str) -> bool:
    bare = (
        host[1:].partition("]")[0] if host.startswith("[") else host.partition(":")[0]
    )
    try:
        ip_address(bare)
    except ValueError:
        return bare.lower() in ("localhost", name.lower())

    return True


class OwnPagesOnly:
    """Wraps an ASGI application: refuses what `refusal` refuses and what is longer than
    it may be, adds `HEADERS` to every answer.

    `most_bytes` is the limit of a request's body, `longer` that of some paths.
    """

    def __init__(
        self,
        app: ASGIApp,
        name: str,
        most_bytes: int = MOST_BODY_BYTES,
        longer: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        self._app = app
        self._name = name
        self._most_bytes = most_bytes
        self._longer = longer

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(key.encode(), value.encode()) for key, value in HEADERS.items()]
                message["headers"] = [*message.get("headers", []), *own]
            await send(message)

        most_bytes = self._longer.get(scope["path"], self._most_bytes)
        left = most_bytes

        async def receive_counted() -> Message:
            nonlocal left
            message = await receive()
            left -= len(message.get("body", b""))
            # its sender is treated as one that has gone
            return message if left >= 0 else {"type": "http.disconnect"}

        refused = refusal(
            scope["type"],
            scope.get("method", "GET"),
            scope["headers"],
            self._name,
            most_bytes,
        )
        if refused is None:
            counts = scope["type"] == "http"
            await self._app(
                scope, receive_counted if counts else receive, send_with_headers
            )
        elif scope["type"] == "websocket":
            await receive()
            # before it is accepted: an answer 403
            await send({"type": "websocket.close", "code": 1008})
        else:
            status, reason = refused
            plain = [(b"content-type", b"text/plain; charset=utf-8")]
            if status != TOO_LONG:  # whose rest is thrown away, so that it is answered
                plain.append((b"connection", b"close"))
            await send_with_headers(
                {"type": "http.response.start", "status": status, "headers": plain}
            )
            await send({"type": "http.response.body", "body": reason.encode()})


class NewestConnections(H11Protocol):
    """Accepts every new connection; if there are too many, the oldest is cut off.

    A server that refused the newest one instead could be blocked by silent connections.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]  # as uvicorn's own
        """Accept a connection."""
        super().connection_made(transport)
        _enter(_requests, transport)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Let a connection become a WebSocket."""
        _requests.remove(self.transport)
        _enter(_sockets, self.transport)
        super().handle_websocket_upgrade(event)


def _enter(connections: deque[asyncio.Transport], newest: asyncio.Transport) -> None:
    for closed in [transport for transport in connections if transport.is_closing()]:
        connections.remove(closed)
    connections.append(newest)
    if len(connections) > MOST:
        connections.popleft().abort()


class _ResetRequest(BaseModel):
    """The operator's request."""

    token: str = Field(max_length=200)


def console_app(hub: Hub, settings: ConsoleSettings) -> OwnPagesOnly:
    """Return the application."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @app.post("/reset")
    async def reset(asked: _ResetRequest) -> dict[str, Any]:
        granted, message = await hub.reset(asked.token)
        return {"granted": granted, "message": message}

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        await socket.accept()
        await OpenPage(socket, hub).show(settings.for_page())

    app.mount(
        "/", StaticFiles(packages=[("scleraforce.live.console", "page")], html=True)
    )
    return OwnPagesOnly(app, settings.host)


def run_console(channel: Channel, settings: ConsoleSettings) -> None:
    """Serve until the monitor has ended."""
    os.nice(NICENESS)
    asyncio.run(_serve(channel, settings, socket.socket(fileno=settings.listener)))


async def _serve(
    channel: Channel, settings: ConsoleSettings, listener: socket.socket
) -> None:
    loop = asyncio.get_running_loop()

    def end() -> None:
        loop.call_later(
            LAST_WORDS_S if hub.pages else 0.0, setattr, server, "should_exit", True
        )

    hub = Hub(
        channel,
        FramePictures(FrameRing(settings.ring)),
        ResetToken(settings.token_digest),
        end,
    )
    config = uvicorn.Config(
        console_app(hub, settings),
        http=NewestConnections,
        lifespan="off",
        timeout_graceful_shutdown=1,
        log_level="critical",  # what strangers send is not to fill the terminal
        access_log=False,
        server_header=False,
        proxy_headers=False,
        ws_max_size=MOST_MESSAGE_BYTES,
        ws_per_message_deflate=False,
    )
    server = uvicorn.Server(config)
    hub.listen()
    host = f"[{settings.host}]" if ":" in settings.host else settings.host
    hub.send(ListensAt(url=f"http://{host}:{listener.getsockname()[1]}/"))
    await server.serve([listener])


if __name__ == "__main__":
    run_companion(ConsoleSettings, run_console)
