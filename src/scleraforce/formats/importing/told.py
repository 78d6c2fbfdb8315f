"""What was told of sources, of their scale, times and forces, and of the eye."""

from dataclasses import dataclass
from pathlib import Path

from scleraforce.formats.axes import parse_axes
from scleraforce.formats.bags import BagTopics
from scleraforce.formats.gather import Asked
from scleraforce.formats.log_columns import parse_column
from scleraforce.formats.sources import SourceOrder

OPTION = "option"  # the source of a value that was told for this recording, by an option or an argument


@dataclass(frozen=True, kw_only=True)
class ImportAnswers:
    """The values of all options of `scleraforce import`, in the units of their names; None: open."""

    axes: str | None = None
    array: str | None = None
    width_mm: float | None = None
    depth_mm: float | None = None
    refractive_index: float | None = None
    bits: int | None = None
    grey_range: tuple[float, float] | None = None
    rate_hz: float | None = None
    times: Path | None = None
    clock_offset_s: float | None = None
    columns: tuple[str, ...] = ()
    axis: str | None = None
    contact_sign: str | int | None = None
    average_s: float | None = None
    image_topic: str | None = None
    force_topic: str | None = None
    by_arrival: bool = False
    eye: str | None = None
    thickness_um: float | None = None
    iop_mmhg: float | None = None
    globe: str | None = None
    gauge: int | None = None
    gap_mm: float | None = None
    polar_angle_deg: float | None = None

    def asked(self) -> Asked:
        """Return what concerns the reading of sources."""
        return Asked(
            SourceOrder(None if self.axes is None else parse_axes(self.axes), self.array),
            tuple(parse_column(text) for text in self.columns),
            BagTopics(self.image_topic, self.force_topic, self.by_arrival),
        )
