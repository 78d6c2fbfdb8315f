"""The `[raw_reader]` section of a study: the network that reads the force from a raw frame, and its training."""

from dataclasses import dataclass, fields

from scleraforce.errors import StudyError
from scleraforce.study.fields import check_fields, quantity
from scleraforce.study.sampled import Range, Sampled
from scleraforce.study.wall_finder import WallFinderStudy


@dataclass(frozen=True, kw_only=True)
class RawReaderStudy:
    """The raw reader's training; eyes are those of `[reader]`, light and scanner those of `[phantom]` and `[oct]`.

    Frames are reduced to `rows` x `columns` pixels of `row_m` x `column_m`. `channels` to `batches` are those of the
    part that sees the wall, and mean what they mean in `[wall_finder]`; `batch_size` and rates are those of all of it.
    The layers behind it learn from slices first, for `slice_epochs` of `[reader]`; in the first `wall_share` of the
    batches of raw frames the wall alone is learned.

    `needle_share` of the frames are crossed by a needle of `needle_diameter_m`, at most `needle_gap_fraction` of that
    from its axis; `conjunctiva_share` show one of `conjunctiva_thickness_m`. Other scanners than that of `[phantom]`
    have `snr_loss_db` less signal and speckle `speckle_factor` times as large: 0 and 1 learn that scanner alone.
    """

    rows: int = quantity(64, None, 16, 1024)
    columns: int = quantity(112, None, 16, 1024)
    row_m: float = quantity(62.5, "um", 5.0, 1000.0)
    column_m: float = quantity(130.0, "um", 5.0, 1000.0)
    needle_share: float = quantity(0.12, None, 0.0, 1.0)
    needle_diameter_m: Sampled = quantity(Range(min=180.0, max=720.0), "um", 100.0, 2000.0)
    needle_gap_fraction: float = quantity(45.0, "percent", 1.0, 50.0)
    conjunctiva_share: float = quantity(0.2, None, 0.0, 1.0)
    conjunctiva_thickness_m: Sampled = quantity(Range(min=50.0, max=250.0), "um", 10.0, 1000.0)
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

    def __post_init__(self) -> None:
        check_fields(self)
        if self.rows % 2:
            raise StudyError(f"rows: {self.rows} is odd; rows and columns are taken in pairs")
        _ = self.wall  # which checks its sizes

    @property
    def wall(self) -> WallFinderStudy:
        """The part that sees the wall, and how all of it descends.

        >>> RawReaderStudy(batch_size=16).wall.batch_size
        16
        """
        shared = {item.name for item in fields(self)} & {item.name for item in fields(WallFinderStudy)}
        return WallFinderStudy(**{name: getattr(self, name) for name in shared})
