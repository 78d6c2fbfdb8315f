"""The monitor's decision to withdraw, without clock, input or output (docs/monitor_decision.md)."""

from scleraforce.monitor.decision import (
    Decision as Decision,
    PlanesState as PlanesState,
    decide as decide,
    decide_planes as decide_planes,
)
from scleraforce.monitor.limits import MonitorLimits as MonitorLimits
from scleraforce.monitor.state import MonitorState as MonitorState
