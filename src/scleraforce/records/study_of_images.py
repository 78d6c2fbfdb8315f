"""The images of a study: the raw frame, the slice, the virtual laboratory `[phantom]`
and the drawn `[scenes]`.

Every effect of `[phantom]` is a range with a unit, and everything that is drawn in a
scene, from which the wall finder learns, is in one table: a range, or the share of the
scenes that show it. Levels in dB are ratios of intensity. Ranges of `[phantom]` without
another source are from spectral-domain scanners at 840 nm. Notes in `[scenes]` are what
`scleraforce init` writes beside a value; its docstrings name the sources, and ranges
are wider than these, so that the network has met more than an eye shows. What has no
source is from the look of published scans.
"""

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from scleraforce.base.errors import StudyError
from scleraforce.base.units import HumanUnit
from scleraforce.records.fields import (
    Choice,
    Range,
    Sampled,
    StudySection,
    fixed,
    option,
    quantity,
)


@dataclass(frozen=True, kw_only=True)
class OctStudy(StudySection):
    """The scanner's raw frame (paper sec. 3.1). `refractive_index` 1: depth is
    corrected already.
    """

    width_m: float = quantity(15.0, "mm", 0.1, 50.0)
    depth_m: float = quantity(4.0, "mm", 0.1, 50.0)
    columns: int = quantity(512, None, 32, 8192)
    rows: int = quantity(512, None, 32, 8192)
    bits: int = quantity(12, None, 8, 16)
    refractive_index: float = quantity(1.0, None, 1.0, 2.0)


@dataclass(frozen=True, kw_only=True)
class SliceStudy(StudySection):
    """The binary slice. `margin_m`: depth of the unloaded wall's top below row 0."""

    columns: int = quantity(140, None, 8, 4096)
    rows: int = quantity(40, None, 8, 4096)
    pixel_m: float = quantity(0.1, "mm", 0.001, 1.0)
    margin_m: float = quantity(0.3, "mm", 0.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class PhantomStudy(StudySection):
    """Ranges of a virtual acquisition; `docs/recordings.md` says what is drawn per
    frame and what per recording.
    """

    seed: int = quantity(0, None, 0, 2**31 - 1)
    # the scanner: speckle, noise, display
    snr_db: Sampled = quantity(Range(min=15.0, max=35.0), None, 0.0, 80.0)
    axial_resolution_m: Sampled = quantity(Range(min=4.0, max=8.0), "um", 0.5, 100.0)
    lateral_resolution_m: Sampled = quantity(
        Range(min=15.0, max=35.0), "um", 1.0, 500.0
    )
    display_floor_db: Sampled = quantity(Range(min=-8.0, max=-6.0), None, -60.0, 20.0)
    display_range_db: Sampled = quantity(Range(min=34.0, max=46.0), None, 5.0, 120.0)
    display: str = option("logarithmic", "logarithmic", "root", "linear")
    band_m: Sampled = quantity(Range(min=0.4, max=0.6), "mm", 0.0, 5.0)
    # the wall and what lies below it
    attenuation_per_m: Sampled = quantity(Range(min=0.5, max=1.5), "per_mm", 0.0, 20.0)
    reflection_db: Sampled = quantity(Range(min=-3.0, max=9.0), None, -60.0, 60.0)
    reflection_angle_rad: Sampled = quantity(Range(min=3.0, max=8.0), "deg", 0.1, 90.0)
    choroid_level_db: Sampled = quantity(Range(min=-12.0, max=-6.0), None, -80.0, 0.0)
    choroid_attenuation_per_m: Sampled = quantity(
        Range(min=3.0, max=8.0), "per_mm", 0.0, 50.0
    )
    choroid_thickness_m: Sampled = quantity(
        Range(min=100.0, max=250.0), "um", 0.0, 2000.0
    )
    # what disturbs the image
    shadow_count: Sampled = quantity(Choice((0, 1, 2, 3)), None, 0, 50)
    shadow_loss_fraction: Sampled = quantity(
        Range(min=20.0, max=60.0), "percent", 0.0, 100.0
    )
    shadow_width_m: Sampled = quantity(Range(min=0.1, max=0.8), "mm", 0.001, 20.0)
    line_count: Sampled = quantity(fixed(1), None, 0, 50)
    line_depth_m: Sampled = quantity(Range(min=0.1, max=0.3), "mm", 0.0, 50.0)
    line_level_db: Sampled = quantity(Range(min=4.0, max=12.0), None, -40.0, 80.0)
    line_thickness_m: Sampled = quantity(Range(min=8.0, max=24.0), "um", 0.5, 1000.0)
    cover_count: Sampled = quantity(fixed(0), None, 0, 10)
    cover_height_m: Sampled = quantity(Range(min=0.1, max=0.3), "mm", 0.0, 20.0)
    cover_level_db: Sampled = quantity(Range(min=8.0, max=20.0), None, -40.0, 80.0)
    cover_tilt_rad: Sampled = quantity(Range(min=-1.0, max=1.0), "deg", -45.0, 45.0)
    # the conjunctiva over the wall
    conjunctiva_thickness_m: Sampled = quantity(fixed(0.0), "um", 0.0, 1000.0)
    conjunctiva_wave_fraction: Sampled = quantity(
        Range(min=0.0, max=20.0), "percent", 0.0, 90.0
    )
    conjunctiva_wave_length_m: Sampled = quantity(
        Range(min=1.5, max=8.0), "mm", 0.2, 100.0
    )
    conjunctiva_level_db: Sampled = quantity(
        Range(min=-5.0, max=-1.5), None, -80.0, 20.0
    )
    conjunctiva_interface_db: Sampled = quantity(
        Range(min=-6.0, max=3.0), None, -80.0, 60.0
    )
    conjunctiva_modulus_pa: Sampled = quantity(
        Range(min=5.0, max=20.0), "kpa", 0.1, 10_000.0
    )
    # the needle, where it crosses the picture
    needle_count: Sampled = quantity(fixed(0), None, 0, 1)
    needle_angle_rad: Sampled = quantity(Range(min=-45.0, max=45.0), "deg", -75.0, 75.0)
    needle_lean_rad: Sampled = quantity(fixed(0.0), "deg", -75.0, 75.0)
    needle_bevel_rad: Sampled = quantity(Choice((90.0, 20.0)), "deg", 5.0, 90.0)
    needle_above_m: Sampled = quantity(Range(min=0.0, max=3.0), "mm", 0.0, 30.0)
    needle_loss_fraction: Sampled = quantity(
        Choice((100.0, 100.0, 60.0)), "percent", 0.0, 100.0
    )
    needle_level_db: Sampled = quantity(Range(min=20.0, max=35.0), None, -20.0, 80.0)
    needle_far_edge_db: Sampled = quantity(Range(min=-12.0, max=0.0), None, -80.0, 20.0)
    # where the eye is
    surface_depth_m: Sampled = quantity(Range(min=0.35, max=0.6), "mm", -20.0, 50.0)
    eye_shift_m: Sampled = quantity(Range(min=-0.2, max=0.2), "mm", -10.0, 10.0)
    eye_tilt_rad: Sampled = quantity(fixed(0.0), "deg", -45.0, 45.0)
    eye_drift_rad: Sampled = quantity(fixed(0.0), "deg", 0.0, 4.0)
    eye_saccade_rad: Sampled = quantity(fixed(0.0), "deg", 0.0, 2.0)
    # what the needle does
    approach_s: Sampled = quantity(Range(min=2.0, max=3.0), None, 0.5, 600.0)
    ramp_s: Sampled = quantity(Range(min=0.6, max=1.2), None, 0.05, 60.0)
    hold_s: Sampled = quantity(Range(min=7.0, max=8.0), None, 0.5, 600.0)
    rest_s: Sampled = quantity(Range(min=1.5, max=2.5), None, 0.0, 600.0)
    frame_delay_s: Sampled = quantity(Range(min=4.0, max=5.0), None, 0.0, 600.0)
    # the force sensor
    sample_rate_hz: float = quantity(200.0, None, 100.0, 20_000.0)
    force_step_n: float = quantity(5.0, "mn", 0.0, 1000.0)
    force_noise_n: Sampled = quantity(Range(min=3.0, max=4.5), "mn", 0.0, 1000.0)
    force_offset_n: Sampled = quantity(
        Range(min=-20.0, max=20.0), "mn", -10_000.0, 10_000.0
    )
    force_drift_n_per_s: Sampled = quantity(
        Range(min=-0.3, max=0.3), "mn_per_min", -1000.0, 1000.0
    )
    cross_talk_fraction: Sampled = quantity(
        Range(min=-3.0, max=3.0), "percent", -100.0, 100.0
    )
    torque_noise_nm: Sampled = quantity(fixed(0.1), "mnm", 0.0, 1000.0)

    def _check(self) -> None:
        if self.frame_delay_s.bounds[1] > self.hold_s.bounds[0]:
            raise StudyError(
                "frame_delay_s: a frame would be taken after the push is over; make"
                " hold_s longer"
            )


def share(value: float, note: str = "") -> Any:
    """Declare the share of the scenes that show something."""
    return quantity(value, None, 0.0, 1.0, note)


def span(
    least: float,
    most: float,
    unit: HumanUnit | None,
    low: float,
    high: float,
    note: str = "",
) -> Any:
    """Declare a range in a unit, and its bounds."""
    return quantity(Range(min=least, max=most), unit, low, high, note)


@dataclass(frozen=True, kw_only=True)
class SceneWindowStudy(StudySection):
    """The frame: its pixels, size and place; more or fewer `rows` are drawn to keep a
    pixel within `pixel_m`.

    Front-segment scanners show 6 to 18 mm across and 2 to 14 mm of depth (Ang et al.
    2018, Prog. Retin. Eye Res. 66, 132); scanners of a microscope or a probe from 2.5
    mm on.
    """

    rows: Sampled = span(160.0, 384.0, None, 32, 4096, "of the frame")
    columns: Sampled = span(176.0, 320.0, None, 32, 4096)
    pixel_m: Sampled = span(
        1.0, 100.0, "um", 0.1, 200.0, "along the depth: bounds for the number of rows"
    )
    width_m: Sampled = span(2.5, 18.0, "mm", 0.2, 50.0)
    depth_share: Sampled = span(
        0.22,
        1.05,
        None,
        0.01,
        10.0,
        "of the frame's depth over its width; logarithm even",
    )
    view_m: Sampled = span(
        -11.0,
        11.0,
        "mm",
        -18.0,
        18.0,
        "along the surface from the apex: the frame's middle",
    )
    centred_share: float = share(0.4, "of the scenes look at the apex")
    facing: Sampled = span(
        0.0, 1.0, None, 0.0, 1.0, "0: along the eye's axis, 1: along the normal there"
    )
    tilt_rad: Sampled = span(-15.0, 15.0, "deg", -60.0, 60.0, "on top of that")
    surface_share: Sampled = span(
        -0.15,
        0.6,
        None,
        -1.0,
        1.0,
        "depth of the surface's highest place, over the frame's",
    )
    deep_share: float = share(
        0.4, "show the front segment down to the lens, from the apex on"
    )
    deep_rows: Sampled = span(224.0, 400.0, None, 32, 4096, "of such a view")
    deep_width_m: Sampled = span(11.0, 18.0, "mm", 0.2, 50.0)
    deep_depth_share: Sampled = span(0.45, 1.05, None, 0.01, 10.0)
    deep_facing: Sampled = span(0.0, 0.4, None, 0.0, 1.0)
    deep_tilt_rad: Sampled = span(-8.0, 8.0, "deg", -60.0, 60.0)
    deep_surface_share: Sampled = span(0.02, 0.35, None, -1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class SceneEyeStudy(StudySection):
    """The wall: its meridian has one radius in the cornea and another in the sclera;
    they meet at `limbus_m`.

    Both thicknesses are along the normal. Half of the waves change the thickness, too.
    A dent is a Gaussian. Cornea: radius of Dubbelman et al. 2006 (Acta Ophthalmol.
    Scand. 84, 269), thickness of Doughty and Zaman 2000 (Surv. Ophthalmol. 44, 367),
    swollen ones too. Sclera: thickness of Norman et al. 2010 (Exp. Eye Res. 90, 277).
    """

    half_sphere_share: float = share(0.45, "of the scenes: no cornea")
    cornea_radius_m: Sampled = span(6.3, 9.0, "mm", 3.0, 50.0)
    sclera_radius_m: Sampled = span(10.5, 18.0, "mm", 3.0, 50.0)
    limbus_m: Sampled = span(
        5.2, 7.2, "mm", 1.0, 20.0, "along the surface from the apex"
    )
    limbus_width_m: Sampled = span(0.6, 4.5, "mm", 0.05, 10.0)
    limbus_edge_m: Sampled = span(
        0.1, 2.0, "mm", 0.01, 10.0, "over which the light changes from cornea to sclera"
    )
    limbus_slant_m: Sampled = span(
        -1.0, 2.0, "mm", -5.0, 5.0, "the cornea ends farther out at the inner boundary"
    )
    limbus_wedge_m: Sampled = span(
        0.0, 0.8, "mm", -5.0, 5.0, "... and in the middle this much farther than that"
    )
    spur_m: Sampled = span(
        -0.2, 1.0, "mm", -3.0, 5.0, "beyond the limbus: the scleral spur"
    )
    spur_bump_m: Sampled = span(
        0.0, 120.0, "um", 0.0, 1000.0, "by which it rises into the eye"
    )
    sulcus_rad: Sampled = span(
        0.0, 30.0, "deg", -30.0, 30.0, "by which the surface turns back at the limbus"
    )
    cornea_thickness_m: Sampled = span(350.0, 1000.0, "um", 100.0, 3000.0)
    sclera_ratio: Sampled = span(
        0.9, 1.8, None, 0.2, 5.0, "of the cornea's thickness, in an eye with a cornea"
    )
    sclera_thickness_m: Sampled = span(350.0, 1200.0, "um", 100.0, 3000.0)
    wave_m: Sampled = span(
        0.0, 40.0, "um", 0.0, 1000.0, "smooth ups and downs of the surface"
    )
    wave_length_m: Sampled = span(0.8, 5.0, "mm", 0.1, 50.0)
    dent_share: float = share(0.4)
    dent_depth_m: Sampled = span(0.05, 4.0, "mm", 0.0, 12.0)
    dent_width_m: Sampled = span(0.3, 2.5, "mm", 0.05, 10.0, "standard deviation")
    dent_rim: Sampled = span(
        0.0, 0.2, None, 0.0, 1.0, "height of the ring around it, over its depth"
    )


@dataclass(frozen=True, kw_only=True)
class SceneTissueStudy(StudySection):
    """The tissue below the surface; levels against the sclera's backscatter unless said
    otherwise.

    `profile_db` is how much brighter or darker the wall may be at some depths. The
    ciliary body begins at the scleral spur and thins into the choroid. Without a gap,
    both are at least 3 dB weaker than the sclera: no one could tell them apart
    otherwise. The iris begins on the ciliary body's face; before it is the recess of
    the chamber angle. Lens: radius and thickness of Dubbelman and van der Heijde 2001
    (Vision Res. 41, 1867).
    """

    snr_db: Sampled = span(
        10.0, 40.0, None, 0.0, 80.0, "of the sclera's backscatter over the mean noise"
    )
    cornea_db: Sampled = span(-8.0, 4.0, None, -40.0, 40.0)
    angle_fall_db: Sampled = span(
        0.0, 16.0, None, 0.0, 60.0, "of the cornea's backscatter, far from its normal"
    )
    angle_width_rad: Sampled = span(
        6.0, 30.0, "deg", 0.5, 90.0, "standard deviation of that fall"
    )
    attenuation_per_m: Sampled = span(
        0.1, 2.2, "per_mm", 0.0, 20.0, "of the wall; light passes twice"
    )
    profile_db: Sampled = span(
        0.0, 3.0, None, 0.0, 40.0, "of the wall at some depths, more or less"
    )
    below_share: float = share(
        0.6, "the light of the sclera fades below its end (of the iris, too)"
    )
    below_m: Sampled = span(0.15, 1.5, "mm", 0.01, 10.0, "over which it falls to 1/e")
    below_db: Sampled = span(-14.0, -1.5, None, -60.0, 0.0, "against the wall's end")
    epithelium_db: Sampled = span(-8.0, 4.0, None, -40.0, 40.0, "over the cornea")
    epithelium_m: Sampled = span(40.0, 90.0, "um", 1.0, 500.0)
    scar_count: Sampled = quantity(
        Choice((0, 0, 0, 1, 2)), None, 0, 50, "spots in the wall"
    )
    scar_m: Sampled = span(0.05, 1.2, "mm", 0.001, 10.0, "width")
    scar_height_m: Sampled = span(30.0, 400.0, "um", 1.0, 3000.0)
    scar_db: Sampled = span(-18.0, 8.0, None, -60.0, 40.0)
    scar_loss_fraction: Sampled = span(
        0.0, 85.0, "percent", 0.0, 100.0, "of the light below"
    )
    texture_db: Sampled = span(0.0, 3.0, None, 0.0, 20.0, "standard deviation")
    texture_length_m: Sampled = span(100.0, 3000.0, "um", 5.0, 20_000.0)
    texture_height_m: Sampled = span(30.0, 150.0, "um", 2.0, 5000.0)
    reflection_db: Sampled = span(
        -6.0, 18.0, None, -60.0, 60.0, "of the first surface, as a mirror"
    )
    reflection_angle_rad: Sampled = span(3.0, 20.0, "deg", 0.1, 90.0)
    boundary_db: Sampled = span(
        -10.0, 10.0, None, -60.0, 60.0, "of the cornea's inner surface, over the cornea"
    )
    corrected_share: float = share(0.4, "of the scanners have straightened the rays")
    refractive_index: Sampled = span(1.33, 1.42, None, 1.0, 2.0)
    conjunctiva_share: float = share(0.35)
    conjunctiva_m: Sampled = span(50.0, 250.0, "um", 1.0, 2000.0, "with Tenon's layer")
    conjunctiva_db: Sampled = span(-12.0, 2.0, None, -60.0, 40.0)
    tenon_share: Sampled = span(0.2, 0.7, None, 0.0, 1.0, "of that thickness")
    tenon_db: Sampled = span(-18.0, -3.0, None, -60.0, 40.0)
    uvea_share: float = share(0.85, "ciliary body and choroid are seen")
    choroid_m: Sampled = span(80.0, 320.0, "um", 1.0, 2000.0)
    ciliary_m: Sampled = span(0.2, 1.3, "mm", 0.01, 5.0)
    ciliary_rise_m: Sampled = span(
        0.1, 0.9, "mm", 0.01, 10.0, "from the spur to its full thickness"
    )
    ciliary_length_m: Sampled = span(
        2.0, 6.0, "mm", 0.1, 20.0, "over which the ciliary body thins"
    )
    uvea_db: Sampled = span(-16.0, 0.0, None, -60.0, 40.0)
    gap_share: float = share(0.5, "a thin dark gap parts it from the sclera")
    gap_m: Sampled = span(15.0, 60.0, "um", 1.0, 1000.0)
    gap_db: Sampled = span(-20.0, -4.0, None, -60.0, 40.0)
    uvea_attenuation_per_m: Sampled = span(0.5, 8.0, "per_mm", 0.0, 50.0)
    iris_share: float = share(0.8)
    iris_m: Sampled = span(0.25, 0.8, "mm", 0.01, 3.0, "thickness")
    iris_root: Sampled = span(
        0.0,
        1.0,
        None,
        0.0,
        1.0,
        "on the ciliary body's face: 0 at the spur, 1 at its top",
    )
    iris_depth_m: Sampled = span(
        -0.8, 0.6, "mm", -5.0, 5.0, "of its pupil, below its root along the eye's axis"
    )
    iris_bow_m: Sampled = span(-0.4, 0.3, "mm", -3.0, 3.0, "on the way")
    pupil_m: Sampled = span(1.0, 4.0, "mm", 0.2, 6.0, "radius")
    iris_db: Sampled = span(-8.0, 11.0, None, -60.0, 40.0)
    iris_attenuation_per_m: Sampled = span(0.4, 15.0, "per_mm", 0.0, 50.0)
    iris_grain_db: Sampled = span(0.0, 5.0, None, 0.0, 20.0, "standard deviation")
    crypt_count: Sampled = quantity(
        Choice((0, 0, 2, 5)), None, 0, 50, "pits in the front of each half"
    )
    crypt_m: Sampled = span(40.0, 250.0, "um", 1.0, 2000.0, "half width")
    pigment_db: Sampled = span(
        -3.0, 10.0, None, -40.0, 40.0, "layer at its back, over the iris"
    )
    pigment_m: Sampled = span(30.0, 120.0, "um", 1.0, 1000.0)
    lens_share: float = share(0.75)
    lens_depth_m: Sampled = span(
        -0.3, 0.5, "mm", -3.0, 3.0, "of its front below the pupil's plane"
    )
    lens_radius_m: Sampled = span(7.0, 14.0, "mm", 3.0, 50.0)
    lens_db: Sampled = span(-30.0, 5.0, None, -80.0, 40.0, "inside of the lens")
    lens_rim_m: Sampled = span(0.5, 4.0, "mm", 0.01, 10.0, "thickness at its rim")
    lens_layer_db: Sampled = span(
        0.0, 10.0, None, 0.0, 40.0, "of cortex and nucleus, more or less"
    )
    capsule_db: Sampled = span(-12.0, 12.0, None, -60.0, 60.0)
    capsule_m: Sampled = span(20.0, 150.0, "um", 1.0, 1000.0, "bright front layer")
    haze_share: float = share(0.35)
    haze_db: Sampled = span(-30.0, -12.0, None, -80.0, 20.0, "of the aqueous")


@dataclass(frozen=True, kw_only=True)
class SceneOverStudy(StudySection):
    """Objects over the wall, and their shadows; levels over the mean noise.

    Lashes hang below the lid. Specks float below a contact lens, which is at
    `lens_gap_m` from the eye, less towards its edge. Air, bubbles and a steel needle
    take all light.
    """

    lid_share: float = share(0.2)
    lid_reach: Sampled = span(0.04, 0.35, None, 0.0, 1.0, "over the frame's width")
    lid_m: Sampled = span(0.6, 9.0, "mm", 0.01, 10.0)
    lid_gap_m: Sampled = span(0.0, 0.8, "mm", 0.0, 10.0)
    lid_db: Sampled = span(8.0, 30.0, None, -20.0, 80.0)
    lid_attenuation_per_m: Sampled = span(1.0, 5.0, "per_mm", 0.0, 50.0)
    lash_count: Sampled = quantity(Choice((0, 0, 0, 0, 1, 3)), None, 0, 50)
    lash_m: Sampled = span(60.0, 160.0, "um", 5.0, 1000.0)
    contact_lens_share: float = share(0.35)
    lens_m: Sampled = span(
        80.0, 450.0, "um", 10.0, 2000.0, "thickness of a contact lens"
    )
    lens_gap_m: Sampled = span(0.0, 900.0, "um", 0.0, 5000.0, "under its middle")
    lens_reach_m: Sampled = span(
        5.0, 10.0, "mm", 1.0, 20.0, "from its middle to its edge"
    )
    lens_db: Sampled = span(4.0, 32.0, None, -20.0, 80.0)
    speck_count: Sampled = quantity(
        Choice((0, 0, 20, 80, 200)), None, 0, 5000, "under a contact lens"
    )
    speck_db: Sampled = span(4.0, 18.0, None, -20.0, 80.0)
    coverslip_share: float = share(0.1)
    coverslip_height_m: Sampled = span(0.02, 1.0, "mm", 0.0, 10.0)
    coverslip_m: Sampled = span(80.0, 300.0, "um", 10.0, 3000.0)
    coverslip_tilt_rad: Sampled = span(-4.0, 4.0, "deg", -45.0, 45.0)
    coverslip_db: Sampled = span(6.0, 30.0, None, -20.0, 80.0)
    drape_share: float = share(0.08)
    drape_m: Sampled = span(80.0, 300.0, "um", 10.0, 3000.0)
    drape_reach: Sampled = span(0.05, 0.3, None, 0.0, 1.0, "over the frame's width")
    drape_db: Sampled = span(10.0, 30.0, None, -20.0, 80.0)
    drape_attenuation_per_m: Sampled = span(2.0, 10.0, "per_mm", 0.0, 50.0)
    bubble_count: Sampled = quantity(Choice((0, 0, 0, 0, 0, 1, 3)), None, 0, 50)
    bubble_m: Sampled = span(40.0, 500.0, "um", 5.0, 5000.0, "radius")
    bubble_db: Sampled = span(5.0, 25.0, None, -20.0, 80.0)
    vessel_count: Sampled = quantity(Choice((0, 0, 2, 4, 10)), None, 0, 100)
    vessel_m: Sampled = span(20.0, 350.0, "um", 1.0, 5000.0)
    vessel_loss_fraction: Sampled = span(
        20.0, 92.0, "percent", 0.0, 100.0, "of the intensity"
    )
    air_share: float = share(0.05)
    air_m: Sampled = span(0.2, 2.0, "mm", 0.01, 20.0)
    needle_share: float = share(0.15)
    needle_m: Sampled = span(
        184.0, 718.0, "um", 20.0, 3000.0, "outer diameter, 34G to 22G"
    )
    needle_angle_rad: Sampled = span(
        -45.0, 45.0, "deg", -80.0, 80.0, "against the depth"
    )
    needle_db: Sampled = span(8.0, 32.0, None, -20.0, 80.0)
    tip_gap_m: Sampled = span(0.0, 1.0, "mm", 0.0, 10.0, "over the wall")
    glass_share: float = share(0.2)
    glass_pass_fraction: Sampled = span(
        30.0, 90.0, "percent", 0.0, 100.0, "of the intensity"
    )


@dataclass(frozen=True, kw_only=True)
class SceneScannerStudy(StudySection):
    """The scanner: speckle, noise, artefacts, counts (logarithmic up to where
    `saturated_fraction` are above).
    """

    speckle_rows: Sampled = span(0.3, 3.0, None, 0.0, 50.0, "full width, pixels")
    axial_m: Sampled = span(
        4.0, 25.0, "um", 0.1, 1000.0, "full width along the depth, at most"
    )
    speckle_columns: Sampled = span(0.3, 4.0, None, 0.0, 50.0)
    looks: Sampled = span(
        1.0, 20.0, None, 1.0, 1000.0, "speckle patterns that are averaged"
    )
    averaged_share: float = share(0.4, "of the scanners show the mean of many frames")
    averaged_frames: Sampled = span(
        10.0, 150.0, None, 1.0, 10_000.0, "those frames, in place of `looks`"
    )
    averaged_floor_db: Sampled = span(
        -4.0, 10.0, None, -60.0, 60.0, "... and of `display_floor_db`"
    )
    rolloff_db: Sampled = span(
        0.0, 12.0, None, 0.0, 80.0, "from the zero delay to the lower edge"
    )
    noise_tilt_db: Sampled = span(
        -3.0, 3.0, None, -40.0, 40.0, "from the upper edge to the lower one"
    )
    fall_db: Sampled = span(0.0, 9.0, None, 0.0, 80.0, "at the frame's edge")
    fall_share: float = share(0.5, "lose light sideways, or in a ring")
    flare_share: float = share(0.45)
    flare_db: Sampled = span(2.0, 24.0, None, -20.0, 80.0, "the apex' vertical stripe")
    flare_m: Sampled = span(15.0, 300.0, "um", 1.0, 5000.0)
    ghost_count: Sampled = quantity(
        Choice((0, 0, 0, 1, 3)), None, 0, 50, "of the flare: short wide copies"
    )
    line_count: Sampled = quantity(
        Choice((0, 0, 0, 1, 3)), None, 0, 50, "horizontal reflection lines"
    )
    line_db: Sampled = span(2.0, 20.0, None, -20.0, 80.0)
    line_m: Sampled = span(5.0, 40.0, "um", 0.5, 1000.0)
    streak_count: Sampled = quantity(
        Choice((0, 0, 0, 1, 3)), None, 0, 50, "slanted streaks of haze"
    )
    streak_db: Sampled = span(2.0, 12.0, None, -20.0, 80.0)
    streak_m: Sampled = span(0.1, 0.5, "mm", 0.01, 10.0)
    mirrored_share: float = share(0.5, "light from above the zero delay is folded in")
    linear_share: float = share(
        0.12, "of the scales; root_share: square roots, the rest logarithmic"
    )
    root_share: float = share(0.18)
    display_floor_db: Sampled = span(
        -8.0, 8.0, None, -60.0, 60.0, "count 0 of a logarithmic scale, over the noise"
    )
    saturated_fraction: Sampled = span(0.02, 5.0, "percent", 0.0, 50.0, "of the pixels")
    gamma: Sampled = span(0.7, 1.6, None, 0.05, 20.0, "on top of the scale")
    bits: Sampled = quantity(Choice((8, 8, 10, 12, 16)), None, 8, 16)
    lost_share: float = share(0.1)
    lost_columns: Sampled = quantity(
        Choice((1, 2, 4, 8, 20)), None, 1, 1000, "in a run"
    )
    band_share: float = share(0.25)
    band_fraction: Sampled = span(
        0.5, 8.0, "percent", 0.0, 45.0, "black, at each side: of the width"
    )
    arc_share: float = share(0.25)
    arc_fraction: Sampled = span(
        1.0,
        12.0,
        "percent",
        0.0,
        45.0,
        "of the depth, above and below a curved picture",
    )
    mark_count: Sampled = quantity(
        Choice((0, 0, 0, 0, 1, 2)), None, 0, 50, "lines and boxes of a program"
    )
    margin_share: float = share(0.12, "are on a page")
    margin_fraction: Sampled = span(
        1.0, 15.0, "percent", 0.0, 45.0, "of the size, at some sides"
    )
    margin_level: Sampled = span(0.0, 1.0, None, 0.0, 1.0, "its grey: black 0, white 1")

    def _check(self) -> None:
        if self.linear_share + self.root_share > 1.0:
            raise StudyError("root_share: with linear_share more than 1")


DENTED_DEEP = 0.3  # of the dents of other views: a needle at the apex is rare


@dataclass(frozen=True, kw_only=True)
class ScenesStudy(StudySection):
    """All of a drawn scene; `seed` and the scene's number decide what is drawn."""

    seed: int = quantity(0, None, 0, 2**31 - 1)
    window: SceneWindowStudy = field(default_factory=SceneWindowStudy)
    eye: SceneEyeStudy = field(default_factory=SceneEyeStudy)
    tissue: SceneTissueStudy = field(default_factory=SceneTissueStudy)
    over: SceneOverStudy = field(default_factory=SceneOverStudy)
    scanner: SceneScannerStudy = field(default_factory=SceneScannerStudy)

    def of_one(self, rng: np.random.Generator) -> "ScenesStudy":
        """Draw whether a scene is a deep view, with a cornea, and whether its scanner
        averages; return its ranges.
        """
        is_deep = rng.random() < self.window.deep_share
        is_averaged = rng.random() < self.scanner.averaged_share
        window = self.window
        eye = self.eye
        scanner = self.scanner

        if is_deep:
            names = (
                item.name
                for item in fields(window)
                if hasattr(window, f"deep_{item.name}")
            )
            window = replace(
                window,
                centred_share=1.0,
                **{name: getattr(window, f"deep_{name}") for name in names},
            )
            eye = replace(
                eye, half_sphere_share=0.0, dent_share=eye.dent_share * DENTED_DEEP
            )

        if is_averaged:
            scanner = replace(
                scanner,
                looks=scanner.averaged_frames,
                display_floor_db=scanner.averaged_floor_db,
            )

        return replace(self, window=window, eye=eye, scanner=scanner)
