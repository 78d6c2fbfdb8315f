"""`scleraforce app`: the same in a browser."""

import secrets
import webbrowser
from importlib.util import find_spec
from pathlib import Path

import click

from scleraforce.cli.options import PATH
from scleraforce.cli.output import Command, say
from scleraforce.errors import InputError


@click.command(cls=Command)
@click.argument("folder", type=PATH, default=Path(), metavar="[FOLDER]")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port to listen on; default: a free one.")
@click.option("--open/--no-open", "opens", default=True, help="Open the page in the browser; default: yes.")
def app(folder: Path, port: int, opens: bool) -> None:
    """Import, look, correct, calibrate and read in a browser.

    FOLDER holds the recordings, by default the present one. The page is served
    on this machine alone, to whoever has the address that is printed. Ctrl-C
    ends it. It needs the extra [web].
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; make it, or give another one")
    if missing := [name for name in ("fastapi", "uvicorn") if find_spec(name) is None]:
        raise InputError(f"app: {missing[0]} is not installed; run pip install 'scleraforce[web]'")
    from scleraforce.app.server import HOST, listen, server_of

    token, listener = secrets.token_urlsafe(24), listen(port)
    address = f"http://{HOST}:{listener.getsockname()[1]}/?token={token}"
    say(f"open {address}\nCtrl-C ends it")
    if opens:
        webbrowser.open(address)
    server_of(folder, listener, token).run([listener])
