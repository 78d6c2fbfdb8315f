"""The images of a study: the raw frame, the slice, the virtual laboratory `[phantom]`, and `[scenes]`.

Every effect of `[phantom]` and `[scenes]` is a range with a unit, or the share of the scenes that show it. Levels
in dB are ratios of intensity. Ranges of `[phantom]` without another source are from spectral-domain scanners at
840 nm; `docs/wall_finder.md` has the sources of `[scenes]`.
"""

from dataclasses import dataclass, field

from scleraforce.errors import StudyError
from scleraforce.study.fields import Choice, Range, Sampled, Section, fixed, option, quantity


@dataclass(frozen=True, kw_only=True)
class OctStudy(Section):
    """The scanner's raw frame (paper sec. 3.1). `refractive_index` 1: depth is corrected already."""

    width_m: float = quantity(15.0, "mm", 0.1, 50.0)
    depth_m: float = quantity(4.0, "mm", 0.1, 50.0)
    columns: int = quantity(512, None, 32, 8192)
    rows: int = quantity(512, None, 32, 8192)
    bits: int = quantity(12, None, 8, 16)
    refractive_index: float = quantity(1.0, None, 1.0, 2.0)


@dataclass(frozen=True, kw_only=True)
class SliceStudy(Section):
    """The binary slice. `margin_m`: depth of the unloaded wall's top below row 0."""

    columns: int = quantity(140, None, 8, 4096)
    rows: int = quantity(40, None, 8, 4096)
    pixel_m: float = quantity(0.1, "mm", 0.001, 1.0)
    margin_m: float = quantity(0.3, "mm", 0.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class PhantomStudy(Section):
    """Ranges of a virtual acquisition; `docs/recordings.md` says what is drawn per frame and what per recording."""

    seed: int = quantity(0, None, 0, 2**31 - 1)
    # the scanner: speckle, noise, display
    snr_db: Sampled = quantity(Range(min=15.0, max=35.0), None, 0.0, 80.0)
    axial_resolution_m: Sampled = quantity(Range(min=4.0, max=8.0), "um", 0.5, 100.0)
    lateral_resolution_m: Sampled = quantity(Range(min=15.0, max=35.0), "um", 1.0, 500.0)
    display_floor_db: Sampled = quantity(Range(min=-8.0, max=-6.0), None, -60.0, 20.0)
    display_range_db: Sampled = quantity(Range(min=34.0, max=46.0), None, 5.0, 120.0)
    display: str = option("logarithmic", "logarithmic", "root", "linear")
    band_m: Sampled = quantity(Range(min=0.4, max=0.6), "mm", 0.0, 5.0)
    # the wall and what lies below it
    attenuation_per_m: Sampled = quantity(Range(min=0.5, max=1.5), "per_mm", 0.0, 20.0)
    reflection_db: Sampled = quantity(Range(min=-3.0, max=9.0), None, -60.0, 60.0)
    reflection_angle_rad: Sampled = quantity(Range(min=3.0, max=8.0), "deg", 0.1, 90.0)
    choroid_level_db: Sampled = quantity(Range(min=-12.0, max=-6.0), None, -80.0, 0.0)
    choroid_attenuation_per_m: Sampled = quantity(Range(min=3.0, max=8.0), "per_mm", 0.0, 50.0)
    choroid_thickness_m: Sampled = quantity(Range(min=100.0, max=250.0), "um", 0.0, 2000.0)
    # what disturbs the image
    shadow_count: Sampled = quantity(Choice((0, 1, 2, 3)), None, 0, 50)
    shadow_loss_fraction: Sampled = quantity(Range(min=20.0, max=60.0), "percent", 0.0, 100.0)
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
    conjunctiva_wave_fraction: Sampled = quantity(Range(min=0.0, max=20.0), "percent", 0.0, 90.0)
    conjunctiva_wave_length_m: Sampled = quantity(Range(min=1.5, max=8.0), "mm", 0.2, 100.0)
    conjunctiva_level_db: Sampled = quantity(Range(min=-5.0, max=-1.5), None, -80.0, 20.0)
    conjunctiva_interface_db: Sampled = quantity(Range(min=-6.0, max=3.0), None, -80.0, 60.0)
    conjunctiva_modulus_pa: Sampled = quantity(Range(min=5.0, max=20.0), "kpa", 0.1, 10_000.0)
    # the needle, where it crosses the picture
    needle_count: Sampled = quantity(fixed(0), None, 0, 1)
    needle_angle_rad: Sampled = quantity(Range(min=-45.0, max=45.0), "deg", -75.0, 75.0)
    needle_lean_rad: Sampled = quantity(fixed(0.0), "deg", -75.0, 75.0)
    needle_bevel_rad: Sampled = quantity(Choice((90.0, 20.0)), "deg", 5.0, 90.0)
    needle_above_m: Sampled = quantity(Range(min=0.0, max=3.0), "mm", 0.0, 30.0)
    needle_loss_fraction: Sampled = quantity(Choice((100.0, 100.0, 60.0)), "percent", 0.0, 100.0)
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
    force_offset_n: Sampled = quantity(Range(min=-20.0, max=20.0), "mn", -10_000.0, 10_000.0)
    force_drift_n_per_s: Sampled = quantity(Range(min=-0.3, max=0.3), "mn_per_min", -1000.0, 1000.0)
    cross_talk_fraction: Sampled = quantity(Range(min=-3.0, max=3.0), "percent", -100.0, 100.0)
    torque_noise_nm: Sampled = quantity(fixed(0.1), "mnm", 0.0, 1000.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.frame_delay_s.bounds[1] > self.hold_s.bounds[0]:
            raise StudyError("frame_delay_s: a frame would be taken after the push is over; make hold_s longer")


def _share(share: float) -> float:
    declared: float = quantity(share, None, 0.0, 1.0)
    return declared


@dataclass(frozen=True, kw_only=True)
class SceneWindowStudy(Section):
    """The frame: its pixels, size and place; more or fewer `rows` are drawn to keep a pixel within `pixel_m`."""

    rows: Sampled = quantity(Range(min=128.0, max=256.0), None, 32, 4096)
    columns: Sampled = quantity(Range(min=176.0, max=320.0), None, 32, 4096)
    pixel_m: Sampled = quantity(Range(min=1.0, max=30.0), "um", 0.1, 200.0)
    width_m: Sampled = quantity(Range(min=2.5, max=18.0), "mm", 0.2, 50.0)
    depth_share: Sampled = quantity(Range(min=0.22, max=0.95), None, 0.01, 10.0)
    view_m: Sampled = quantity(Range(min=-11.0, max=11.0), "mm", -18.0, 18.0)
    centred_share: float = _share(0.4)  # look at the apex, within a tenth of `view_m`
    facing: Sampled = quantity(Range(min=0.0, max=1.0), None, 0.0, 1.0)
    tilt_rad: Sampled = quantity(Range(min=-15.0, max=15.0), "deg", -60.0, 60.0)
    surface_share: Sampled = quantity(Range(min=-0.15, max=0.6), None, -1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class SceneEyeStudy(Section):
    """The wall: its meridian has one radius in the cornea and another in the sclera; they meet at `limbus_m`.

    Both thicknesses are along the normal. Half of the waves change the thickness, too. A dent is a Gaussian.
    """

    half_sphere_share: float = _share(0.25)  # no cornea: one radius, as the wall of `phantom`
    cornea_radius_m: Sampled = quantity(Range(min=6.3, max=9.0), "mm", 3.0, 50.0)
    sclera_radius_m: Sampled = quantity(Range(min=10.5, max=14.0), "mm", 3.0, 50.0)
    limbus_m: Sampled = quantity(Range(min=5.2, max=7.2), "mm", 1.0, 20.0)
    limbus_width_m: Sampled = quantity(Range(min=0.6, max=3.5), "mm", 0.05, 10.0)
    limbus_edge_m: Sampled = quantity(Range(min=0.1, max=2.0), "mm", 0.01, 10.0)
    limbus_slant_m: Sampled = quantity(Range(min=-1.0, max=2.0), "mm", -5.0, 5.0)
    limbus_wedge_m: Sampled = quantity(Range(min=0.0, max=0.8), "mm", -5.0, 5.0)
    spur_m: Sampled = quantity(Range(min=-0.2, max=1.0), "mm", -3.0, 5.0)
    spur_bump_m: Sampled = quantity(Range(min=0.0, max=120.0), "um", 0.0, 1000.0)
    sulcus_rad: Sampled = quantity(Range(min=0.0, max=30.0), "deg", -30.0, 30.0)
    cornea_thickness_m: Sampled = quantity(Range(min=350.0, max=1000.0), "um", 100.0, 3000.0)
    sclera_thickness_m: Sampled = quantity(Range(min=350.0, max=1200.0), "um", 100.0, 3000.0)
    wave_m: Sampled = quantity(Range(min=0.0, max=40.0), "um", 0.0, 1000.0)
    wave_length_m: Sampled = quantity(Range(min=0.8, max=5.0), "mm", 0.1, 50.0)
    dent_share: float = _share(0.4)
    dent_depth_m: Sampled = quantity(Range(min=0.05, max=4.0), "mm", 0.0, 12.0)
    dent_width_m: Sampled = quantity(Range(min=0.3, max=2.5), "mm", 0.05, 10.0)
    dent_rim: Sampled = quantity(Range(min=0.0, max=0.2), None, 0.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class SceneTissueStudy(Section):
    """The tissue below the surface; levels against the sclera's backscatter unless said otherwise.

    `profile_db` is how much brighter or darker the wall may be at some depths. The ciliary body begins at the scleral
    spur and thins into the choroid. Without a gap, both are at least 3 dB weaker than the sclera: no one could tell
    them apart otherwise. The iris begins on the ciliary body's face; before it is the recess of the chamber angle.
    """

    snr_db: Sampled = quantity(Range(min=8.0, max=34.0), None, 0.0, 80.0)
    cornea_db: Sampled = quantity(Range(min=-8.0, max=4.0), None, -40.0, 40.0)
    angle_fall_db: Sampled = quantity(Range(min=0.0, max=20.0), None, 0.0, 60.0)
    angle_width_rad: Sampled = quantity(Range(min=6.0, max=30.0), "deg", 0.5, 90.0)
    attenuation_per_m: Sampled = quantity(Range(min=0.1, max=1.8), "per_mm", 0.0, 20.0)
    profile_db: Sampled = quantity(Range(min=0.0, max=4.0), None, 0.0, 40.0)
    epithelium_db: Sampled = quantity(Range(min=-8.0, max=4.0), None, -40.0, 40.0)
    epithelium_m: Sampled = quantity(Range(min=40.0, max=90.0), "um", 1.0, 500.0)
    scar_count: Sampled = quantity(Choice((0, 0, 0, 1, 2)), None, 0, 50)
    scar_m: Sampled = quantity(Range(min=0.05, max=1.2), "mm", 0.001, 10.0)
    scar_height_m: Sampled = quantity(Range(min=30.0, max=400.0), "um", 1.0, 3000.0)
    scar_db: Sampled = quantity(Range(min=-18.0, max=8.0), None, -60.0, 40.0)
    scar_loss_fraction: Sampled = quantity(Range(min=0.0, max=85.0), "percent", 0.0, 100.0)
    texture_db: Sampled = quantity(Range(min=0.0, max=4.0), None, 0.0, 20.0)
    texture_length_m: Sampled = quantity(Range(min=100.0, max=3000.0), "um", 5.0, 20_000.0)
    texture_height_m: Sampled = quantity(Range(min=30.0, max=150.0), "um", 2.0, 5000.0)
    reflection_db: Sampled = quantity(Range(min=-6.0, max=18.0), None, -60.0, 60.0)
    reflection_angle_rad: Sampled = quantity(Range(min=3.0, max=20.0), "deg", 0.1, 90.0)
    boundary_db: Sampled = quantity(Range(min=-10.0, max=10.0), None, -60.0, 60.0)
    corrected_share: float = _share(0.4)  # the scanner has corrected the depth and the bending of the rays
    refractive_index: Sampled = quantity(Range(min=1.33, max=1.42), None, 1.0, 2.0)
    conjunctiva_share: float = _share(0.35)
    conjunctiva_m: Sampled = quantity(Range(min=50.0, max=250.0), "um", 1.0, 2000.0)
    conjunctiva_db: Sampled = quantity(Range(min=-12.0, max=2.0), None, -60.0, 40.0)
    tenon_share: Sampled = quantity(Range(min=0.2, max=0.7), None, 0.0, 1.0)  # lower part of the conjunctiva
    tenon_db: Sampled = quantity(Range(min=-18.0, max=-3.0), None, -60.0, 40.0)
    uvea_share: float = _share(0.75)
    choroid_m: Sampled = quantity(Range(min=80.0, max=320.0), "um", 1.0, 2000.0)
    ciliary_m: Sampled = quantity(Range(min=0.2, max=1.3), "mm", 0.01, 5.0)
    ciliary_rise_m: Sampled = quantity(Range(min=0.1, max=0.9), "mm", 0.01, 10.0)
    ciliary_length_m: Sampled = quantity(Range(min=2.0, max=6.0), "mm", 0.1, 20.0)
    uvea_db: Sampled = quantity(Range(min=-16.0, max=0.0), None, -60.0, 40.0)
    gap_share: float = _share(0.5)
    gap_m: Sampled = quantity(Range(min=15.0, max=60.0), "um", 1.0, 1000.0)
    gap_db: Sampled = quantity(Range(min=-20.0, max=-4.0), None, -60.0, 40.0)
    uvea_attenuation_per_m: Sampled = quantity(Range(min=0.5, max=8.0), "per_mm", 0.0, 50.0)
    iris_share: float = _share(0.7)
    iris_m: Sampled = quantity(Range(min=0.25, max=0.6), "mm", 0.01, 3.0)
    iris_root: Sampled = quantity(Range(min=0.0, max=1.0), None, 0.0, 1.0)
    iris_depth_m: Sampled = quantity(Range(min=-0.8, max=0.6), "mm", -5.0, 5.0)
    iris_bow_m: Sampled = quantity(Range(min=-0.4, max=0.3), "mm", -3.0, 3.0)
    pupil_m: Sampled = quantity(Range(min=1.0, max=4.0), "mm", 0.2, 6.0)
    iris_db: Sampled = quantity(Range(min=-8.0, max=6.0), None, -60.0, 40.0)
    iris_attenuation_per_m: Sampled = quantity(Range(min=1.0, max=6.0), "per_mm", 0.0, 50.0)
    lens_share: float = _share(0.65)
    lens_depth_m: Sampled = quantity(Range(min=-0.3, max=0.5), "mm", -3.0, 3.0)
    lens_radius_m: Sampled = quantity(Range(min=7.0, max=14.0), "mm", 3.0, 50.0)
    lens_db: Sampled = quantity(Range(min=-30.0, max=-8.0), None, -80.0, 40.0)
    capsule_db: Sampled = quantity(Range(min=-12.0, max=6.0), None, -60.0, 60.0)
    capsule_m: Sampled = quantity(Range(min=20.0, max=150.0), "um", 1.0, 1000.0)
    haze_share: float = _share(0.35)
    haze_db: Sampled = quantity(Range(min=-30.0, max=-12.0), None, -80.0, 20.0)


@dataclass(frozen=True, kw_only=True)
class SceneOverStudy(Section):
    """Objects over the wall, and their shadows; levels over the mean noise.

    Lashes hang below the lid. Specks float below a contact lens, which is at `lens_gap_m` from the eye, less towards
    its edge. Air, bubbles and a steel needle take all light.
    """

    lid_share: float = _share(0.2)
    lid_reach: Sampled = quantity(Range(min=0.04, max=0.35), None, 0.0, 1.0)
    lid_m: Sampled = quantity(Range(min=0.6, max=2.5), "mm", 0.01, 10.0)
    lid_gap_m: Sampled = quantity(Range(min=0.0, max=0.8), "mm", 0.0, 10.0)
    lid_db: Sampled = quantity(Range(min=8.0, max=30.0), None, -20.0, 80.0)
    lid_attenuation_per_m: Sampled = quantity(Range(min=1.0, max=5.0), "per_mm", 0.0, 50.0)
    lash_count: Sampled = quantity(Choice((0, 0, 0, 0, 1, 3)), None, 0, 50)
    lash_m: Sampled = quantity(Range(min=60.0, max=160.0), "um", 5.0, 1000.0)
    contact_lens_share: float = _share(0.35)
    lens_m: Sampled = quantity(Range(min=80.0, max=450.0), "um", 10.0, 2000.0)
    lens_gap_m: Sampled = quantity(Range(min=0.0, max=600.0), "um", 0.0, 5000.0)
    lens_reach_m: Sampled = quantity(Range(min=5.0, max=10.0), "mm", 1.0, 20.0)
    lens_db: Sampled = quantity(Range(min=4.0, max=28.0), None, -20.0, 80.0)
    speck_count: Sampled = quantity(Choice((0, 0, 20, 80, 200)), None, 0, 5000)
    speck_db: Sampled = quantity(Range(min=4.0, max=18.0), None, -20.0, 80.0)
    coverslip_share: float = _share(0.1)
    coverslip_height_m: Sampled = quantity(Range(min=0.02, max=1.0), "mm", 0.0, 10.0)
    coverslip_m: Sampled = quantity(Range(min=80.0, max=300.0), "um", 10.0, 3000.0)
    coverslip_tilt_rad: Sampled = quantity(Range(min=-4.0, max=4.0), "deg", -45.0, 45.0)
    coverslip_db: Sampled = quantity(Range(min=6.0, max=30.0), None, -20.0, 80.0)
    drape_share: float = _share(0.08)
    drape_m: Sampled = quantity(Range(min=80.0, max=300.0), "um", 10.0, 3000.0)
    drape_reach: Sampled = quantity(Range(min=0.05, max=0.3), None, 0.0, 1.0)
    drape_db: Sampled = quantity(Range(min=10.0, max=30.0), None, -20.0, 80.0)
    drape_attenuation_per_m: Sampled = quantity(Range(min=2.0, max=10.0), "per_mm", 0.0, 50.0)
    bubble_count: Sampled = quantity(Choice((0, 0, 0, 0, 0, 1, 3)), None, 0, 50)
    bubble_m: Sampled = quantity(Range(min=40.0, max=500.0), "um", 5.0, 5000.0)
    bubble_db: Sampled = quantity(Range(min=5.0, max=25.0), None, -20.0, 80.0)
    vessel_count: Sampled = quantity(Choice((0, 0, 2, 4, 10)), None, 0, 100)
    vessel_m: Sampled = quantity(Range(min=20.0, max=350.0), "um", 1.0, 5000.0)
    vessel_loss_fraction: Sampled = quantity(Range(min=20.0, max=92.0), "percent", 0.0, 100.0)
    air_share: float = _share(0.05)
    air_m: Sampled = quantity(Range(min=0.2, max=2.0), "mm", 0.01, 20.0)
    needle_share: float = _share(0.15)
    needle_m: Sampled = quantity(Range(min=184.0, max=718.0), "um", 20.0, 3000.0)  # 34G to 22G
    needle_angle_rad: Sampled = quantity(Range(min=-45.0, max=45.0), "deg", -80.0, 80.0)
    needle_db: Sampled = quantity(Range(min=8.0, max=32.0), None, -20.0, 80.0)
    tip_gap_m: Sampled = quantity(Range(min=0.0, max=1.0), "mm", 0.0, 10.0)
    glass_share: float = _share(0.2)
    glass_pass_fraction: Sampled = quantity(Range(min=30.0, max=90.0), "percent", 0.0, 100.0)


@dataclass(frozen=True, kw_only=True)
class SceneScannerStudy(Section):
    """The scanner: speckle, noise, artefacts, counts (logarithmic up to where `saturated_fraction` are above)."""

    speckle_rows: Sampled = quantity(Range(min=0.3, max=3.0), None, 0.0, 50.0)
    speckle_columns: Sampled = quantity(Range(min=0.3, max=4.0), None, 0.0, 50.0)
    looks: Sampled = quantity(Range(min=1.0, max=12.0), None, 1.0, 1000.0)
    rolloff_db: Sampled = quantity(Range(min=0.0, max=10.0), None, 0.0, 80.0)
    noise_tilt_db: Sampled = quantity(Range(min=-3.0, max=3.0), None, -40.0, 40.0)
    flare_share: float = _share(0.35)
    flare_db: Sampled = quantity(Range(min=2.0, max=22.0), None, -20.0, 80.0)
    flare_m: Sampled = quantity(Range(min=15.0, max=200.0), "um", 1.0, 5000.0)
    line_count: Sampled = quantity(Choice((0, 0, 0, 1, 3)), None, 0, 50)
    line_db: Sampled = quantity(Range(min=2.0, max=20.0), None, -20.0, 80.0)
    line_m: Sampled = quantity(Range(min=5.0, max=40.0), "um", 0.5, 1000.0)
    streak_count: Sampled = quantity(Choice((0, 0, 0, 1, 3)), None, 0, 50)
    streak_db: Sampled = quantity(Range(min=2.0, max=12.0), None, -20.0, 80.0)
    streak_m: Sampled = quantity(Range(min=0.1, max=0.5), "mm", 0.01, 10.0)
    mirrored_share: float = _share(0.5)
    linear_share: float = _share(0.12)
    root_share: float = _share(0.18)
    display_floor_db: Sampled = quantity(Range(min=-8.0, max=3.0), None, -60.0, 60.0)
    saturated_fraction: Sampled = quantity(Range(min=0.02, max=3.0), "percent", 0.0, 50.0)
    gamma: Sampled = quantity(Range(min=0.7, max=1.6), None, 0.05, 20.0)
    bits: Sampled = quantity(Choice((8, 8, 10, 12, 16)), None, 8, 16)
    lost_share: float = _share(0.1)
    lost_columns: Sampled = quantity(Choice((1, 2, 4, 8, 20)), None, 1, 1000)
    band_share: float = _share(0.25)
    band_fraction: Sampled = quantity(Range(min=0.5, max=8.0), "percent", 0.0, 45.0)
    arc_share: float = _share(0.25)
    arc_fraction: Sampled = quantity(Range(min=1.0, max=12.0), "percent", 0.0, 45.0)
    mark_count: Sampled = quantity(Choice((0, 0, 0, 0, 1, 2)), None, 0, 50)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.linear_share + self.root_share > 1.0:
            raise StudyError("root_share: with linear_share more than 1")


@dataclass(frozen=True, kw_only=True)
class ScenesStudy(Section):
    """All of a drawn scene; `seed` and the scene's number decide what is drawn."""

    seed: int = quantity(0, None, 0, 2**31 - 1)
    window: SceneWindowStudy = field(default_factory=SceneWindowStudy)
    eye: SceneEyeStudy = field(default_factory=SceneEyeStudy)
    tissue: SceneTissueStudy = field(default_factory=SceneTissueStudy)
    over: SceneOverStudy = field(default_factory=SceneOverStudy)
    scanner: SceneScannerStudy = field(default_factory=SceneScannerStudy)
