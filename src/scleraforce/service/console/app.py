"""The console's web application: one static page, its WebSocket, and the reset."""

from importlib.resources import files
from typing import Any

from fastapi import FastAPI, Response, WebSocket
from pydantic import BaseModel, Field

from scleraforce.service.companions.messages import ConsoleSettings
from scleraforce.service.console.hub import Hub
from scleraforce.service.console.origin import OwnPagesOnly
from scleraforce.service.console.pages import show

TYPES = {"html": "text/html", "js": "text/javascript", "css": "text/css", "svg": "image/svg+xml"}


class _Reset(BaseModel):
    """The operator's request."""

    token: str = Field(max_length=200)


def console_app(hub: Hub, settings: ConsoleSettings) -> OwnPagesOnly:
    """Return the application.

    Args:
        hub: the connection to the monitor.
        settings: of the console.
    """
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    assets = {
        entry.name: entry.read_bytes()
        for entry in files("scleraforce.service.console").joinpath("page").iterdir()
        if entry.name.rpartition(".")[2] in TYPES
    }

    @app.get("/")
    async def page() -> Response:
        return Response(assets["index.html"], media_type="text/html")

    @app.get("/{name}")
    async def asset(name: str) -> Response:
        if name not in assets:
            return Response("there is no such page", 404, media_type="text/plain")
        return Response(assets[name], media_type=TYPES[name.rpartition(".")[2]])

    @app.post("/reset")
    async def reset(asked: _Reset) -> dict[str, Any]:
        granted, said = await hub.reset(asked.token)
        return {"granted": granted, "message": said}

    @app.websocket("/live")
    async def live(socket: WebSocket) -> None:
        await socket.accept()
        await show(socket, hub, settings.for_page())

    return OwnPagesOnly(app, settings.host)
