"""The file that `calibrate` writes: opened, checked and written here, and what others than `calibration` need of it.

That is each eye's modulus, the population's, and their provenance. The filter's state in it is read by
`calibration.result`. SciPy stays out of this module, for the reader's runtime uses it too.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt
from os import PathLike
from pathlib import Path
from typing import Any, Final

from scleraforce.errors import CalibrationError
from scleraforce.known.eye import MOST_CORRELATED, OPEN, POPULATION_SD, ForceDiscrepancy, Known, KnownGlobe, Modulus
from scleraforce.plain_json import parse_json
from scleraforce.recording.folder import eye_id_fault
from scleraforce.study.eye import RIGIDITY_LAWS
from scleraforce.study.fields import Unit, allowed, meant
from scleraforce.units import from_si, to_si
from scleraforce.whole_files import KINDS, read_bytes, write_whole

CALIBRATION_FORMAT = 3
MECHANICS = ("finite-strain", "linear")
_MODULUS, _THICKNESS = allowed("youngs_modulus_mpa"), allowed("thickness_um")
SOFTEST_MPA, STIFFEST_MPA = _MODULUS.low or 0.0, _MODULUS.high or 0.0
THINNEST_UM, THICKEST_UM = _THICKNESS.low or 0.0, _THICKNESS.high or 0.0
RIGIDITY_UNIT: Final = "mmhg13_per_ul"
STIFFEST_RIGIDITY = 2.0  # mmHg^(1/3) per ul
KINDS_OF_GLOBE = ("open", "sealed", "unknown")
STIFFENS_MOST = 200.0
LARGEST_DISCREPANCY = 2.0  # of a force's logarithm
LARGEST_SCATTER = 100.0
NAMED_EYES = 8  # in a sentence
LARGEST_N = 3.0  # of a force that a frame was calibrated on
WRITER = "give a file of `scleraforce calibrate`"


@dataclass(frozen=True)
class CalibrationFile:
    """A file whose format, mechanics and ids of eyes were checked; `path` names it, `sha256` is of its text."""

    path: str
    content: Mapping[str, Any]
    sha256: str


@dataclass(frozen=True)
class UsedFrame:
    """A frame that a calibration rests on: its name, and `recording.folder.frame_digest` of its pixels."""

    file: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class EyeSummary:
    """Young's modulus of one eye: posterior mean and standard deviation, and the frames that it rests on.

    `thickness_m` is the wall's as the eye was calibrated with it, estimated along with E where that was asked for.
    `globe` is what is known of it after the frames; files without it come from when every globe was taken for open.
    `discrepancy` is how far its forces lie off the library's; None with linear mechanics and in earlier files.
    `stiffening` is b of its tissue (`mechanics.stiffening`), 0 with linear mechanics and in earlier files.
    `status` is "ok", or says that the filter diverged: the standard deviation then means nothing.
    """

    mean_pa: float
    sd_pa: float
    frames: tuple[UsedFrame, ...]
    thickness_m: float
    globe: KnownGlobe = OPEN
    discrepancy: ForceDiscrepancy | None = None
    stiffening: float = 0.0
    status: str = "ok"

    @property
    def usable(self) -> bool:
        """Whether the eye may be read with this modulus."""
        return self.status == "ok"


@dataclass(frozen=True, kw_only=True)
class CalibrationSummary:
    """Eyes by id, the population, and where it is from.

    `population_sd_pa` is the spread of the eyes' means, None for one eye: it says nothing of how eyes differ.
    `population_stiffening` is b of their tissue: 1 + b is the geometric mean. `mechanics` is what the moduli were
    fitted with; an E of the linear wall does not fit the other at high forces.
    """

    eyes: Mapping[str, EyeSummary]
    population_mean_pa: float
    population_sd_pa: float | None
    population_stiffening: float
    mechanics: str
    path: str
    sha256: str

    @property
    def digests(self) -> frozenset[str]:
        """What the frames that were used are known by, whatever their files are called (`UsedFrame.sha256`)."""
        return frozenset(frame.sha256 for eye in self.eyes.values() for frame in eye.frames)


def read_calibration(path: str | PathLike[str]) -> CalibrationSummary:
    """Read the moduli from the file that `scleraforce calibrate` writes.

    Raises:
        CalibrationError: the file is missing, is not JSON, or lacks something; names the file and the key.
    """
    return summary_of(open_calibration(path))


def open_calibration(path: str | PathLike[str]) -> CalibrationFile:
    """Read a calibration file as it stands, for `summary_of` or `calibration.result.parse_calibration`.

    Raises:
        CalibrationError: the file cannot be read, or `calibrate` has not written it.
    """
    return parse_calibration_file(read_bytes(Path(path), KINDS["calibration"]), str(path))


def write_calibration(content: Mapping[str, Any], path: Path) -> None:
    """Write what `calibration.result.calibration_as_json` returns, whole or not at all.

    Raises:
        InputError: its folder cannot be written to.
    """
    write_whole(json.dumps(content, indent=1, allow_nan=False) + "\n", path)


def summary_of(file: CalibrationFile) -> CalibrationSummary:
    """Return what others than `calibration` need of a file.

    Raises:
        CalibrationError: it lacks something; names the key.
    """
    name, content = file.path, file.content
    population, place = table_of(content, "population", name), f"{name}: population"
    return CalibrationSummary(
        eyes={eye: summary_of_eye(entry, f"{name}: eyes.{eye}") for eye, entry in content["eyes"].items()},
        population_mean_pa=to_si(number_of(population, "mean_mpa", place, SOFTEST_MPA, STIFFEST_MPA, "MPa"), "mpa"),
        population_sd_pa=_spread_pa(population, place),
        population_stiffening=_stiffening(population, place),
        mechanics=content["mechanics"],
        path=name,
        sha256=file.sha256,
    )


def _spread_pa(population: Mapping[str, Any], place: str) -> float | None:
    if "sd_mpa" in population and population["sd_mpa"] is None:
        return None
    return to_si(number_of(population, "sd_mpa", place, 0.0, STIFFEST_MPA, "MPa"), "mpa")


def parse_calibration_file(text: bytes, name: str) -> CalibrationFile:
    """Return a calibration file of this text; `name` stands for its path.

    Raises:
        CalibrationError: it is not JSON, or no file of `calibrate`.
    """
    try:
        content = parse_json(text)
    except ValueError as fault:
        raise CalibrationError(f"{name}: {fault}") from fault
    if not isinstance(content, dict) or content.get("format") != CALIBRATION_FORMAT:
        found = f"found {content.get('format')!r:.40}" if isinstance(content, dict) else "found no object"
        raise CalibrationError(
            f"{name}: format: expected a JSON object with format {CALIBRATION_FORMAT}, {found}; "
            f"{WRITER} of this version"
        )
    if content.get("mechanics") not in MECHANICS:
        found = f"{content.get('mechanics')!r:.40}"
        raise CalibrationError(f"{name}: mechanics: expected {' or '.join(MECHANICS)}, found {found}; {WRITER}")
    for eye in table_of(content, "eyes", name):
        wrong = eye_id_fault(eye)
        if wrong:
            raise CalibrationError(f"{name}: eyes: {wrong}")
    return CalibrationFile(name, content, hashlib.sha256(text).hexdigest())


def summary_of_eye(entry: Any, place: str) -> EyeSummary:
    """Return one entry of `eyes`; `place` stands in messages.

    Raises:
        CalibrationError: naming the key.
    """
    if not isinstance(entry, dict):
        raise CalibrationError(f"{place}: expected an object; {WRITER}")
    frames = entry.get("frames")
    if not isinstance(frames, list):
        raise CalibrationError(f"{place}.frames: expected a list of the frames that were used; {WRITER}")
    return EyeSummary(
        mean_pa=to_si(number_of(entry, "mean_mpa", place, SOFTEST_MPA, STIFFEST_MPA, "MPa"), "mpa"),
        sd_pa=to_si(number_of(entry, "sd_mpa", place, 0.0, STIFFEST_MPA, "MPa"), "mpa"),
        frames=tuple(_frame(frame, f"{place}.frames[{index}]") for index, frame in enumerate(frames)),
        thickness_m=to_si(number_of(entry, "thickness_um", place, THINNEST_UM, THICKEST_UM, "µm"), "um"),
        globe=OPEN if "globe" not in entry else _globe(table_of(entry, "globe", place), f"{place}.globe"),
        discrepancy=_discrepancy(entry, place),
        stiffening=_stiffening(entry, place),
        status=text_of(entry, "status", place),
    )


def _stiffening(entry: Mapping[str, Any], place: str) -> float:
    """Return b; 0 where it is missing, as it is in files of earlier versions."""
    return number_of(entry, "stiffening", place, 0.0, STIFFENS_MOST) if "stiffening" in entry else 0.0


def _discrepancy(entry: Mapping[str, Any], place: str) -> ForceDiscrepancy | None:
    if entry.get("discrepancy") is None:
        return None
    values, within = table_of(entry, "discrepancy", place), f"{place}.discrepancy"
    ends = dict.fromkeys(("level", "growth"), (-LARGEST_DISCREPANCY, LARGEST_DISCREPANCY))
    ends |= dict.fromkeys(("level_sd", "growth_sd"), (0.0, LARGEST_DISCREPANCY))
    ends["correlation"] = -MOST_CORRELATED, MOST_CORRELATED
    return ForceDiscrepancy(
        **{name: number_of(values, name, within, *bounds) for name, bounds in ends.items()},
        level_by=_pair(values, "level_by", within),
        growth_by=_pair(values, "growth_by", within),
        scatter=number_of(values, "scatter", within, 0.0, LARGEST_SCATTER) if "scatter" in values else 1.0,
        largest_n=_or_none(values, "largest_n", within, LARGEST_N),
        widest_gap=_or_none(values, "widest_gap", within, 1.0),
    )


def _or_none(values: Mapping[str, Any], key: str, place: str, high: float) -> float | None:
    """Return a number from 0 on; None where it is null, or missing, as it is in files of earlier versions."""
    return None if values.get(key) is None else number_of(values, key, place, 0.0, high)


def _pair(values: Mapping[str, Any], key: str, place: str) -> tuple[float, float]:
    """Return two numbers under a key; zeros where it is missing, as it is in files of earlier versions."""
    found = values.get(key, [0.0, 0.0])
    if not isinstance(found, list) or len(found) != 2:
        raise CalibrationError(f"{place}.{key}: expected two numbers; {WRITER}")
    low, high = -LARGEST_DISCREPANCY, LARGEST_DISCREPANCY
    first, second = (number_of({key: value}, key, place, low, high) for value in found)
    return first, second


def globe_entry(globe: KnownGlobe) -> dict[str, Any]:
    """Return a globe as it stands in the file, with the band that holds its rigidity with 90 %."""
    low, high = globe.band
    values = {
        "low": low,
        "high": high,
        "mean": globe.mean,
        "sd": globe.sd,
        "lowest": globe.lowest,
        "highest": globe.highest,
    }
    return {
        "kind": globe.kind,
        "rigidity_law": globe.law,
        "rigidity_mmhg13_per_ul": {name: from_si(value, RIGIDITY_UNIT) for name, value in values.items()},
        "correlation": globe.correlation,
        "calibrated": globe.calibrated,
        "rigidity_told": globe.rigidity_told,
    }


def _globe(entry: Mapping[str, Any], place: str) -> KnownGlobe:
    kind, law, calibrated, told = (entry.get(key) for key in ("kind", "rigidity_law", "calibrated", "rigidity_told"))
    if kind not in KINDS_OF_GLOBE or law not in RIGIDITY_LAWS or not {type(calibrated), type(told)} == {bool}:
        raise CalibrationError(
            f"{place}: kind, rigidity_law, calibrated or rigidity_told: not as `calibrate` writes them; {WRITER}"
        )
    rigidity, within = table_of(entry, "rigidity_mmhg13_per_ul", place), f"{place}.rigidity_mmhg13_per_ul"
    ends = {"lowest": 0.0, "highest": 0.0, "sd": 0.0, "mean": -STIFFEST_RIGIDITY}  # the least that each may be
    values = {
        name: to_si(number_of(rigidity, name, within, least, STIFFEST_RIGIDITY), RIGIDITY_UNIT)
        for name, least in ends.items()
    }
    if values["highest"] < values["lowest"] or (values["highest"] > 0.0 and not values["sd"] > 0.0):
        raise CalibrationError(f"{within}: lowest above highest, or sd not above 0; {WRITER}")
    correlation = number_of(entry, "correlation", place, -MOST_CORRELATED, MOST_CORRELATED)
    return KnownGlobe(
        kind=kind,
        lowest=values["lowest"],
        highest=values["highest"],
        mean=values["mean"],
        sd=values["sd"],
        law=law,
        correlation=correlation,
        calibrated=bool(calibrated),
        rigidity_told=bool(told),
    )


def _frame(entry: Any, place: str) -> UsedFrame:
    if not isinstance(entry, dict):
        raise CalibrationError(f"{place}: expected an object with file and sha256; {WRITER}")
    return UsedFrame(text_of(entry, "file", place), text_of(entry, "sha256", place))


def table_of(content: Mapping[str, Any], key: str, place: str) -> dict[str, Any]:
    """Return the object under a key; `place` stands in messages.

    Raises:
        CalibrationError: there is none.
    """
    table = content.get(key)
    if not isinstance(table, dict):
        raise CalibrationError(f"{place}: {key}: missing, or no object; {WRITER}")
    return table


def text_of(entry: Mapping[str, Any], key: str, place: str) -> str:
    """Return the text of one line under a key; `place` stands in messages.

    Raises:
        CalibrationError: there is none.
    """
    value = entry.get(key)
    if not isinstance(value, str) or not value.isprintable():
        raise CalibrationError(f"{place}.{key}: expected a text of one line, found {value!r:.40}; {WRITER}")
    return value


def number_of(entry: Mapping[str, Any], key: str, place: str, low: float, high: float, unit: str = "") -> float:
    """Return the number under a key; `place` stands in messages.

    Raises:
        CalibrationError: there is none, or it is not between the bounds.
    """
    if key not in entry:
        raise CalibrationError(f"{place}.{key} is missing; {WRITER}")
    value = entry[key]
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(f"{place}.{key}: expected a number, found {value!r:.40}")
    if not low <= value <= high:  # true of NaN as well
        between = f"{value:g} is not between {low:g} and {high:g} {unit}".rstrip()
        raise CalibrationError(f"{place}.{key}: {between}{meant(key, value, Unit(low=low, high=high))}")
    return float(value)


def known_of_eye(known: Known, summary: CalibrationSummary, eye: str) -> Known:
    """Return what is known of an eye once a calibration adds its modulus.

    A modulus goes with the stiffening of its tissue; one of the eye's own with the wall's thickness that it was
    calibrated with, and with what was found of its globe, unless a kind was told then and another one is told now. Of
    an eye whose calibration diverged nothing of its modulus is known, and nothing of the globe where its frames
    contradict what was told of that: the file's is unknown then.
    """
    modulus = calibrated_modulus(summary, eye)
    own = summary.eyes.get(eye)
    if own is not None and not own.usable:
        return replace(known, modulus=None, globe=None if own.globe.kind == "unknown" else known.globe)
    if own is None or modulus is None or modulus.source != "own":
        return replace(known, modulus=modulus, stiffening=summary.population_stiffening)
    globe = own.globe if known.globe is None or own.globe.kind in (known.globe.kind, "unknown") else known.globe
    return replace(
        known,
        modulus=modulus,
        thickness_m=own.thickness_m,
        globe=globe,
        stiffening=own.stiffening,
        discrepancy=own.discrepancy,
    )


def calibrated_modulus(summary: CalibrationSummary, eye: str) -> Modulus | None:
    """Return an eye's own modulus where a calibration found it, else its population's with the spread of eyes.

    None for an eye whose calibration diverged: it is not one of those that the model describes, so nothing is known of
    its modulus; likewise where that holds for all eyes. The spread is at least the paper's. A single eye says nothing
    of it, and may itself lie off the mean by as much: the eye that is read then differs from it by the spread of two
    eyes.
    """
    own = summary.eyes.get(eye)
    if own is not None and own.usable:
        return Modulus(mean_pa=own.mean_pa, sd_pa=own.sd_pa, source="own")
    if own is not None or not any(other.usable for other in summary.eyes.values()):
        return None
    mean_pa = summary.population_mean_pa
    if summary.population_sd_pa is None:
        return Modulus(mean_pa=mean_pa, sd_pa=sqrt(2.0) * POPULATION_SD * mean_pa, source="population")
    return Modulus(mean_pa=mean_pa, sd_pa=max(summary.population_sd_pa, POPULATION_SD * mean_pa), source="population")


def foreign_modulus(summary: CalibrationSummary, eye: str) -> str | None:
    """Return a sentence where an eye is read without a modulus of its own, None where it has one.

    It names the eye and the file's eyes, for the id may be mistyped.
    """
    own = summary.eyes.get(eye)
    if own is not None and own.usable:
        return None
    there = "is not in" if own is None else f"is not usable ({own.status}) in"
    names = ", ".join(list(summary.eyes)[:NAMED_EYES]) + (", ..." if len(summary.eyes) > NAMED_EYES else "")
    modulus = calibrated_modulus(summary, eye)
    count = "1 eye" if len(summary.eyes) == 1 else f"{len(summary.eyes)} eyes"
    read = (
        "as one of unknown modulus"
        + (" in a globe of which nothing is known" if own and own.globe.kind == "unknown" else "")
        if modulus is None
        else (
            f"with the population's modulus, {from_si(modulus.mean_pa, 'mpa'):.3g} MPa +- "
            f"{from_si(modulus.relative_sd, 'percent'):.0f} %"
        )
    )
    return f"{eye} {there} {summary.path}, which has {count} ({names}): read {read}"
