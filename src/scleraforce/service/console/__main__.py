"""The console's process; the monitor starts it with the descriptor of its channel."""

import sys

from scleraforce.service.companions.child import settings_of_child

__all__ = ["main"]


def main() -> int:
    """Serve until the monitor ends; return the exit code."""
    channel, message = settings_of_child(sys.argv)
    try:
        from scleraforce.service.console.server import serve
    except ModuleNotFoundError as missing:
        detail = f"console: {missing.name} is not installed; run pip install 'scleraforce[web]'"
        channel.send({"kind": "fault", "detail": detail})
        return 1
    from scleraforce.service.console.settings import ConsoleSettings

    return serve(channel, ConsoleSettings.from_message(message))


if __name__ == "__main__":
    sys.exit(main())
