"""What a notebook calls: one function a task, SI in and out. `scleraforce` offers them all (docs/python.md)."""
