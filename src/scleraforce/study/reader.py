"""The `[reader]` section of a study: what the force reader is trained on, and its network.

Ranges are those of the simulated eyes and of what is told about them; `docs/reader.md` explains each value.
"""

from dataclasses import dataclass

from scleraforce.errors import StudyError
from scleraforce.study.fields import check_fields, quantity
from scleraforce.study.sampled import Range, Sampled


@dataclass(frozen=True, kw_only=True)
class ReaderStudy:
    """The reader's training: eyes, framing, what is known of an eye, the network and its descent.

    IOP is drawn with its logarithm evenly spread, all else evenly. Forces are even from 0 to `max_force_n`;
    `small_force_share` of them are even from 0 to `small_force_n` instead. `size` is the eye's over the study's
    (radius, wall and dent together). `rotation_rad` turns the section in its frame, `tilt_rad` the plane about its
    lateral axis. `plain_share` of the samples have the study's size, no tilt and no rotation, as most frames have: a
    network that met every tilt alike would be as unsure of all of them. `surface_depth_m` is the depth of the
    undeformed contact below the frame's top edge. `polar_angle_rad` is the contact's polar angle; the direction of the
    plane from the meridian is drawn from the whole circle.

    `stiffening_share` of the tissue stiffens, as far as the library has it: the logarithm of 1 + b is even.
    `uneven_share` of the walls are no even spheres at rest (`learning.reader.uneven`). So many `interval_eyes`, of
    which as many are uneven, tell how wide intervals have to be (`reader.interval_factors`); 0: they stay as they are.

    `boundary_errors`: times the errors that the segmentation of rendered frames makes, in the samples of the network,
    which has to stand more than it will see; `interval_boundary_errors` in the frames of the eyes that intervals are
    measured on, which are to be as wide as they have to.

    The modulus that the network is told comes with its relative standard deviation (its logarithm even over
    `modulus_sd_fraction`); the eye's own is drawn from that normal distribution. Other known values are off by
    `*_noise_fraction` (standard deviation), polar angle and direction by `pole_noise_rad`; a modulus that is told as
    surer than 6 % was calibrated with these. Each value is missing in `*_missing_fraction` of the samples.

    `globe_open_fraction` of the globes are open and told so, of `globe_missing_fraction` nothing is told
    (`known.globe`: the rigidity is even in its range); the others are sealed. Of `rigidity_missing_fraction` of these
    no rigidity is told, of the rest its mean and its standard deviation, as a calibration finds them (the logarithm
    even over `rigidity_sd_pa13_per_m3`). Most values are told of most samples: what is said of an eye with all of them
    is sharp, and takes more samples to learn than what is said of one with few.
    """

    youngs_modulus_pa: Sampled = quantity(Range(min=0.15, max=0.65), "mpa", 0.001, 100.0)
    iop_pa: Sampled = quantity(Range(min=0.5, max=5.0), "mmhg", 0.01, 80.0)
    thickness_m: Sampled = quantity(Range(min=380.0, max=900.0), "um", 300.0, 1200.0)
    gap_m: Sampled = quantity(Range(min=0.3, max=1.0), "mm", 0.0, 5.0)
    max_force_n: float = quantity(70.0, "mn", 1.0, 1000.0)
    small_force_n: float = quantity(8.0, "mn", 0.1, 1000.0)
    small_force_share: float = quantity(0.15, None, 0.0, 1.0)
    lateral_m: Sampled = quantity(Range(min=-1.0, max=1.0), "mm", -10.0, 10.0)
    surface_depth_m: Sampled = quantity(Range(min=0.15, max=0.9), "mm", -10.0, 10.0)
    size: Sampled = quantity(Range(min=0.95, max=1.05), None, 0.5, 2.0)
    tilt_rad: Sampled = quantity(Range(min=-5.0, max=5.0), "deg", -45.0, 45.0)
    rotation_rad: Sampled = quantity(Range(min=-5.0, max=5.0), "deg", -45.0, 45.0)
    polar_angle_rad: Sampled = quantity(Range(min=10.0, max=55.0), "deg", 0.0, 80.0)
    plain_share: float = quantity(0.5, None, 0.0, 1.0)
    uneven_share: float = quantity(0.4, None, 0.0, 1.0)
    stiffening_share: float = quantity(0.4, None, 0.0, 1.0)
    interval_eyes: int = quantity(210, None, 0, 1_000_000)
    boundary_errors: float = quantity(1.5, None, 0.0, 100.0)
    interval_boundary_errors: float = quantity(1.0, None, 0.0, 100.0)
    modulus_sd_fraction: Sampled = quantity(Range(min=0.5, max=30.0), "percent", 0.01, 100.0)
    iop_noise_fraction: float = quantity(5.0, "percent", 0.0, 50.0)
    thickness_noise_fraction: float = quantity(3.0, "percent", 0.0, 50.0)
    gap_noise_fraction: float = quantity(3.0, "percent", 0.0, 50.0)
    pole_noise_rad: float = quantity(2.0, "deg", 0.0, 45.0)
    modulus_missing_fraction: float = quantity(5.0, "percent", 0.0, 100.0)
    iop_missing_fraction: float = quantity(10.0, "percent", 0.0, 100.0)
    thickness_missing_fraction: float = quantity(10.0, "percent", 0.0, 100.0)
    gap_missing_fraction: float = quantity(10.0, "percent", 0.0, 100.0)
    polar_missing_fraction: float = quantity(15.0, "percent", 0.0, 100.0)
    direction_missing_fraction: float = quantity(30.0, "percent", 0.0, 100.0)
    globe_open_fraction: float = quantity(30.0, "percent", 0.0, 100.0)
    globe_missing_fraction: float = quantity(15.0, "percent", 0.0, 100.0)
    rigidity_missing_fraction: float = quantity(30.0, "percent", 0.0, 100.0)
    rigidity_sd_pa13_per_m3: Sampled = quantity(Range(min=2e-4, max=6e-3), "mmhg13_per_ul", 1e-6, 1.0)
    bins: int = quantity(128, None, 8, 4096)
    channels: tuple[int, ...] = quantity((32, 48, 64), None, 1, 4096)
    hidden: tuple[int, ...] = quantity((256, 256), None, 1, 100_000)
    learning_rate: float = quantity(0.002, None, 1e-8, 10.0)
    warmup: float = quantity(0.1, None, 0.0, 0.9)
    weight_decay: float = quantity(1e-4, None, 0.0, 1.0)
    max_gradient_norm: float = quantity(5.0, None, 1e-6, 1e6)
    batch_size: int = quantity(128, None, 1, 100_000)
    epochs: int = quantity(40, None, 1, 100_000)
    samples_per_epoch: int = quantity(40_000, None, 1, 100_000_000)
    validation_samples: int = quantity(6_000, None, 10, 100_000_000)
    seed: int = quantity(0, None, 0, 2**31 - 1)

    def __post_init__(self) -> None:
        check_fields(self)
        if not (self.channels and self.hidden):
            key = "hidden" if self.channels else "channels"
            raise StudyError(f"{key}: an empty list; give at least one value")
        if self.small_force_n > self.max_force_n:
            raise StudyError("small_force_mn: larger than max_force_mn")
        if self.globe_open_fraction + self.globe_missing_fraction > 1.0:
            raise StudyError("globe_missing_percent: with globe_open_percent more than 100")

    @property
    def max_force_ratio(self) -> float:
        """Largest force over the modulus that the network is told, m^2: where its answer's histogram ends.

        >>> round(ReaderStudy().max_force_ratio * 1e6, 3)
        0.467
        """
        return self.max_force_n / self.youngs_modulus_pa.bounds[0]
