"""When to withdraw: the decision of the monitor, without clock, input or output (docs/monitor_decision.md)."""

from scleraforce.monitor.decision import Decision, decide
from scleraforce.monitor.limits import MonitorLimits
from scleraforce.monitor.state import MonitorState

__all__ = ["Decision", "MonitorLimits", "MonitorState", "decide"]
