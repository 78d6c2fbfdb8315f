"""Drawn scenes, from which the wall finder learns."""
