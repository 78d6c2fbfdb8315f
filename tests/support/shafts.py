"""A straight steel needle of 25G on the axis, upright: what tests draw, or change with `replace`."""

from math import pi

from scleraforce.laboratory.light import NeedleShaft

__all__ = ["STEEL"]

STEEL = NeedleShaft(
    diameter_m=0.5e-3,
    gap_m=0.0,
    angle_rad=0.0,
    lean_rad=0.0,
    bevel_rad=pi / 2,
    above_m=1e-3,
    loss_fraction=1.0,
    level_db=28.0,
    far_edge_db=-6.0,
)
