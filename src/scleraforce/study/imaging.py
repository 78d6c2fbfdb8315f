"""The images of a study: the raw frame, the slice and the virtual laboratory `[phantom]`.

Every effect of `[phantom]` is a range with a unit. Levels in dB are ratios of intensity. Ranges without another source
are from spectral-domain scanners at 840 nm.
"""

from dataclasses import dataclass

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
