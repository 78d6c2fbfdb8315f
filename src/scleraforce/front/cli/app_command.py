"""`scleraforce app`: import, look, correct, calibrate and read in a browser."""

import secrets
import webbrowser
from importlib.util import find_spec
from pathlib import Path

import click

from scleraforce.base.errors import InputError
from scleraforce.front.cli.field_flags import flag_of, json_in_flags
from scleraforce.front.cli.options import PATH
from scleraforce.front.cli.output import Command, say


@click.command(cls=Command)
@click.argument("folder", type=PATH, default=Path(), metavar="[FOLDER]")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    help="Port to listen on; default: a free one.",
)
@click.option(
    "--open/--no-open",
    "opens",
    default=True,
    help="Open the page in the browser; default: yes.",
)
def app(folder: Path, port: int, opens: bool) -> None:
    """Import, look, correct, calibrate and read in a browser.

    FOLDER holds the recordings; default: the current folder. The server listens
    on this machine only and answers whoever has the printed address. Stop it
    with Ctrl-C. Needs the extra [web]; runs on Linux and macOS.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; make it, or give another one")
    if find_spec("termios") is None:
        raise InputError("app: does not run on Windows; use the commands, or WSL")
    if missing := [name for name in ("fastapi", "uvicorn") if find_spec(name) is None]:
        raise InputError(
            f"app: {missing[0]} is not installed; run pip install 'scleraforce[web]'"
        )

    # 760 ms: FastAPI and the readers, not for --help
    from scleraforce.front.app.app_server import HOST, listen_locally, server_of
    from scleraforce.front.app.asked_jobs import CommandWords

    listener = listen_locally(port)
    token = secrets.token_urlsafe(24)
    once = secrets.token_urlsafe(24)
    address = f"http://{HOST}:{listener.getsockname()[1]}/?token="
    say(f"open {address}{token}\nCtrl-C ends it")

    if opens:  # other users see the arguments of a browser: its token is valid once
        webbrowser.open(address + once)

    spelled = CommandWords(flag_of, json_in_flags)
    server_of(folder, listener, token, spelled, once if opens else "").run([listener])
