"""Remarks: what a user should know of an import, a calibration or an answer, as data.

A remark has a code, which programs compare, and a sentence, which people read. The
severity belongs to the code. docs/remarks.md lists all codes.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal

from scleraforce.base.errors import StudyError

Severity = Literal["info", "caution", "doubt"]

# info: says what was done. caution: the result is less sure, or limited. doubt: the
# evidence contradicts itself or what was declared, so the result may be wrong.
SEVERITY_OF: Mapping[str, Severity] = MappingProxyType(
    {
        # sources of a recording, and how they became one
        "picture-read": "info",
        "pixels-scaled": "info",
        "files-left-out": "info",
        "frames-ordered": "info",
        "moments-incomplete": "caution",
        "source-contradicted": "doubt",
        "thickness-contradicted": "doubt",
        "wall-not-seen": "doubt",
        "not-copied": "info",
        # force logs, and the labels of frames
        "log-mended": "info",
        "log-slow": "caution",
        "samples-without-force": "caution",
        "frames-without-label": "caution",
        "labels-unsure": "caution",
        "log-contradicted": "doubt",
        "clock-found": "info",
        "clock-contradicted": "doubt",
        "no-forces": "info",
        # walls that were drawn by hand
        "walls-corrected": "info",
        "wall-outdated": "caution",
        # what is not known
        "missing-input": "caution",
        # calibrations
        "points-left-out": "info",
        "parameter-found": "info",
        "thickness-beside-frames": "caution",
        "tissue-stiffens": "info",
        "relaxation-found": "info",
        "relaxation-unknown": "caution",
        "forces-beside-library": "info",
        "forces-scatter": "caution",
        "forces-not-reached": "caution",
        "bends-otherwise": "doubt",
        "filter-diverged": "doubt",
        "globe-contradicted": "doubt",
        "leak-not-followed": "caution",
        "modulus-from-shape": "caution",
        "modulus-from-prior": "caution",
        # answers
        "methods-disagree": "doubt",
        "fit-unchecked": "caution",
        "surface-alone": "caution",
        "plane-left-out": "caution",
        "lean-contradicted": "doubt",
        "lean-not-calibrated": "caution",
        "no-history": "caution",
        "pierced": "doubt",
        "frames-after-puncture": "info",
        # the eye that is read, and the model that reads it
        "outside-training": "caution",
        "other-reader": "info",
        "inputs-ignored": "caution",
        "population-modulus": "caution",
        "other-eye": "doubt",
        "lean-unknown": "caution",
        # sentences of files that earlier versions wrote
        "earlier-version": "caution",
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
        StudyError: an unknown code: a damaged file, or one of a later version.

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
            raise StudyError(
                f"code: {self.code!r:.40} is no code of a remark; docs/remarks.md lists"
                " them"
            )

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


def numbered(remarks: Iterable[Remark]) -> dict[str, str]:
    """Return the sentence of each remark by its severity and number, each once.

    >>> numbered([Remark("no-forces", "it has no forces.csv")])
    {'info 1': 'it has no forces.csv'}
    """
    each = {str(remark): remark.severity for remark in remarks}
    return {
        f"{severity} {number}": words
        for number, (words, severity) in enumerate(each.items(), start=1)
    }


def sentences(remarks: Iterable[Remark]) -> tuple[str, ...]:
    """Return the sentence of each remark, in their order, each once."""
    return tuple(dict.fromkeys(map(str, remarks)))
