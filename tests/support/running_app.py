"""The app in a thread, with a client that has its cookie."""

import http.client
import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import pytest
from waiting import FUSE_S

from scleraforce.front.app.app_server import HOST, listen_locally, server_of
from scleraforce.front.app.asked_jobs import CommandWords
from scleraforce.front.cli.main import run

TOKEN = "t" * 32


@cache
def spelled() -> CommandWords:
    """The spelling of fields that the command `app` hands down."""
    handed: list[CommandWords] = []

    def server(_: Path, listener: Any, __: str, words: CommandWords, ___: str) -> Any:
        handed.append(words)
        return SimpleNamespace(run=lambda _: listener.close())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("scleraforce.front.app.app_server.server_of", server)
        assert run(["app", str(Path(__file__).parent), "--no-open", "--quiet"]) == 0

    return handed[0]


class Client:
    """Requests of one tab."""

    def __init__(self, port: int, tab: str = "tab-1") -> None:
        self.port = port
        self.tab = tab
        self.cookie = ""

    def ask(
        self, method: str, path: str, body: Any = None, **headers: str
    ) -> tuple[int, bytes, dict[str, str]]:
        """Send a request as the page would; return status, body and headers."""
        link = http.client.HTTPConnection(HOST, self.port, timeout=FUSE_S)
        data = (
            body
            if isinstance(body, bytes)
            else b""
            if body is None
            else json.dumps(body).encode()
        )
        own = {
            "Origin": f"http://{HOST}:{self.port}",
            "Content-Type": "application/json",
            "X-Tab": self.tab,
        }
        own |= {"Cookie": self.cookie} if self.cookie else {}
        given = {key.replace("_", "-"): value for key, value in headers.items()}
        link.request(
            method,
            path,
            data,
            {key: value for key, value in {**own, **given}.items() if value},
        )
        answer = link.getresponse()
        found = (
            answer.status,
            answer.read(),
            {key.lower(): value for key, value in answer.getheaders()},
        )
        link.close()

        return found

    def open(self, token: str = TOKEN) -> "Client":
        """Exchange the token for the cookie."""
        _, _, headers = self.ask("GET", f"/?token={token}")
        self.cookie = headers.get("set-cookie", "").partition(";")[0]
        return self

    def json(self, method: str, path: str, body: Any = None) -> Any:
        """Return an answer, which has to be one."""
        status, text, _ = self.ask(method, path, body)
        assert status == 200, text
        return json.loads(text)


@contextmanager
def running_app(folder: Path, once: str = "") -> Iterator[Client]:
    """Serve a folder."""
    listener = listen_locally(0)
    server = server_of(folder, listener, TOKEN, spelled(), once)
    thread = Thread(target=server.run, args=([listener],), daemon=True)
    thread.start()

    try:
        yield Client(listener.getsockname()[1])
    finally:
        # it closes its sockets in two tenths of a second, while the next test begins
        server.should_exit = True
