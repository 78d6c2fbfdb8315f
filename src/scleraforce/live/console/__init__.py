"""The web console: a process that shows decisions in a browser and sends the reset.

Of the monitor, only this imports FastAPI. Imports `live.companions`,
`live.decision`, `live.network` and `base`. The monitor starts `server` by its name.

Public:
    board: `sentence_of`
    server: `OwnPagesOnly`
"""
