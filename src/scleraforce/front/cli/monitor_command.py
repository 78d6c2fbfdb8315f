"""`scleraforce monitor` and `monitor-reset`: the service in the robot's control loop,
and the operator's reset.
"""

import os
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.base.errors import InputError
from scleraforce.base.worker_processes import one_thread
from scleraforce.front.cli.field_flags import in_flags
from scleraforce.front.cli.options import (
    EYE,
    LEAN_DEFAULT,
    MODEL,
    PATH,
    PLANE,
    declared_eye,
    in_si,
    options,
)
from scleraforce.front.cli.output import Command, Report
from scleraforce.records.fields import name_fault
from scleraforce.records.scan import parse_plane

if TYPE_CHECKING:
    from scleraforce.live.monitor_request import MonitorRequest

PORT = click.IntRange(0, 65535)
POSITIVE = click.FloatRange(0.0, min_open=True)
STUDYS = "default: that of the model's study"
FRAMES = ("columns", "rows", "width_m", "depth_m", "refractive_index")
LIMITS = (
    "withdraw_class",
    "bound_n",
    "unusable_frames",
    "unusable_opinions",
    "loss_in_window_s",
    "reaction_s",
    "retraction_m_s",
)
# options that are fields of a request
AS_GIVEN = (
    "calibration",
    "black_box",
    "record",
    "second_opinion",
    "learn_eye",
    "resume",
)


@click.command(cls=Command, can_be_quiet=False)  # the operator has to see its lines
@click.argument("model", type=MODEL)
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen on."
)
@click.option(
    "--port",
    type=PORT,
    default=18944,
    show_default=True,
    help="OpenIGTLink port; 0: any free port.",
)
@click.option(
    "--web-port",
    type=PORT,
    help="Port of the web console, which needs the extra [web].",
)
@click.option(
    "--web-host",
    default="127.0.0.1",
    show_default=True,
    help="Address of the web console.",
)
@options("calibration")
@click.option("--eye", help="Name of the eye in the calibration, and in recordings.")
@options(
    *EYE,
    default="unknown",
    stiffening="the calibration's, else 0 (no stiffening)",
    globe="unknown, which widens intervals",
    lean_rad=LEAN_DEFAULT,
)
@click.option(
    "--columns", type=click.IntRange(16, 16384), help=f"Columns of a frame; {STUDYS}."
)
@click.option(
    "--rows", type=click.IntRange(16, 16384), help=f"Rows of a frame; {STUDYS}."
)
@options(
    "width_m",
    "depth_m",
    "refractive_index",
    width_m=f"Width of the frames, black bands included; {STUDYS}.",
    depth_m=f"Depth of the frames as stored; {STUDYS}.",
    refractive_index=(
        f"Refractive index of the depth axis (1: already corrected); {STUDYS}."
    ),
)
@click.option(
    "--withdraw-class",
    type=click.IntRange(1),
    help="Withdraw at this class or a higher one; default: the highest.",
)
@click.option(
    "--bound-mn",
    "bound_n",
    type=POSITIVE,
    callback=in_si("mn"),
    help=(
        "Withdraw if the force's interval "
        "reaches this; default: the lower bound of the highest class."
    ),
)
@click.option(
    "--unusable-frames",
    type=click.IntRange(1),
    default=1,
    show_default=True,
    help="After contact, withdraw after this number of unusable frames in a row.",
)
@click.option(
    "--unusable-opinions",
    type=click.IntRange(1),
    default=3,
    show_default=True,
    help="Withdraw after this number of unusable second opinions in a row.",
)
@click.option(
    "--unread-ms",
    "loss_in_window_s",
    type=click.FloatRange(0.0, 1000.0, min_open=True),
    default=80.0,
    show_default=True,
    callback=in_si("ms"),
    help=(
        "Withdraw if frames that cover more than this time of a "
        "second were not read, in gaps of more than 4 ms."
    ),
)
@click.option(
    "--reaction-ms",
    "reaction_s",
    type=POSITIVE,
    default=50.0,
    show_default=True,
    callback=in_si("ms"),
    help="The robot's delay, from the order to withdraw to its motion.",
)
@click.option(
    "--retraction-mm-s",
    "retraction_m_s",
    type=POSITIVE,
    default=5.0,
    show_default=True,
    callback=in_si("mm"),
    help=(
        "The robot's largest speed of withdrawal: a dent that falls faster is "
        "a puncture."
    ),
)
@click.option(
    "--on-pierced",
    type=click.Choice(["withdraw", "report"]),
    default="withdraw",
    show_default=True,
    help="After a puncture, order to withdraw or only report it: code 14, not OK.",
)
@click.option(
    "--plane",
    "planes",
    metavar=PLANE,
    multiple=True,
    help=(
        "One of several planes that the scanner takes at "
        "once, in place of --gap-mm: its frames are IMAGE messages of the device NAME."
    ),
)
@click.option(
    "--second-opinion/--no-second-opinion",
    default=True,
    show_default=True,
    help="Read the frames with the fit as well, in another process.",
)
@click.option(
    "--learn-eye",
    is_flag=True,
    help="Learn E from the shape of dents during the session; needs --iop-mmhg.",
)
@click.option(
    "--resume",
    type=PATH,
    help="With --learn-eye: begin with the E of this eye from an earlier session.",
)
@click.option(
    "--record",
    type=PATH,
    help="Recording folder to write the session to; must not exist.",
)
@click.option(
    "--black-box",
    type=PATH,
    help="Folder of the log; default: in the user's state folder.",
)
def monitor(**given: Any) -> Report:
    """Receive B-scans and tell the robot when to withdraw. Research use only.

    MODEL is `default`, the bundled reader, or the path of a folder that
    `train` wrote: ./mine.

    Frames arrive as OpenIGTLink IMAGE messages. The monitor answers each one
    with a STATUS `ForceMonitor`, which it also sends every 50 ms. Any code but
    1, or 150 ms of silence, means withdraw. A withdrawal ends only with a
    reset: `scleraforce monitor-reset`, or the console, with the code that is
    printed at the start. Ctrl-C ends the monitor, with exit code 0. Linux only.

    Example: scleraforce monitor default --calibration modulus.json --eye eye-a
    --iop-mmhg 2 --gap-mm 0.5 --globe open --web-port 8080
    """
    # 20 ms: not for --help and `monitor-reset`
    from scleraforce.live.monitor_process import (
        open_standard_files,
        refuse_other_systems,
    )

    refuse_other_systems()
    open_standard_files()
    with one_thread():  # the second core is for the other processes
        # 360 ms: Numba and the models, not for --help and `monitor-reset`
        from scleraforce.front.api.monitor_settings import prepare_monitor
        from scleraforce.live.monitor import OperatorNotes
        from scleraforce.live.monitor_run import run_monitor

    reader, settings = prepare_monitor(_request(given))
    command = click.get_current_context().command.name
    with closing(
        OperatorNotes[str](lambda text: _write_line(in_flags(text, command)))
    ) as notes:
        return Report(run_monitor(reader, settings, notes))


def _request(given: dict[str, Any]) -> "MonitorRequest":
    """Return what the options ask for, by the names of their arguments."""
    # 20 ms: not for --help and `monitor-reset`
    from scleraforce.live.monitor_request import Address, MonitorRequest, StatedLimits

    eye = given["eye"]
    if eye is not None and (fault := name_fault(eye)):
        raise InputError(f"`eye`: {fault}")

    declared = declared_eye({name: given[name] for name in EYE})
    frames = {name: given[name] for name in FRAMES}
    planes = tuple(parse_plane(words) for words in given["planes"])
    web_port = given["web_port"]
    return MonitorRequest(
        model=given["model"],
        setup=replace(
            declared,
            eye=replace(declared.eye, name=eye),
            scan=replace(declared.scan, planes=planes, **frames),
        ),
        limits=StatedLimits(
            reports_pierced=given["on_pierced"] == "report",
            **{name: given[name] for name in LIMITS},
        ),
        address=Address(given["host"], given["port"]),
        console=None if web_port is None else Address(given["web_host"], web_port),
        **{name: given[name] for name in AS_GIVEN},
    )


def _write_line(text: str) -> None:
    """Write a line to standard error, past Python's buffer: a terminal that is stopped
    must not hold its lock.
    """
    # it may quote a peer
    plain = "".join(letter if letter.isprintable() else "?" for letter in text)
    os.write(2, f"{plain}\n".encode())


@click.command(cls=Command)
@click.option(
    "--token-file",
    type=PATH,
    metavar="FILE",
    help="File with the token or code, of mode 600, in place of a question.",
)
@options("host", "port")
def monitor_reset(token_file: Path | None, host: str, port: int) -> Report:
    """Ask the monitor to leave a withdrawal.

    The code that the monitor printed, or its token, is asked for in a
    terminal, and otherwise read from standard input: what is on a command line
    can be seen by all users of the machine.

    The monitor grants it only while fresh frames arrive that are usable and
    harmless. Otherwise the exit code is 2, and the answer says why.

    Example: scleraforce monitor-reset --token-file ~/.monitor-token
    """
    # 10 ms: not for --help and `monitor`
    from scleraforce.live.network.operator_reset import ask_reset

    granted, message = ask_reset(host, port, _secret(token_file))
    faults = [] if granted else [InputError(f"{host}:{port}: {message}")]
    return Report(
        {"granted": granted, "message": message},
        [f"reset: {message}"] if granted else [],
        faults,
    )


def _secret(token_file: Path | None) -> str:
    """Return the operator's token or code: of a file, a terminal or standard input."""
    # 10 ms: not for --help
    from scleraforce.live.network.operator_reset import secret_of_file, secret_of_stream

    if token_file is not None:
        return secret_of_file(token_file)
    if sys.stdin.isatty():
        answer: str = click.prompt("code or token", hide_input=True, err=True)
        return answer.strip()
    return secret_of_stream(sys.stdin.buffer)
