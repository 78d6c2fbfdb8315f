"""The monitor on the network: what robots, viewers and people talk to.

Sockets, processes and clocks. Imports `reading`, `records`, `base` and its own
subpackages; `companions` import `calibration`, too.

Public:
    monitor: `MonitorSettings`, `OperatorNotes`
    monitor_process: `end_with`, `open_standard_files`, `refuse_other_systems`
    monitor_request: `Address`, `Ended`, `Failed`, `LOCAL`, `MonitorMessage`,
        `MonitorRequest`, `OperatorLine`, `Refused`, `Started`, `StatedLimits`
    monitor_run: `run_monitor`
    repeated_pictures: `ShownPictures`, `warm_pictures`
"""
