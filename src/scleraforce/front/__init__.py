"""What people call: the Python functions, the commands, the app and the pages.

Imports every other package. Inside, `cli` imports all, `app` imports `api`, and `api`
and `paper` import `report`.

Public: the names of `import scleraforce as sf` (`api.public_names`, docs/python.md) and
the command (`cli.main`).
"""
