"""The file recording.toml: an eye, a scan, a needle and a force sensor."""

from dataclasses import dataclass

from scleraforce.base.errors import StudyError
from scleraforce.records.eye import EyeInfo, Known, stated_globe
from scleraforce.records.fields import check_fields, quantity, required
from scleraforce.records.needle import NeedleInfo
from scleraforce.records.scan import OctInfo
from scleraforce.records.tissue_relaxation import KnownRelaxation


@dataclass(frozen=True)
class ForceInfo:
    """The force log: sensor axis along the needle, its sign in contact, how long a
    label averages, and the largest force that the sensor measures (None: not stated).
    """

    axis: str = required("fx", "fy", "fz")
    contact_sign: int = required(low=-1, high=1)
    average_s: float = quantity(2.0, None, 0.01, 60.0)
    range_n: float | None = quantity(None, None, 1e-3, 1e6)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.contact_sign == 0:
            raise StudyError("contact_sign: 0 is not a sign; give 1 or -1")


@dataclass(frozen=True)
class RecordingInfo:
    """The contents of `recording.toml`; `force` may be omitted without a force log."""

    eye: EyeInfo
    oct: OctInfo
    needle: NeedleInfo
    force: ForceInfo | None = None

    def __post_init__(self) -> None:
        if self.needle.slice_gap_m is None and not self.oct.plane:
            raise StudyError(
                "needle.slice_gap_m: missing; give it, or [[oct.plane]] for each of"
                " several planes"
            )
        if self.needle.slice_gap_m is not None and self.oct.plane:
            raise StudyError(
                "needle.slice_gap_m: of a single plane, and there are [[oct.plane]]:"
                " leave it out"
            )


def known_of_recording(info: RecordingInfo) -> Known:
    """Return the known inputs that a recording states; it never states the modulus,
    which a calibration may add.
    """
    return Known(
        iop_pa=info.eye.iop_pa,
        thickness_m=info.eye.thickness_m,
        gap_m=info.needle.slice_gap_m,
        polar_rad=info.needle.polar_angle_rad,
        direction_rad=info.oct.plane_direction_rad,
        globe=stated_globe(info.eye),
        relaxation=(
            None
            if info.eye.relaxation is None
            else KnownRelaxation.declared(info.eye.relaxation)
        ),
        lean_rad=None if info.needle.lean_rad is None else (info.needle.lean_rad,) * 2,
        lean_azimuth_rad=info.needle.lean_azimuth_rad,
        leak_time_s=info.eye.leak_time_s,
    )
