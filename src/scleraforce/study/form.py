"""The `[form]` section of a study: eyes that are not even half-spheres of one material.

It shapes the virtual eyes of `simulate` and `phantom` with finite strain. Directions are those of the eye's frame:
polar angle from the pole, azimuth about it, on the sphere from which the wall is shaped.
"""

from dataclasses import dataclass

from scleraforce.errors import StudyError
from scleraforce.study.fields import check_fields, quantity
from scleraforce.units import from_si

MOST_UNEVEN = 0.5  # sum of the waves' amplitudes


@dataclass(frozen=True, kw_only=True)
class WaveStudy:
    """One wave of the wall's thickness: a Legendre polynomial of the angle to an axis, times the amplitude.

    Degree 1: thick on the axis's side and thin on the other; 2: thick at both ends of the axis; 3: two waves around.
    """

    amplitude_fraction: float = quantity(10.0, "percent", -40.0, 40.0)
    degree: int = quantity(1, None, 1, 3)
    polar_rad: float = quantity(0.0, "deg", 0.0, 180.0)
    azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class RegionStudy:
    """A spherical cap of another modulus; the default is as wide as the cornea: 11.5 mm across on an eye of 24 mm.

    `edge_rad`: width over which the modulus goes over into the rest's, half of it on either side of the cap's edge.
    """

    modulus_ratio: float = quantity(1.0, None, 0.05, 20.0)
    half_angle_rad: float = quantity(28.6, "deg", 1.0, 180.0)
    edge_rad: float = quantity(5.0, "deg", 0.1, 90.0)
    polar_rad: float = quantity(0.0, "deg", 0.0, 180.0)
    azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class CorneaStudy:
    """A cornea of another radius than the globe's; the defaults are those of human eyes.

    The outer surface inside the limbus, a ring of `limbus_radius_m` about the cornea's axis, is a sphere of `radius_m`
    through the ring. Across the ring, `edge_m` wide as measured along the globe, it goes over into the globe smoothly.
    """

    radius_m: float = quantity(7.8, "mm", 2.0, 30.0)
    limbus_radius_m: float = quantity(5.75, "mm", 1.0, 20.0)
    edge_m: float = quantity(2.0, "mm", 0.5, 10.0)
    polar_rad: float = quantity(0.0, "deg", 0.0, 90.0)
    azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.limbus_radius_m < self.radius_m:
            ring, cornea = (f"{from_si(value, 'mm'):g}" for value in (self.limbus_radius_m, self.radius_m))
            raise StudyError(f"limbus_radius_mm: {ring}; must be below the cornea's radius_mm, {cornea}")


@dataclass(frozen=True)
class FormStudy:
    """Semi-axes of the outer surface along x, y and z as shares of the radius, waves of the thickness, regions, cornea.

    The semi-axes stretch the whole eye, a cornea of another radius too.
    """

    semi_axes: tuple[float, ...] = quantity((1.0, 1.0, 1.0), None, 0.7, 1.3)
    wave: tuple[WaveStudy, ...] = ()
    region: tuple[RegionStudy, ...] = ()
    cornea: CorneaStudy | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        if len(self.semi_axes) != 3:
            raise StudyError("semi_axes: give three ratios, like [1.0, 1.0, 1.0]")
        if sum(abs(wave.amplitude_fraction) for wave in self.wave) > MOST_UNEVEN:
            raise StudyError(f"wave: the amplitudes add up to more than {MOST_UNEVEN:.0%}")
