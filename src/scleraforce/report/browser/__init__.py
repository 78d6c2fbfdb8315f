"""A page that browses a recording frame by frame: wall, force, interval, verdict."""
