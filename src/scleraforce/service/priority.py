"""Real-time priority, where the system allows it (Linux), for the processes that a robot waits for."""

import os
from contextlib import suppress

# The second opinion waits for the monitor, and a monitor in a tight loop must not keep its watchdog from running.
OPINION_PRIORITY, MONITOR_PRIORITY, WATCHDOG_PRIORITY = 5, 10, 20


def run_in_real_time(priority: int) -> bool:
    """Give this process, but not its children, priority over all normal ones (SCHED_FIFO); return whether it worked.

    It works for root and for users with a limit `rtprio` (man 5 limits.conf). Who has a limit `nice` instead gets that
    niceness below 0, which makes delays rarer.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, -priority)
        return False
    return True
