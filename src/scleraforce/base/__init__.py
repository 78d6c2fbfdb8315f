"""Units, errors, whole files, JSON, compiled loops and worker processes.

Nothing of eyes, and no import of another package.
"""
