"""The entry point: finds the command, and turns every failure into one line and an exit code.

Exit codes: 0 done, 1 an internal fault, 2 bad input or usage, 130 interrupted, by Ctrl-C or SIGTERM.
"""

import errno
import logging
import os
import signal
import sys
from importlib import import_module
from keyword import iskeyword
from threading import Event

import click

from scleraforce import __version__
from scleraforce.errors import InputError, ScleraforceError

INTERRUPTED = 130
interrupted = Event()  # by a signal that reached a callback of a library only
FULL_DISK = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO}  # comes without the file's name

# Command -> one line of help. `monitor-reset` lives in `cli/monitor_reset.py` as the function `monitor_reset`; `import`
# is a word of Python's own and lives in `cli/import_.py` as `import_`.
COMMANDS = {
    "demo": "A first look: a virtual session, as a page.",
    "doctor": "Check this installation, and say what is missing.",
    "init": "Write a commented study.toml.",
    "simulate": "One eye, one force: displacement, slice, picture.",
    "phantom": "Make a virtual acquisition: raw B-scans and a force log.",
    "import": "Frames and forces of other programs as a recording.",
    "segment": "Find the wall in raw frames.",
    "scanner": "Measure a scanner on its frames, for a simulation.",
    "library": "Solve the finite-strain load paths that others draw from.",
    "calibrate": "Estimate Young's modulus from recordings.",
    "generate": "Simulate the slices that a classifier learns from.",
    "train": "Train a classifier, a reader or a wall finder.",
    "read": "Read the force, or its class, from single frames.",
    "evaluate": "Compare a model's answers with recordings.",
    "show": "What a study, recording, model, ... is, in words or drawn.",
    "export": "A recording or answers for other programs.",
    "monitor": "Tell a robot, from live B-scans, when to withdraw.",
    "monitor-reset": "The operator's reset after a withdrawal.",
    "replay": "Play a recording to a monitor, as a scanner does.",
    "reproduce": "The whole pipeline, to an HTML report.",
}


ALIASES = {"classify": "read"}
NEVER_QUIET = {"monitor"}  # its operator has to see what it says


def _quiet(context: click.Context, _: click.Parameter, asked: bool) -> None:
    if asked:
        from scleraforce.cli.output import be_quiet

        be_quiet(context)


# Added to every command, as `--help` is.
QUIET = click.Option(["-q", "--quiet"], is_flag=True, expose_value=False, callback=_quiet,
                     help="Print errors only, and with --json its object.")  # fmt: skip


def module_name(command: str) -> str:
    """Return the name of a command's module in `cli`, and of its function.

    >>> module_name("monitor-reset"), module_name("import")
    ('monitor_reset', 'import_')
    """
    name = command.replace("-", "_")
    return f"{name}_" if iskeyword(name) else name


class _LazyGroup(click.Group):
    """A group that imports a command only when it is asked for, so that `--help` is quick."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Return the names of the commands, in the order of the pipeline."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002 - click's signature
        """Import and return a command."""
        cmd_name = ALIASES.get(cmd_name, cmd_name)
        if cmd_name not in COMMANDS:
            return None
        name = module_name(cmd_name)
        command: click.Command = getattr(import_module(f"scleraforce.cli.{name}"), name)
        if cmd_name not in NEVER_QUIET and QUIET not in command.params:
            command.params.append(QUIET)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002 - as above
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 80})
@click.version_option(__version__, prog_name="scleraforce")
def cli() -> None:
    """Read the force of a needle on the eye from a single OCT slice.

    Exit codes: 0 done, 1 internal fault, 2 bad input or usage, 130 interrupted.
    """


def main() -> None:
    """Run the command line and exit with its code.

    Who asks the process to end (a cluster's scheduler, `kill`) is heard as Ctrl-C is: nothing unfinished stays behind.
    """
    # Jupyter sets it for the commands that a cell starts: a backend that an environment without Jupyter lacks, and that
    # Matplotlib refuses at its import. Commands draw to files; `sf.*` leaves a notebook's own variable alone.
    os.environ.pop("MPLBACKEND", None)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.unraisablehook = _note_interruption
    code = run(sys.argv[1:])
    if code == INTERRUPTED:  # what zarr's own loop leaves unfinished is no news to the user
        logging.getLogger("asyncio").disabled = True
    sys.exit(code)


def _note_interruption(fault: "sys.UnraisableHookArgs") -> None:
    """Note an interruption that a callback could not pass on: LLVM's, which then fails to compile."""
    if issubclass(fault.exc_type, KeyboardInterrupt):
        interrupted.set()
    else:
        sys.__unraisablehook__(fault)


def run(arguments: list[str]) -> int:
    """Run one command; return its exit code. Failures are one line on standard error.

    What the system says of a file or of a full disk is the user's to mend, wherever it comes from: exit code 2.
    """
    try:
        done = cli.main(arguments, prog_name="scleraforce", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as usage:
        click.echo(usage.format_message())
        return 2
    except click.UsageError as usage:
        return fail(_with_help(usage), 2)
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
            return fail(": ".join(str(part) for part in (fault.filename, fault.strerror) if part), 2)
        return fail(f"internal fault: {type(fault).__name__}: {fault} (SCLERAFORCE_TRACEBACK=1 shows where)", 1)
    return done if isinstance(done, int) else 0


def _with_help(usage: click.UsageError) -> str:
    """Return what is wrong with a call, and where to look."""
    path = "scleraforce" if usage.ctx is None else usage.ctx.command_path
    return f"{usage.format_message().rstrip('.')}; see `{path} --help`"


def fail(message: str, code: int) -> int:
    """Print one error line; return the code."""
    click.echo("error: " + " ".join(message.split()), err=True)
    return code
