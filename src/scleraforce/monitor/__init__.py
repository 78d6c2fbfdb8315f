"""When to withdraw: the decision of the monitor, without clock, input or output (docs/monitor_decision.md)."""

from scleraforce.monitor.decision import Decision, MonitorState, decide
from scleraforce.monitor.limits import MonitorLimits

__all__ = ["Decision", "MonitorLimits", "MonitorState", "decide"]
