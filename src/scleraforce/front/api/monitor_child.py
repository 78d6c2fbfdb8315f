"""The process of `sf.monitor`: it takes a `MonitorRequest`, serves, and says in typed
messages what an operator of the command would read.

The request comes first; whatever follows it, or the end of the pipe, ends the monitor
as Ctrl-C ends the command.
"""

import sys
from contextlib import closing
from multiprocessing.connection import Connection
from traceback import print_exc

from scleraforce.base.errors import InputError, MessageError
from scleraforce.base.plain_text import printable
from scleraforce.front.api.monitor_settings import prepare_monitor
from scleraforce.live.monitor import OperatorNotes
from scleraforce.live.monitor_process import end_with, open_standard_files
from scleraforce.live.monitor_request import (
    Address,
    Ended,
    Failed,
    MonitorMessage,
    MonitorRequest,
    OperatorLine,
    Refused,
    Started,
)
from scleraforce.live.monitor_run import run_monitor


def main() -> None:
    """Run as a process: arguments are the descriptor of its end of the pipe, and the
    process id of the program.
    """
    open_standard_files()
    link = Connection(int(sys.argv[1]))
    try:
        request = link.recv()
        end_with(link, int(sys.argv[2]))
        _serve(request, link)
    except KeyboardInterrupt:
        return  # asked to end before it served
    except EOFError:
        return  # the program has died


def _serve(request: object, link: Connection) -> None:
    """Serve what is asked for until the end, and say why if that cannot be."""
    if not isinstance(request, MonitorRequest):
        raise MessageError(
            f"a {type(request).__name__} came; the first message must be a"
            " MonitorRequest"
        )

    # the monitor never waits for a program that does not read
    with closing(OperatorNotes[MonitorMessage](link.send)) as say:

        def note(text: str) -> None:
            say(OperatorLine(printable(text)))

        try:
            reader, settings = prepare_monitor(request)

            def started(address: Address) -> None:
                say(
                    Started(
                        host=address.host,
                        port=address.port,
                        token=settings.token,
                        remarks=settings.remarks,
                    )
                )

            summary = run_monitor(reader, settings, note, started)
        except InputError as fault:
            say(Refused(str(fault)))
        except Exception as fault:
            print_exc()
            say(Failed(f"{type(fault).__name__}: {fault}"))
        else:
            say(Ended(summary))
