"""Access to the console, for its own pages alone, and the headers that restrict the browser."""

from collections.abc import Awaitable, Callable, MutableMapping
from ipaddress import ip_address
from typing import Any

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

MOST_BODY_BYTES = 4096
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'"
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


def refusal(kind: str, method: str, headers: list[tuple[bytes, bytes]], name: str) -> tuple[int, str] | None:
    """Return status and reason of the refusal of a request; None if it is accepted.

    A page of another site may point its own name to this address (DNS rebinding); then `Host` has that name. An
    address cannot be rebound, so every address is accepted; of the names, only `localhost` and the console's own.

    Args:
        kind: "http" or "websocket".
        method: of HTTP.
        headers: names in lower case.
        name: the host that the console listens on.
    """
    found: dict[bytes, list[str]] = {}
    for key, value in headers:
        found.setdefault(key, []).append(value.decode("latin-1"))
    hosts, origins = found.get(b"host", []), found.get(b"origin", [])
    if len(hosts) != 1 or not _own(hosts[0], name):
        return 403, "this host name is not the console's"
    writes = kind == "websocket" or method not in ("GET", "HEAD")
    if (origins or writes) and origins not in ([f"http://{hosts[0]}"], [f"https://{hosts[0]}"]):
        return 403, "only the console's own page may ask"
    if kind == "http" and writes:
        length = "".join(found.get(b"content-length", []))
        if not (length.isascii() and length.isdigit() and int(length[:9]) <= MOST_BODY_BYTES):
            return 413, f"a request needs a Content-Length of at most {MOST_BODY_BYTES} bytes"
    return None


def _own(host: str, name: str) -> bool:
    bare = host[1:].partition("]")[0] if host.startswith("[") else host.partition(":")[0]
    try:
        ip_address(bare)
    except ValueError:
        return bare.lower() in ("localhost", name.lower())
    return True


class OwnPagesOnly:
    """Wraps an ASGI application: refuses what `refusal` refuses, adds `HEADERS` to every answer."""

    def __init__(self, app: App, name: str) -> None:
        self._app, self._name = app, name

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: D102
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = [(key.encode(), value.encode()) for key, value in HEADERS.items()]
                message["headers"] = [*message.get("headers", []), *own]
            await send(message)

        refused = refusal(scope["type"], scope.get("method", "GET"), scope["headers"], self._name)
        if refused is None:
            await self._app(scope, receive, send_with_headers)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})  # before it is accepted: an answer 403
        else:
            status, reason = refused
            plain = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
            await send_with_headers({"type": "http.response.start", "status": status, "headers": plain})
            await send({"type": "http.response.body", "body": reason.encode()})
