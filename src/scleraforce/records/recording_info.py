"""The file recording.toml: an eye, a scan, a needle and a force sensor."""

from dataclasses import dataclass, field, fields

from scleraforce.base.errors import StudyError
from scleraforce.records.eye import Eye
from scleraforce.records.fields import (
    check_fields,
    field_form,
    field_key,
    in_files,
    quantity,
    required,
)
from scleraforce.records.globe import LAW_KEY
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

# what a file states of a globe whose law nobody has declared
USUAL_LAW = (LAW_KEY, RIGIDITY_LAWS[0])


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

    eye: Eye
    scan: Scan = field(metadata={"key": "oct"})
    needle: Needle
    force: ForceInfo | None = None

    def __post_init__(self) -> None:
        if self.needle.gap_m is None and not self.scan.planes:
            raise StudyError(
                "needle.slice_gap_m: missing; give it, or [[oct.plane]] for each of"
                " several planes"
            )
        if self.needle.gap_m is not None and self.scan.planes:
            raise StudyError(
                "needle.slice_gap_m: of a single plane, and there are [[oct.plane]]:"
                " leave it out"
            )

    @property
    def setup(self) -> Setup:
        """The experiment as the recording states it, which never states the modulus: a
        calibration may add it.
        """
        return Setup(eye=self.eye, needle=self.needle, scan=self.scan)

    @property
    def eye_name(self) -> str:
        """The name of the eye, which every recording states."""
        assert self.eye.name is not None
        return self.eye.name

    @property
    def stated_keys(self) -> dict[str, str]:
        """The keys of the file that say something of eye, needle and scan, each with
        its field; the law of a globe only if it is not the usual one.
        """
        found: dict[str, str] = {}
        sections: dict[str, Eye | Needle | Scan] = {
            "eye": self.eye,
            "needle": self.needle,
            "oct": self.scan,
        }
        for section, record in sections.items():
            for item in fields(record):
                value = getattr(record, item.name)
                if value is None or value == () or not in_files(item):
                    continue

                form = field_form(item)
                entries = form.write(value) if form else {field_key(item): value}
                found |= {
                    f"{section}.{key}": item.name
                    for key, entry in entries.items()
                    if entry is not None and (key, entry) != USUAL_LAW
                }

        return found
