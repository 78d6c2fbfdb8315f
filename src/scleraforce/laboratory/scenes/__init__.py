"""Drawn scenes: B-scans of front eyes with all that disturbs them, and the wall's boundaries that are true in them."""
