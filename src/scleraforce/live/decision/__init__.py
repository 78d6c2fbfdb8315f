"""The monitor's decision to withdraw (docs/monitor_decision.md).

Pure: no file, no clock, no socket. Imports `reading`, `records` and `base`.

Public:
    decide: `Decision`, `PlanesState`, `decide`, `decide_planes`
    events: `BY_SEVERITY`, `Cause`, `Fault`, `FrameRead`, `MonitorEvent`,
        `OvertakenRead`, `QueueLoss`, `Reset`, `SLACK_S`, `SecondOpinion`, `State`,
        `Tick`
    limits: `MonitorLimits`, `of_scale`
    state: `MonitorState`
"""
