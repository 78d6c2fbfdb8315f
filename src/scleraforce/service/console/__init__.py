"""The web console: a process beside the monitor that shows in a browser what it decides, and sends the reset back."""

from scleraforce.service.console.settings import console_settings

__all__ = ["console_settings"]
