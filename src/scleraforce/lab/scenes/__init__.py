"""Drawn scenes, from which the wall finder learns.

Imports `lab`, `records` and `base`.

Public:
    drawn_scenes: `Scene`, `draw_scene`
"""
