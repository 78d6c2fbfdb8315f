"""The console's process; the monitor starts it with the descriptor of its channel."""

import sys

from scleraforce.service.companions.channel import settings_of_child
from scleraforce.service.companions.messages import ConsoleSettings, SelfReport


def main() -> int:
    """Serve until the monitor ends; return the exit code."""
    channel, settings = settings_of_child(sys.argv, ConsoleSettings)
    try:
        from scleraforce.service.console.server import serve
    except ModuleNotFoundError as missing:
        detail = f"console: {missing.name} is not installed; run pip install 'scleraforce[web]'"
        channel.send(SelfReport(detail=detail))
        return 1
    return serve(channel, settings)


if __name__ == "__main__":
    sys.exit(main())
