"""A limit on the console's connections, within which the newest one always has a place."""

import asyncio
from collections import deque

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

MOST = 128  # of each kind; more WebSockets than there are places for pages, because some are being closed

_requests, _sockets = deque[asyncio.Transport](), deque[asyncio.Transport]()  # oldest first; of the console's process


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
