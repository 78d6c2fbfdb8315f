"""A monitor from its start to its end, for whoever shows what it says: the command, or
the process of `sf.monitor`.
"""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from scleraforce.base.plain_json import finite_json
from scleraforce.live.monitor import MonitorSettings, monitor_service
from scleraforce.live.monitor_process import ended_by_signals
from scleraforce.live.monitor_request import Address
from scleraforce.live.operator_lines import start_lines
from scleraforce.reading.reading_models import Reader
from scleraforce.records.model_folder import model_name


def run_monitor(
    reader: Reader,
    settings: MonitorSettings,
    note: Callable[[str], None],
    when_started: Callable[[Address], None] | None = None,
) -> dict[str, Any]:
    """Serve until a signal ends it, and return the summary of the session, for JSON.

    `note` is called with each line for the operator, `when_started` once, with the
    address that it listens on, when all lines of the start are said; neither may wait.
    Errors are those of `monitor_service`.
    """
    with (
        ExitStack() as until_ended,
        monitor_service(reader.path, reader, settings, note) as (server, address),
    ):
        until_ended.enter_context(ended_by_signals(server.stop))
        for line in start_lines(reader, settings, address, server.code.line):
            note(line)
        if when_started is not None:
            when_started(address)

        server.run()
        summary = server.session.summary()
        note("ends; the black box writes its last entries")

    frames = summary["frames"]
    withdrawals = summary["withdrawals"]
    note(f"ended after {frames} frames and {len(withdrawals)} withdrawals")
    return {
        "model": model_name(reader.path),
        "class_bounds_mn": reader.bounds_mn,
        **finite_json(summary),
    }
