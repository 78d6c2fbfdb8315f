"""The monitor's decision to withdraw, without clock, input or output (docs/monitor_decision.md)."""

from scleraforce.monitor.decision import Decision as Decision, decide as decide
from scleraforce.monitor.limits import MonitorLimits as MonitorLimits
from scleraforce.monitor.state import MonitorState as MonitorState
