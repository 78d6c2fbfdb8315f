"""The console's process: the web server and the channel in one event loop."""

import asyncio
import os
import socket

import uvicorn

from scleraforce.service.companions.channel import Channel
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.messages import ConsoleSettings, ListensAt
from scleraforce.service.console.app import console_app
from scleraforce.service.console.connections import NewestConnections
from scleraforce.service.console.hub import Hub
from scleraforce.service.console.pictures import Pictures
from scleraforce.service.reset_token import ResetToken

LAST_WORDS_S = 1.0  # in which pages learn that the monitor has ended
NICENESS = 5  # the monitor comes first
MOST_MESSAGE_BYTES = 4096


def serve(channel: Channel, settings: ConsoleSettings) -> int:
    """Serve until the monitor has ended; return the exit code."""
    os.nice(NICENESS)
    asyncio.run(_serve(channel, settings, socket.socket(fileno=settings.listener)))
    return 0


async def _serve(channel: Channel, settings: ConsoleSettings, listener: socket.socket) -> None:
    loop = asyncio.get_running_loop()

    def end() -> None:
        loop.call_later(LAST_WORDS_S if hub.pages else 0.0, setattr, server, "should_exit", True)

    hub = Hub(channel, Pictures(FrameRing.at(settings.ring)), ResetToken(settings.token_digest), end)
    server = uvicorn.Server(
        uvicorn.Config(
            console_app(hub, settings),
            http=NewestConnections,
            lifespan="off",
            log_level="critical",  # what strangers send is not to fill the terminal
            access_log=False,
            server_header=False,
            proxy_headers=False,
            ws_max_size=MOST_MESSAGE_BYTES,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=1,
        )
    )
    hub.listen()
    hub.tell(ListensAt(url=_url(settings.host, listener.getsockname()[1])))
    await server.serve([listener])


def _url(host: str, port: int) -> str:
    return f"http://[{host}]:{port}/" if ":" in host else f"http://{host}:{port}/"
