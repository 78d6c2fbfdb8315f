"""`scleraforce monitor-reset`: the operator's reset, from a terminal."""

import click

from scleraforce.cli.output import print_json, say
from scleraforce.errors import InputError


@click.command()
@click.option("--token", required=True, help="As the monitor printed it when it started.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Where the monitor listens.")
@click.option("--port", type=click.IntRange(1, 65535), default=18944, show_default=True)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def monitor_reset(token: str, host: str, port: int, as_json: bool) -> None:
    """Ask the monitor to leave a withdrawal.

    It is granted only while fresh frames come that are usable and harmless;
    otherwise the exit code is 2, and the answer says why.

    Example: scleraforce monitor-reset --token 3f0c52e6b91d4a78a1c6e0972bd85f14
    """
    from scleraforce.service.operator import ask_reset

    granted, message = ask_reset(host, port, token)
    if as_json:
        print_json({"granted": granted, "message": message})
    if not granted:
        raise InputError(f"{host}:{port}: {message}")
    if not as_json:
        say(f"reset: {message}")
