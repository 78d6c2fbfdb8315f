"""Remarks: what a user should know of an import, a calibration or an answer, as data.

A remark has a code, which programs compare, and a sentence, which people read. The
severity belongs to the code. docs/remarks.md lists all codes.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal

Severity = Literal["info", "caution", "doubt"]

# info: says what was done. caution: the result is less sure, or limited. doubt: the
# evidence contradicts itself or what was declared, so the result may be wrong.
SEVERITY_OF: Mapping[str, Severity] = MappingProxyType(
    {
        # answers
        "methods-disagree": "doubt",
        "fit-unchecked": "caution",
        "plane-left-out": "caution",
        "lean-contradicted": "doubt",
        "lean-not-calibrated": "caution",
        "no-history": "caution",
        "pixels-scaled": "info",
        # the eye that is read, and the model that reads it
        "outside-training": "caution",
        "other-reader": "info",
        "inputs-ignored": "caution",
        "population-modulus": "caution",
        "other-eye": "doubt",
        "lean-unknown": "caution",
    }
)


@dataclass(frozen=True)
class Remark:
    """A sentence on an import, a calibration or an answer, with its code.

    Attributes:
        code: one of `SEVERITY_OF`.
        words: the sentence; fields of records are in backticks.
        fields: names of the fields of records that it is about, like "iop_pa".
        about: the file, recording, eye or plane that it is about; "": the whole.

    Raises:
        ValueError: an unknown code, which is a fault of the program.

    >>> import scleraforce as sf
    >>> remark = sf.Remark("outside-training", "IOP 40 mmHg", ("iop_pa",), "eye-a")
    >>> remark.severity, str(remark)
    ('caution', 'eye-a: IOP 40 mmHg')
    """

    code: str
    words: str
    fields: tuple[str, ...] = ()
    about: str = ""

    def __post_init__(self) -> None:
        if self.code not in SEVERITY_OF:
            raise ValueError(f"code: {self.code!r} is not one of records.remark")

    def __str__(self) -> str:
        return f"{self.about}: {self.words}" if self.about else self.words

    @property
    def severity(self) -> Severity:
        """How serious it is: "info", "caution" or "doubt"."""
        return SEVERITY_OF[self.code]

    def on(self, about: object) -> "Remark":
        """Return the remark with the file, recording or eye that it is about, unless it
        names one already.
        """
        return self if self.about else replace(self, about=str(about))

    def to_dict(self) -> dict[str, Any]:
        """Return the keys of a remark in JSON."""
        return {
            "code": self.code,
            "severity": self.severity,
            "words": self.words,
            "fields": list(self.fields),
            "about": self.about,
        }


def sentences(remarks: Iterable[Remark]) -> tuple[str, ...]:
    """Return the sentence of each remark, in their order, each once."""
    return tuple(dict.fromkeys(map(str, remarks)))
