"""Virtual eyes that differ in a few values, and their numbers."""

from dataclasses import fields, replace
from math import nan
from typing import Any

from scleraforce.calibration.filter.eye_parameters import (
    WallState,
    stated_polar_rad,
    stated_wall,
)
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup


def changed(setup: Setup, **values: Any) -> Setup:
    """Return an experiment with other values of its eye, needle and scan, by the names
    of their fields; `youngs_modulus_pa` is that of a stated modulus.
    """
    if "youngs_modulus_pa" in values:
        values["modulus"] = Modulus.stated(values.pop("youngs_modulus_pa"))

    of_eye = {item.name for item in fields(Eye)} & set(values)
    of_needle = {item.name for item in fields(Needle)} & set(values)
    of_scan = set(values) - of_eye - of_needle
    return Setup(
        eye=replace(setup.eye, **{name: values[name] for name in of_eye}),
        needle=replace(setup.needle, **{name: values[name] for name in of_needle}),
        scan=replace(setup.scan, **{name: values[name] for name in of_scan}),
    )


def wall_of(setup: Setup) -> WallState:
    """Return the numbers of an eye's wall without a force; NaN for a modulus that is
    not declared.
    """
    modulus_pa = nan if setup.eye.modulus is None else setup.eye.modulus_pa
    return stated_wall(setup, modulus_pa, 0.0, stated_polar_rad(setup))
