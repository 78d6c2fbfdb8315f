"""The app: import, look, correct, calibrate and read in a browser.

Long computations run in a worker process of their own, which calls the public
functions. Imports `front.api`, `front.report` and every package below `front`.

Public:
    app_server: `HOST`, `listen_locally`, `server_of`
    asked_jobs: `CommandWords`
"""
