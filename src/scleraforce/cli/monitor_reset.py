"""`scleraforce monitor-reset`: the operator's reset, from a terminal."""

import click

from scleraforce.cli.options import options
from scleraforce.cli.output import Command, Report
from scleraforce.errors import InputError


@click.command(cls=Command)
@click.option("--token", required=True, help="As the monitor printed it when it started.")
@options("host", "port")
def monitor_reset(token: str, host: str, port: int) -> Report:
    """Ask the monitor to leave a withdrawal.

    It is granted only while fresh frames come that are usable and harmless;
    otherwise the exit code is 2, and the answer says why.

    Example: scleraforce monitor-reset --token 3f0c52e6b91d4a78a1c6e0972bd85f14
    """
    from scleraforce.service.reset import ask_reset

    granted, message = ask_reset(host, port, token)
    faults = [] if granted else [InputError(f"{host}:{port}: {message}")]
    return Report({"granted": granted, "message": message}, [f"reset: {message}"] if granted else [], faults)
