"""The monitor's benchmarks: one question, one command.

python -m monitor QUESTION [OPTIONS]

`session`, `faults` and `hostile` start the monitor that users start, on the first core;
scanner, robot and its companions are on the others. Their RECORDING is a virtual
acquisition of `scleraforce phantom` at 100 frames a second, with forces to 40 mN. The
other questions need no running monitor. `python -m monitor QUESTION --help` lists the
options; docs/monitor_figures.md says what was measured.
"""

import argparse
import json
import sys
from collections.abc import Callable
from inspect import Parameter, getdoc, signature
from pathlib import Path
from typing import Any

from monitor.bound import bound
from monitor.faults import faults
from monitor.hostile import hostile
from monitor.messages import messages
from monitor.old_pictures import old_pictures
from monitor.pierced import pierced
from monitor.relaxing import relaxing
from monitor.session import session
from monitor.sessions import sessions
from scleraforce.base.errors import ScleraforceError

QUESTIONS: tuple[Callable[..., Any], ...] = (
    session,
    faults,
    hostile,
    sessions,
    bound,
    pierced,
    relaxing,
    old_pictures,
    messages,
)


def main(words: list[str]) -> int:
    """Answer one question; keep its figures where that is asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m monitor",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    questions = parser.add_subparsers(required=True, metavar="QUESTION")
    for question in QUESTIONS:
        summary, _, arguments = (getdoc(question) or "").partition("\n\n")
        command = questions.add_parser(
            question.__name__.replace("_", "-"),
            help=summary,
            description=f"{summary}\n\n{arguments}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.set_defaults(question=question)
        command.add_argument("--json", type=Path, help="file for the figures")
        for parameter in signature(question).parameters.values():
            _add_option(command, parameter)

    given = vars(parser.parse_args(words))
    question = given.pop("question")
    file = given.pop("json")
    try:
        answer = question(**given)
    except ScleraforceError as fault:
        print(f"error: {fault}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130

    if file:
        file.write_text(json.dumps(answer, indent=1) + "\n", encoding="utf-8")

    return answer if isinstance(answer, int) else 0


def _add_option(command: argparse.ArgumentParser, parameter: Parameter) -> None:
    """Make an option of a question's parameter, or an argument where it has no default:
    a tuple takes several values, a bool none.
    """
    default = parameter.default
    flag = f"--{parameter.name.replace('_', '-')}"
    if default is parameter.empty:
        command.add_argument(parameter.name, type=parameter.annotation)
    elif isinstance(default, bool):
        command.add_argument(flag, action="store_true")
    elif isinstance(default, tuple):
        command.add_argument(
            flag, type=type(default[0]), nargs="*", default=default, metavar="VALUE"
        )
    else:
        kind = Path if default is None else type(default)
        command.add_argument(flag, type=kind, default=default, metavar="VALUE")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
