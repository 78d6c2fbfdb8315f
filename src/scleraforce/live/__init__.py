"""The monitor on the network: what robots, viewers and people talk to.

Sockets, processes and clocks. Imports `reading`, `records`, `base` and its own
subpackages; `companions` import `calibration`, too.

Public:
    monitor: `Address`, `MonitorSettings`, `OperatorNotes`, `monitor_service`
"""
