"""The typed record of `recording.toml`: what a laboratory states about one eye's recording. All keys are SI but one."""

from dataclasses import KW_ONLY, dataclass
from typing import Any

from scleraforce.errors import StudyError
from scleraforce.study.eye import GLOBES, RIGIDITY_LAWS
from scleraforce.study.fields import allowed, check_fields, option, quantity, required

# Outer diameters of hypodermic needles, ISO 9626 (normal wall).
GAUGE_DIAMETER_M = {
    18: 1.2e-3,
    19: 1.1e-3,
    20: 0.9e-3,
    21: 0.8e-3,
    22: 0.7e-3,
    23: 0.6e-3,
    24: 0.55e-3,
    25: 0.5e-3,
    26: 0.45e-3,
    27: 0.4e-3,
    28: 0.36e-3,
    29: 0.33e-3,
    30: 0.3e-3,
    31: 0.25e-3,
    32: 0.23e-3,
    33: 0.2e-3,
    34: 0.18e-3,
}
LONGEST_ID = 200


def _possible(key: str) -> Any:
    """Declare an SI field that may be left out, with the bounds of `study.fields.QUANTITIES`."""
    return quantity(None, None, allowed(key).low, allowed(key).high)


@dataclass(frozen=True)
class EyeInfo:
    """The eye: a name, and what was measured on it or is known of it (None: it was not, it is not).

    `globe`: "open" (infused or vented: the needle leaves the pressure as it is) or "sealed"; of a sealed one the
    rigidity and its law (`eye.globe`), where they were measured.
    """

    id: str
    _: KW_ONLY
    thickness_m: float | None = _possible("thickness_m")
    iop_pa: float | None = _possible("iop_pa")
    globe: str | None = option(None, *GLOBES)
    rigidity_pa13_per_m3: float | None = quantity(
        None, "mmhg13_per_ul", allowed("rigidity").low, allowed("rigidity").high
    )
    rigidity_law: str | None = option(None, *RIGIDITY_LAWS)

    def __post_init__(self) -> None:
        check_fields(self)
        fault = eye_id_fault(self.id)
        if fault:
            raise StudyError(f"id: {fault}")
        told = {"rigidity_mmhg13_per_ul": self.rigidity_pa13_per_m3, "rigidity_law": self.rigidity_law}
        for key, value in told.items():
            if value is not None and self.globe != "sealed":
                found = "missing" if self.globe is None else f'"{self.globe}"'
                raise StudyError(f'{key}: of a sealed globe, globe is {found}; write globe = "sealed", or leave it out')


@dataclass(frozen=True, kw_only=True)
class OctInfo:
    """The frames: pixels, used bits, field of view (black bands included), and the plane's direction and tilt."""

    columns: int = required(low=16, high=16384)
    rows: int = required(low=16, high=16384)
    bits: int = required(low=1, high=16)
    width_m: float = required(low=allowed("width_m").low, high=allowed("width_m").high)
    depth_m: float = required(low=allowed("depth_m").low, high=allowed("depth_m").high)
    plane_direction_rad: float | None = quantity(None, None, -6.3, 6.3)
    plane_tilt_rad: float = quantity(0.0, None, -1.0, 1.0)
    refractive_index: float = quantity(1.0, None, 1.0, 2.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class NeedleInfo:
    """The needle: gauge, distance of the B-scan plane from its axis, polar angle of the contact where known."""

    gauge: int = required(low=10, high=36)
    slice_gap_m: float = required(low=allowed("gap_m").low, high=allowed("gap_m").high)
    polar_angle_rad: float | None = _possible("polar_angle_rad")

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class ForceInfo:
    """The force log: sensor axis along the needle, its sign in contact, and how long a label averages."""

    axis: str = required("fx", "fy", "fz")
    contact_sign: int = required(low=-1, high=1)
    average_s: float = quantity(2.0, None, 0.01, 60.0)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.contact_sign == 0:
            raise StudyError("contact_sign: 0 is no sign; give 1 or -1")


@dataclass(frozen=True)
class RecordingInfo:
    """What `recording.toml` says. `force` may be left out where there is no force log."""

    eye: EyeInfo
    oct: OctInfo
    needle: NeedleInfo
    force: ForceInfo | None = None


def eye_id_fault(name: str) -> str | None:
    r"""Return why a text cannot name an eye, None where it can: it stands in tables, logs and messages, in one line.

    >>> eye_id_fault("eye\nE = 0.3 MPa")
    "'eye\\nE = 0.3 MPa' has a line break or another unprintable character; give a name of one line"
    >>> eye_id_fault("Auge 3 (links), ö")
    """
    if not name.strip():
        return "empty; give the eye a name"
    if not name.isprintable():
        return f"{name[:LONGEST_ID]!r} has a line break or another unprintable character; give a name of one line"
    if len(name) > LONGEST_ID:
        return f"{len(name)} characters; give the eye a name of at most {LONGEST_ID}"
    return None


def nearest_gauge(outer_diameter_m: float) -> int:
    """Return the gauge of a needle.

    >>> nearest_gauge(0.7e-3)
    22
    """
    return min(GAUGE_DIAMETER_M, key=lambda gauge: abs(GAUGE_DIAMETER_M[gauge] - outer_diameter_m))
