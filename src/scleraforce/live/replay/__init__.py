"""A recording played to a monitor as its scanner would, with faults on request.

Sockets and clocks. Imports `live.companions`, `live.decision`, `live.network`,
`recordings`, `records` and `base`.

Public:
    scanner_faults: `FAULTS`, `FaultReport`, `draw_fault_time`, `inject`, `prepare`
    scanner_player: `AHEAD`, `AnswerLog`, `Player`, `ScannerClient`, `StatusChange`
"""
