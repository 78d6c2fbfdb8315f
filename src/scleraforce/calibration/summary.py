"""What others need of the file that `calibrate` writes: each eye's modulus, the population's, and their provenance.

The one place that opens and checks that JSON; NumPy and SciPy stay out of it, for the reader's runtime uses it too.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any

from scleraforce.errors import CalibrationError
from scleraforce.whole_files import KINDS, read_bytes

__all__ = ["FORMAT", "MECHANICS", "CalibrationSummary", "EyeSummary", "parse_content", "read_calibration"]

FORMAT = 2
MECHANICS = ("finite-strain", "linear")
SOFTEST_MPA, STIFFEST_MPA = 0.001, 100.0
WRITER = "give a file of `scleraforce calibrate`"


@dataclass(frozen=True)
class EyeSummary:
    """Young's modulus of one eye: posterior mean and standard deviation, and the names of the frames it rests on.

    `thickness_m` is the wall's as the eye was calibrated with it, estimated along with E where that was asked for.
    `status` is "ok", or says that the filter diverged: the standard deviation then means nothing.
    """

    mean_pa: float
    sd_pa: float
    frames: tuple[str, ...]
    thickness_m: float
    status: str = "ok"

    @property
    def usable(self) -> bool:
        """Whether the eye may be read with this modulus."""
        return self.status == "ok"


@dataclass(frozen=True)
class CalibrationSummary:
    """Eyes by id, the population (`population_sd_pa`: spread of the eyes' means, 0 for one eye), and where it is from.

    `mechanics` is what the moduli were fitted with; an E of the linear wall does not fit the other at high forces.
    """

    eyes: Mapping[str, EyeSummary]
    population_mean_pa: float
    population_sd_pa: float
    mechanics: str
    path: str
    sha256: str

    @property
    def frames(self) -> frozenset[tuple[str, str]]:
        """The frames that were used, as (eye, file name)."""
        return frozenset((eye, file) for eye, entry in self.eyes.items() for file in entry.frames)


def read_calibration(path: str | PathLike[str]) -> CalibrationSummary:
    """Read the moduli from the file that `scleraforce calibrate` writes.

    Raises:
        CalibrationError: the file is missing, is not JSON, or lacks something; names the file and the key.
    """
    text = read_bytes(Path(path), KINDS["calibration"])
    content = parse_content(text, str(path))
    population = _table(content, "population", f"{path}: population")
    eyes = _table(content, "eyes", f"{path}: eyes")
    return CalibrationSummary(
        {eye: _eye(entry, f"{path}: eyes.{eye}") for eye, entry in eyes.items()},
        _modulus_pa(population, "mean_mpa", f"{path}: population"),
        1e6 * _number(population, "sd_mpa", f"{path}: population", 0.0, STIFFEST_MPA, "MPa"),
        content["mechanics"],
        str(path),
        hashlib.sha256(text).hexdigest(),
    )


def parse_content(text: bytes | str, name: str) -> dict[str, Any]:
    """Return the JSON object of a calibration file whose format and mechanics are known; `name` stands in messages.

    Raises:
        CalibrationError: it is not JSON, or no file of `calibrate`.
    """
    try:
        content = json.loads(text)
    except ValueError as fault:
        raise CalibrationError(f"{name}: not JSON: {fault}") from fault
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CalibrationError(f"{name}: format: expected a JSON object with format {FORMAT}; {WRITER}")
    if content.get("mechanics") not in MECHANICS:
        found = content.get("mechanics")
        raise CalibrationError(f"{name}: mechanics: expected {' or '.join(MECHANICS)}, found {found!r}; {WRITER}")
    return content


def _eye(entry: Any, place: str) -> EyeSummary:
    if not isinstance(entry, dict):
        raise CalibrationError(f"{place}: expected an object; {WRITER}")
    files = entry.get("frames")
    if not isinstance(files, list) or not all(isinstance(file, str) for file in files):
        raise CalibrationError(f"{place}.frames: expected the names of the frames that were used")
    status = entry.get("status")
    if not isinstance(status, str):
        raise CalibrationError(f"{place}.status: expected a text, found {status!r}; {WRITER}")
    return EyeSummary(
        _modulus_pa(entry, "mean_mpa", place),
        1e6 * _number(entry, "sd_mpa", place, 0.0, STIFFEST_MPA, "MPa"),
        tuple(files),
        1e-6 * _number(entry, "thickness_um", place, 1.0, 10e3, "um"),
        status,
    )


def _table(content: dict[str, Any], key: str, place: str) -> dict[str, Any]:
    table = content.get(key)
    if not isinstance(table, dict):
        raise CalibrationError(f"{place}: missing; {WRITER}")
    return table


def _modulus_pa(entry: dict[str, Any], key: str, place: str) -> float:
    return 1e6 * _number(entry, key, place, SOFTEST_MPA, STIFFEST_MPA, "MPa")


def _number(entry: dict[str, Any], key: str, place: str, low: float, high: float, unit: str) -> float:
    if key not in entry:
        raise CalibrationError(f"{place}.{key} is missing; {WRITER}")
    value = entry[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(f"{place}.{key}: expected a number, found {value!r}")
    if not isfinite(value) or not low <= value <= high:
        raise CalibrationError(f"{place}.{key}: {value:g} is not between {low:g} and {high:g} {unit}")
    return float(value)
