"""The number of files that a process may open, tested before it serves: without one, no operator can connect."""

import resource

from scleraforce.errors import InputError


def allow_files(needed: int) -> None:
    """Allow this process, and those that it starts, to open so many files and sockets.

    Args:
        needed: how many; the soft limit is raised to it, never lowered.

    Raises:
        InputError: the hard limit is lower.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise InputError(
            f"open files: at most {hard} are allowed (ulimit -Hn), the monitor needs {needed} so that neither the "
            "scanner nor the operator is locked out; raise the limit `nofile` in /etc/security/limits.conf"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
