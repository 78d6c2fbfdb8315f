"""The entry point: find the command, and turn every failure into one line and an exit
code.
"""

import codecs
import errno
import logging
import os
import signal
import sys
import unicodedata
from importlib import import_module
from io import TextIOWrapper
from keyword import iskeyword
from threading import Event

import click

from scleraforce.base.errors import InputError, ScleraforceError
from scleraforce.base.foreign_settings import leave_unread
from scleraforce.base.plain_text import printable
from scleraforce.base.version import __version__
from scleraforce.front.cli.field_flags import in_flags

INTERRUPTED = 130
interrupted = Event()  # by a signal that reached a callback of a library only
# comes without the file's name
FULL_DISK = {
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
}

# Group of the help -> command -> its module in `cli`, and one line of help.
GROUPS = {
    "Start": {
        "demo": (
            "doctor_and_demo",
            "Simulate and read a small session, as a web page.",
        ),
        "doctor": (
            "doctor_and_demo",
            "Check this installation, and say what is missing.",
        ),
        "init": ("doctor_and_demo", "Write a commented study.toml."),
        "cite": (
            "doctor_and_demo",
            "Print BibTeX entries of the software and the paper.",
        ),
    },
    "Data": {
        "import": ("import_command", "Import frames and forces of other programs."),
        "phantom": (
            "virtual_commands",
            "Make a virtual acquisition: raw B-scans and a force log.",
        ),
        "show": ("show_command", "Describe or draw a study, recording, model, ..."),
        "export": ("show_command", "Write a recording or answers for other programs."),
    },
    "Read": {
        "segment": ("frame_commands", "Find the wall in raw frames."),
        "calibrate": (
            "recording_commands",
            "Estimate Young's modulus from recordings.",
        ),
        "read": ("frame_commands", "Read the force, or its class, from single frames."),
        "evaluate": (
            "recording_commands",
            "Compare a model's answers with recordings.",
        ),
    },
    "Train": {
        "library": ("train_commands", "Compute a library of finite-strain load paths."),
        "generate": (
            "train_commands",
            "Simulate the slices that a classifier learns from.",
        ),
        "train": ("train_commands", "Train a classifier, a reader or a wall finder."),
        "scanner": (
            "virtual_commands",
            "Measure a scanner on its frames, to simulate it.",
        ),
    },
    "Live": {
        "monitor": (
            "monitor_command",
            "Tell a robot, from live B-scans, when to withdraw.",
        ),
        "monitor-reset": ("monitor_command", "Reset the monitor after a withdrawal."),
        "replay": (
            "replay_command",
            "Play a recording to a monitor as a scanner would.",
        ),
    },
    "Research": {
        "simulate": ("virtual_commands", "Bend one eye by one force."),
        "reproduce": (
            "doctor_and_demo",
            "Run the whole pipeline and write an HTML report.",
        ),
    },
    "App": {"app": ("app_command", "Import, look, correct and read in a browser.")},
}
COMMANDS = {
    name: entry for commands in GROUPS.values() for name, entry in commands.items()
}
ALIASES = {"classify": "read"}


class _LazyGroup(click.Group):
    """A group that imports commands lazily, so that `--help` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002 - click's signature
        cmd_name = ALIASES.get(cmd_name, cmd_name)
        if cmd_name not in COMMANDS:
            return None

        module = COMMANDS[cmd_name][0]
        name = cmd_name.replace("-", "_")
        command: click.Command = getattr(
            import_module(f"scleraforce.front.cli.{module}"),
            f"{name}_" if iskeyword(name) else name,
        )

        return command

    def format_commands(
        self,
        ctx: click.Context,  # noqa: ARG002 - click's signature
        formatter: click.HelpFormatter,
    ) -> None:
        width = max(map(len, COMMANDS))
        for title, commands in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl(
                    [
                        (f"{name:<{width}}", words)
                        for name, (_, words) in commands.items()
                    ]
                )


@click.group(
    cls=_LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80},
)
@click.version_option(__version__, prog_name="scleraforce")
def cli() -> None:
    """Read the force of a needle on the eye from a single OCT slice.

    Exit codes: 0 done, 1 internal fault, 2 bad input or usage, 3 unusable frames
    (segment --strict), 130 interrupted. `scleraforce help COMMAND` explains a
    command.
    """


# the names that click suggests for a typo
cli.commands.update({name: click.Command(name) for name in COMMANDS})


def main() -> None:
    """Run the command line and exit with its code; SIGTERM (a scheduler, `kill`) ends
    it as Ctrl-C does.
    """
    # Jupyter sets it for the commands that a cell starts: a backend that an environment
    # without Jupyter lacks, and that Matplotlib refuses at its import. Commands draw to
    # files; `sf.*` leaves a notebook's own variable alone.
    os.environ.pop("MPLBACKEND", None)
    leave_unread("matplotlib")
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, signal.default_int_handler)

    _print_what_streams_encode()
    sys.unraisablehook = _note_interruption
    code = run(sys.argv[1:])
    if code == INTERRUPTED:  # zarr's own loop would report its unfinished tasks
        logging.getLogger("asyncio").disabled = True

    sys.exit(code)


# Letters that an output captured in GBK, CP932, CP949, Big5 or ASCII may lack.
PLAIN = {
    "µ": "u",
    "±": "+-",
    "\N{MULTIPLICATION SIGN}": "x",
    "·": "*",
    "°": " deg",
    "\N{EN DASH}": "-",
    "\N{MINUS SIGN}": "-",
    "²": "2",
    "³": "3",
}


def _print_what_streams_encode() -> None:
    """Have standard output and error replace what their encoding lacks, rather than
    fail after a command has written its files.
    """
    codecs.register_error("scleraforce", _replaced)
    for stream in (sys.stdout, sys.stderr):
        # surrogateescape: of UTF-8, which lacks nothing
        if isinstance(stream, TextIOWrapper) and stream.errors != "surrogateescape":
            stream.reconfigure(errors="scleraforce")


def _replaced(fault: UnicodeError) -> tuple[str, int]:
    if not isinstance(fault, UnicodeEncodeError):
        raise fault

    letters = []
    for letter in fault.object[fault.start : fault.end]:
        alike = unicodedata.normalize("NFKD", letter)
        found = alike.encode(fault.encoding, "ignore").decode(fault.encoding)
        letters.append(found or PLAIN.get(letter, "?"))

    return "".join(letters), fault.end


def _note_interruption(fault: "sys.UnraisableHookArgs") -> None:
    """Note an interruption that a callback could not pass on: LLVM's, which then fails
    to compile.
    """
    if issubclass(fault.exc_type, KeyboardInterrupt):
        interrupted.set()
    else:
        sys.__unraisablehook__(fault)


def run(arguments: list[str]) -> int:
    """Run one command; return its exit code. A failure is one line; a file's system
    error or a full disk is 2.
    """
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:], "--help"]
    try:
        done = cli.main(arguments, prog_name="scleraforce", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as usage:
        click.echo(printable(usage.format_message()))
        return 2
    except click.UsageError as usage:
        path = "scleraforce" if usage.ctx is None else usage.ctx.command_path
        return fail(f"{usage.format_message().rstrip('.')}; see `{path} --help`", 2)
    except click.ClickException as fault:
        return fail(fault.format_message(), 2)
    except InputError as fault:
        return fail(str(fault), 2)
    except ScleraforceError as fault:
        return fail(str(fault), 1)
    except (KeyboardInterrupt, click.Abort):
        return fail("interrupted", INTERRUPTED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as fault:
        if interrupted.is_set():
            return fail("interrupted", INTERRUPTED)
        if os.environ.get("SCLERAFORCE_TRACEBACK"):
            raise
        if isinstance(fault, OSError) and (fault.filename or fault.errno in FULL_DISK):
            return fail(
                ": ".join(
                    str(part) for part in (fault.filename, fault.strerror) if part
                ),
                2,
            )

        return fail(
            f"internal fault: {type(fault).__name__}: {fault} (SCLERAFORCE_TRACEBACK=1"
            " shows where)",
            1,
        )

    return done if isinstance(done, int) else 0


def fail(message: str, code: int) -> int:
    """Print one error line; return the code."""
    line = " ".join(in_flags(message).split())
    click.echo(printable(f"error: {line}"), err=True)
    return code
