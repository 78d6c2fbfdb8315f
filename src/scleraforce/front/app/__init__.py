"""The app: import, look, correct, calibrate and read in a browser.

Long computations run as commands. Imports `front.api` and every package below `front`.

Public:
    app_server: `HOST`, `listen_locally`, `server_of`
    running_commands: `CommandWords`
"""
