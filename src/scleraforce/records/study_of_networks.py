"""The networks of a study and their training data; `docs/reader.md` explains the ranges
of `[reader]`.
"""

from dataclasses import dataclass, field, fields

from scleraforce.base.errors import StudyError
from scleraforce.records.fields import Range, Sampled, StudySection, Unit, quantity


@dataclass(frozen=True, kw_only=True)
class NetworkStudy(StudySection):
    """The classifier and its training (paper sec. 2.4).

    A sample of `mirror` with left and right exchanged is the same B-scan plane, seen
    from behind.
    """

    # may be empty
    hidden: tuple[int, ...] = field(
        default=(600, 600), metadata={"unit": Unit(low=1, high=100_000)}
    )
    dropout: float = quantity(0.8, None, 0.0, 0.99)
    dropout_masks: int = quantity(4, None, 1, 64)
    mirror: bool = True
    learning_rate: float = quantity(0.05, None, 1e-8, 10.0)
    momentum: float = quantity(0.9, None, 0.0, 0.9999)
    warmup: float = quantity(0.1, None, 0.0, 0.9)
    max_gradient_norm: float = quantity(1.0, None, 1e-6, 1e6)
    batch_size: int = quantity(128, None, 1, 100_000)
    epochs: int = quantity(10, None, 1, 100_000)
    seed: int = quantity(0, None, 0, 2**31 - 1)
    search_widths: tuple[int, ...] = quantity((150, 300, 600, 1200), None, 1, 100_000)
    search_depths: tuple[int, ...] = quantity((1, 2, 3), None, 1, 20)


@dataclass(frozen=True, kw_only=True)
class WallFinderStudy(StudySection):
    """The network that finds the wall in reduced frames; each level of `channels` has
    half the resolution.

    The first level already has half the frame's rows and columns, so both are multiples
    of two to the power of the number of levels. No scene is used twice.
    """

    rows: int = quantity(192, None, 16, 1024)
    columns: int = quantity(256, None, 16, 1024)
    channels: tuple[int, ...] = quantity((12, 24, 40, 64, 88), None, 1, 512)
    target_rows: float = quantity(0.6, None, 0.05, 10.0)
    learning_rate: float = quantity(0.003, None, 1e-8, 10.0)
    warmup: float = quantity(0.05, None, 0.0, 0.9)
    weight_decay: float = quantity(1e-4, None, 0.0, 1.0)
    max_gradient_norm: float = quantity(5.0, None, 1e-6, 1e6)
    batch_size: int = quantity(8, None, 1, 10_000)
    batches: int = quantity(10_000, None, 1, 10_000_000)
    validation_scenes: int = quantity(400, None, 1, 1_000_000)
    seed: int = quantity(0, None, 0, 2**31 - 1)

    def _check(self) -> None:
        least = 2 ** len(self.channels)
        for key in ("rows", "columns"):
            if getattr(self, key) % least:
                raise StudyError(
                    f"{key}: {getattr(self, key)} is not a multiple of {least}, as"
                    f" {len(self.channels)} levels need"
                )


@dataclass(frozen=True, kw_only=True)
class ReaderStudy(StudySection):
    """The reader's training: eyes, framing, known inputs, the network and its descent;
    `paper.toml` explains the keys.

    Values are uniform; of the IOP and of the standard deviations of modulus and
    rigidity, the logarithm is, and of the stiffening b the logarithm of 1 + b. The
    plane's direction from the meridian is uniform on the whole circle.

    `plain_share`: most frames have no tilt; a network that met every tilt alike would
    be as unsure of all of them. `boundary_errors`: more than the network will meet.
    `interval_eyes` decide the width of intervals (`reading.interval_widths`), with as
    large an `uneven_share` (`lab.training.drawn_wall_errors`); 0 keeps the network's
    own. A given modulus is drawn from its own normal distribution; other given values
    are off by `*_noise_*`. Most samples have most values: the answer for an eye with
    all of them is sharp, and takes more samples to learn than that for an eye with few.
    """

    youngs_modulus_pa: Sampled = quantity(
        Range(min=0.15, max=0.65), "mpa", 0.001, 100.0
    )
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
    modulus_sd_fraction: Sampled = quantity(
        Range(min=0.5, max=30.0), "percent", 0.01, 100.0
    )
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
    rigidity_sd_pa13_per_m3: Sampled = quantity(
        Range(min=2e-4, max=6e-3), "mmhg13_per_ul", 1e-6, 1.0
    )
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

    def _check(self) -> None:
        if self.small_force_n > self.max_force_n:
            raise StudyError("small_force_mn: larger than max_force_mn")
        if self.globe_open_fraction + self.globe_missing_fraction > 1.0:
            raise StudyError(
                "globe_missing_percent: with globe_open_percent more than 100"
            )

    @property
    def max_force_ratio(self) -> float:
        """Largest force over the modulus, m^2: the end of the answer's histogram."""
        return self.max_force_n / self.youngs_modulus_pa.bounds[0]


@dataclass(frozen=True, kw_only=True)
class RawReaderStudy(StudySection):
    """The raw reader's training; its eyes follow `[reader]`, light and scanner follow
    `[phantom]` and `[oct]`.

    `channels` to `batches` belong to the part that sees the wall, with their meaning in
    `[wall_finder]`; `batch_size` and rates belong to the whole. The layers behind it
    learn from slices first, for `slice_epochs` of `[reader]`.
    """

    rows: int = quantity(64, None, 16, 1024)
    columns: int = quantity(112, None, 16, 1024)
    row_m: float = quantity(62.5, "um", 5.0, 1000.0)
    column_m: float = quantity(130.0, "um", 5.0, 1000.0)
    needle_share: float = quantity(0.12, None, 0.0, 1.0)
    needle_diameter_m: Sampled = quantity(
        Range(min=180.0, max=720.0), "um", 100.0, 2000.0
    )
    needle_gap_fraction: float = quantity(45.0, "percent", 1.0, 50.0)
    conjunctiva_share: float = quantity(0.2, None, 0.0, 1.0)
    conjunctiva_thickness_m: Sampled = quantity(
        Range(min=50.0, max=250.0), "um", 10.0, 1000.0
    )
    snr_loss_db: Sampled = quantity(Range(min=0.0, max=8.0), None, 0.0, 60.0)
    speckle_factor: Sampled = quantity(Range(min=1.0, max=4.0), None, 0.1, 20.0)
    slice_epochs: int = quantity(12, None, 1, 100_000)
    channels: tuple[int, ...] = quantity((8, 16, 24), None, 1, 512)
    target_rows: float = quantity(0.6, None, 0.05, 10.0)
    learning_rate: float = quantity(0.002, None, 1e-8, 10.0)
    warmup: float = quantity(0.05, None, 0.0, 0.9)
    weight_decay: float = quantity(1e-4, None, 0.0, 1.0)
    max_gradient_norm: float = quantity(5.0, None, 1e-6, 1e6)
    batch_size: int = quantity(32, None, 1, 10_000)
    batches: int = quantity(10_000, None, 1, 10_000_000)
    wall_share: float = quantity(0.15, None, 0.0, 1.0)
    validation_frames: int = quantity(2_000, None, 10, 10_000_000)
    interval_eyes: int = quantity(120, None, 0, 1_000_000)
    seed: int = quantity(0, None, 0, 2**31 - 1)

    def _check(self) -> None:
        if self.rows % 2:
            raise StudyError(
                f"rows: {self.rows} is odd; rows and columns are taken in pairs"
            )
        _ = self.wall  # which checks its sizes

    @property
    def wall(self) -> WallFinderStudy:
        """The part that sees the wall, and how all of it descends."""
        shared = {item.name for item in fields(self)} & {
            item.name for item in fields(WallFinderStudy)
        }
        return WallFinderStudy(**{name: getattr(self, name) for name in shared})
