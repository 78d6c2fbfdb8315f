"""`scleraforce monitor` and `monitor-reset`: the service in the robot's control loop,
and the operator's reset.
"""

import os
import re
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from secrets import token_hex
from typing import TYPE_CHECKING, Any

import click
from platformdirs import user_state_path

from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
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
from scleraforce.records.model_folder import model_name
from scleraforce.records.scan import Plane, Scan, check_planes, parse_plane
from scleraforce.records.setup import Setup

if TYPE_CHECKING:
    from scleraforce.live.decision.limits import MonitorLimits
    from scleraforce.live.monitor import Address, MonitorSettings
    from scleraforce.reading.reading_models import Reader

PORT = click.IntRange(0, 65535)
POSITIVE = click.FloatRange(0.0, min_open=True)
STUDYS = "default: that of the model's study"
LIMITS = (
    "unusable_frames",
    "unusable_opinions",
    "loss_in_window_s",
    "reaction_s",
    "retraction_m_s",
)
# device names that OpenIGTLink can send and a table needs no quotes for
DEVICE_NAME = re.compile(r"[\w.+-]{1,20}", re.ASCII)
# a scanner may use more bits than the model's study states, and its recording must stay
# readable
MOST_BITS = 16
UNKNOWN_GLOBE = (
    "unknown: give --globe; intervals are wider and withdrawals come earlier"
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
def monitor(
    model: Path,
    host: str,
    port: int,
    web_port: int | None,
    web_host: str,
    calibration: Path | None,
    eye: str | None,
    learn_eye: bool,
    resume: Path | None,
    record: Path | None,
    black_box: Path | None,
    planes: tuple[str, ...],
    **given: Any,
) -> Report:
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
    if not sys.platform.startswith("linux"):
        raise InputError(
            "monitor: runs on Linux only, for its real-time priorities; this is"
            f" {sys.platform}"
        )

    # a closed one of the three standard files is opened, or a socket would become one
    # of them
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)

    with one_thread():  # the second core is for the other processes
        # 360 ms: Numba and the models, not for --help and `monitor-reset`
        from scleraforce.live.monitor import (
            Address,
            MonitorSettings,
            OperatorNotes,
            monitor_service,
        )
        from scleraforce.reading.load_model import load_reader, suited_reader

    # the loop has no time for one; the second opinion loads its own
    reader = load_reader(model, finder=None)
    if not reader.serves_loop:  # it would be its own second opinion
        raise InputError(
            f"{reader.path}: kind: {reader.kind}; the monitor needs a reader: nothing"
            " else in this model could check what its network reads in the loop"
        )

    known, doubt = _known(calibration, eye, {name: given[name] for name in EYE})
    if resume is not None and not learn_eye:
        raise InputError("--resume: needs --learn-eye")
    if learn_eye:
        known = _to_learn(reader, known, resume, eye, given)

    reader = suited_reader(reader, known)
    scan = _scan(reader, known, _planes(planes, reader, known, learn_eye), given)
    if reason := reader.refusal(known):  # all frames would be unusable
        raise InputError(f"{reader.path}: {reason}")
    if eye is not None and (fault := name_fault(eye)):
        raise InputError(f"--eye: {fault}")

    begun = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    settings = MonitorSettings(
        eye=eye or "eye-1",
        setup=known,
        limits=_limits(reader, known, scan, given),
        scan=scan,
        address=Address(host, port),
        console=None if web_port is None else Address(web_host, web_port),
        black_box=black_box or user_state_path("scleraforce") / "monitor" / begun,
        record=record,
        learns=learn_eye,
        token=token_hex(16),  # it cannot be guessed
    )

    command = click.get_current_context().command.name
    with closing(
        OperatorNotes(lambda text: _write_line(in_flags(text, command)))
    ) as notes:
        with (
            ExitStack() as until_ended,
            monitor_service(reader.path, reader, settings, notes) as (server, address),
        ):
            until_ended.enter_context(_ended_by_signals(server.stop))
            for line in _greeting(reader, settings, address, doubt, server.code.line):
                notes(line)

            server.run()
            summary = server.session.summary()
            notes("ends; the black box writes its last entries")

        notes(
            f"ended after {summary['frames']} frames and {len(summary['withdrawals'])}"
            " withdrawals"
        )

    return Report(
        {
            "model": model_name(reader.path),
            "class_bounds_mn": reader.bounds_mn,
            **summary,
        }
    )


def _known(
    calibration: Path | None, eye: str | None, given: dict[str, Any]
) -> "tuple[Setup, str | None]":
    # 380 ms: not for --help and `monitor-reset`
    from scleraforce.front.api.reading_frames import check_calibrated
    from scleraforce.records.calibration_file import (
        choice_of_eye,
        foreign_modulus,
        known_of_eye,
        read_calibration,
    )

    known = declared_eye(given)

    if calibration is None:
        return known, None

    check_calibrated(known, calibrated=True)
    summary = read_calibration(calibration)
    if eye is None:
        raise InputError(f"--eye: missing; {choice_of_eye(summary)}")

    return known_of_eye(known, summary, eye), foreign_modulus(summary, eye)


def _planes(
    given: tuple[str, ...], reader: "Reader", setup: "Setup", learn_eye: bool
) -> tuple[Plane, ...]:
    """Return the planes of a scanner that takes several; () of one that takes a single
    one.
    """
    # 310 ms: not for --help and `monitor-reset`
    from scleraforce.reading.trained_ranges import READER

    planes = tuple(parse_plane(words) for words in given)
    check_planes(planes, "--plane")
    named = next(
        (plane.name for plane in planes if not DEVICE_NAME.fullmatch(plane.name)), None
    )
    refused = {
        (
            f"--plane: {named!r} cannot name a device; use 1 to 20 of the characters"
            " A-Z a-z 0-9 . _ + -"
        ): named,
        f"--plane: {reader.path} is a {reader.kind}, which reads single planes": (
            planes and reader.kind != READER
        ),
        "--gap-mm: several planes show their gaps; leave it out": (
            planes and setup.needle.gap_m is not None
        ),
        "--learn-eye: it learns from a single plane; leave it or --plane out": (
            planes and learn_eye
        ),
    }

    for reason, holds in refused.items():
        if holds:
            raise InputError(reason)

    return planes


def _to_learn(
    reader: "Reader",
    setup: "Setup",
    resume: Path | None,
    eye: str | None,
    given: dict[str, Any],
) -> "Setup":
    """Return the eye with the prior of an E that is to be learned."""
    # 430 ms: not without --learn-eye
    from scleraforce.live.companions.eye_learning import resumed_eye
    from scleraforce.records.eye import Modulus

    refused = {
        f"{reader.path} is a {reader.kind}, which reads no force": (
            not reader.reads_force
        ),
        "needs the second opinion; leave out --no-second-opinion": not given[
            "second_opinion"
        ],
        "E is given with --youngs-modulus-mpa": given["youngs_modulus_pa"] is not None,
        "the calibration has this eye's own E": setup.eye.has_own_modulus,
        "--iop-mmhg is missing: E is found beside the known pressure": (
            setup.eye.iop_pa is None
        ),
        "--eye is missing: --resume needs its name": resume is not None and eye is None,
    }

    for reason, holds in refused.items():
        if holds:
            raise InputError(f"--learn-eye: {reason}")

    prior = reader.study.calibration
    population = Modulus(
        mean_pa=prior.prior_mean_pa, sd_pa=prior.prior_sd_pa, source="population"
    )
    setup = replace(
        setup, eye=replace(setup.eye, modulus=setup.eye.modulus or population)
    )
    if resume is not None and eye is not None:
        return resumed_eye(setup, resume, eye)

    return setup


def _scan(
    reader: "Reader", setup: "Setup", planes: tuple[Plane, ...], given: dict[str, Any]
) -> Scan:
    """Return what is known of the frames of a session."""
    names = ("columns", "rows", "width_m", "depth_m", "refractive_index")
    stated = {name: given[name] or getattr(reader.study.oct, name) for name in names}
    return Scan(
        bits=MOST_BITS, direction_rad=setup.scan.direction_rad, planes=planes, **stated
    )


def _limits(
    reader: "Reader", setup: "Setup", scan: Scan, given: dict[str, Any]
) -> "MonitorLimits":
    # 12 ms: not for --help and `monitor-reset`
    from scleraforce.live.decision.limits import MonitorLimits

    return MonitorLimits(
        withdraw_class=given["withdraw_class"] or reader.classes - 1,
        bound_n=given["bound_n"] or reader.study.classes.bounds_n[-1],
        stiffness_n_m=reader.steepest_n_m(setup) or MonitorLimits.stiffness_n_m,
        reports_pierced=given["on_pierced"] == "report",
        size=scan.shape,
        scale_m=(scan.scale.lateral_m, scan.scale.depth_m),
        reads_force=reader.reads_force,
        expects_opinion=given["second_opinion"]
        and reader.reads_force,  # a class is read in one way only
        **{name: given[name] for name in LIMITS},
    )


def _greeting(
    reader: "Reader",
    settings: "MonitorSettings",
    address: "Address",
    doubt: str | None,
    code: str,
) -> Iterator[str]:
    limits = settings.limits
    scan = settings.scan
    lateral_um = from_si(scan.scale.lateral_m, "um")
    depth_um = from_si(scan.scale.depth_m, "um")
    bound_mn = from_si(limits.bound_n, "mn")
    forces = (
        f", or where the force's interval reaches {bound_mn:.1f} mN"
        if limits.reads_force
        else ""
    )
    yield "research use only: not a medical device"
    yield f"model      {reader.words}"
    yield f"eye        {settings.eye}: {_eye_words(settings.setup)}"

    if scan.planes:
        places = [
            (one.name, from_si(one.offset_m, "mm"), from_si(one.direction_rad, "deg"))
            for one in scan.planes
        ]
        yield "planes     " + ", ".join(
            f"{name} ({mm:g} mm, {deg:.0f}°)" for name, mm, deg in places
        )

    yield f"globe      {globe_words(settings.setup, reader.reads_force)}"
    relaxation = settings.setup.eye.relaxation
    if relaxation is not None and relaxation.matters:
        most = max(sum(relaxation.shares), sum(relaxation.other))
        lost = from_si(most, "percent")
        yield (
            f"tissue     a held needle loses up to {lost:.0f} % of its force; intervals"
            " are wide at the start"
        )

    any_lean = (
        settings.setup.needle.lean_rad is None
        and not settings.setup.eye.has_calibrated_modulus
    )
    lean = (
        "the needle's lean is not given: forces are their parts along the wall's normal"
        " (docs/limits.md)"
    )

    for warning in filter(
        None, (doubt, lean if any_lean else None, *reader.limits(settings.setup, scan))
    ):
        yield f"warning    {warning}"

    yield (
        f"frames     {scan.columns} x {scan.rows} px of {lateral_um:.2f} x"
        f" {depth_um:.2f} µm"
    )
    yield f"withdraws  at class {limits.withdraw_class}{forces}"
    yield f"listens    on {address.host}:{address.port} (OpenIGTLink)"
    yield f"black box  {settings.black_box}"
    yield code
    yield (
        f"reset      scleraforce monitor-reset --port {address.port} asks for the code,"
        f" or for the token {settings.token}"
    )


def _eye_words(setup: "Setup") -> str:
    # 13 ms: not for --help and `monitor-reset`
    from scleraforce.records.eye import MODULUS_SOURCES

    words = "modulus unknown"
    if setup.eye.modulus is not None:
        words = (
            f"{from_si(setup.eye.modulus.mean_pa, 'mpa'):.3f} MPa"
            f" ({MODULUS_SOURCES[setup.eye.modulus.source]})"
        )

    iop = (
        "IOP unknown"
        if setup.eye.iop_pa is None
        else f"IOP {from_si(setup.eye.iop_pa, 'mmhg'):.1f} mmHg"
    )
    wall = (
        "thickness unknown"
        if setup.eye.thickness_m is None
        else f"{from_si(setup.eye.thickness_m, 'um'):.0f} µm thick"
    )
    gap = (
        "gap unknown"
        if setup.needle.gap_m is None
        else f"gap {from_si(setup.needle.gap_m, 'mm'):.2f} mm"
    )

    return ", ".join((words, iop, wall, gap))


def globe_words(setup: "Setup", reads_force: bool) -> str:
    """Return the globe with which a model reads an eye, and the cost of an unknown one.

    >>> from scleraforce.records.eye import Eye
    >>> from scleraforce.records.globe import SEALED
    >>> from scleraforce.records.setup import Setup
    >>> globe_words(Setup(eye=Eye(globe=SEALED)), reads_force=True)
    'sealed, k between 0.005 and 0.06 mmHg^(1/3)/µl'
    """
    # 2 ms: not for --help
    from scleraforce.records.globe import UNKNOWN

    globe = UNKNOWN if setup.eye.globe is None else setup.eye.globe
    if not reads_force:
        return (
            "taken for open: a classifier knows no other, and in a sealed eye forces"
            " are read too low"
        )
    if not globe.can_be_sealed:
        return "open"

    ends = (
        globe.band
        if globe.calibrated or globe.rigidity_told
        else (globe.lowest, globe.highest)
    )
    low, high = (f"{from_si(end, 'mmhg13_per_ul'):.2g}" for end in ends)
    k = f"k between {low} and {high} mmHg^(1/3)/µl"

    if globe.calibrated:
        return (
            f"{'open or sealed' if globe.kind == 'unknown' else globe.kind}, {k}"
            " (calibrated)"
        )

    return f"sealed, {k}" if globe.kind == "sealed" else UNKNOWN_GLOBE


@contextmanager
def _ended_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Have Ctrl-C, a closed terminal, SIGTERM and SIGQUIT call `stop`.

    Signals that were ignored at the start, as by `nohup`, stay ignored. Writing to a
    terminal from the background must never stop the process.
    """
    ends = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    heard = [
        number for number in ends if signal.getsignal(number) is not signal.SIG_IGN
    ]
    before = {number: signal.signal(number, lambda *_: stop()) for number in heard}
    before[signal.SIGTTOU] = signal.signal(signal.SIGTTOU, signal.SIG_IGN)

    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


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
