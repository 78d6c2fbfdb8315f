"""The file of `calibrate`: typed records, read, checked and written (without SciPy);
what it tells of an experiment's eye.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, sqrt
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from scleraforce.base.errors import CalibrationError, StudyError
from scleraforce.base.plain_json import parse_json
from scleraforce.base.units import HumanUnit, from_si
from scleraforce.base.whole_files import KINDS, read_bytes, write_whole
from scleraforce.records.decoder import Source, decode_record
from scleraforce.records.eye import POPULATION_SD, Eye, ForceDiscrepancy, Modulus
from scleraforce.records.fields import (
    TableForm,
    Unit,
    allowed_bounds,
    computed,
    formed,
    name_fault,
    not_in_files,
    one_line,
    required,
)
from scleraforce.records.globe import OPEN, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import MOMENTS, Relaxation, matrix_rows

CALIBRATION_FORMAT = 3
MECHANICS = ("finite-strain", "linear")
STIFFEST_TISSUE = 200.0  # b
NAMED_EYES = 8  # in a sentence
WRITER = "give a file of `scleraforce calibrate`"
_MODULUS = allowed_bounds("youngs_modulus_mpa")
_THICKNESS = allowed_bounds("thickness_um")
_IOP = allowed_bounds("iop_mmhg")
_LEAN = allowed_bounds("lean_deg")

Record = TypeVar("Record")


@dataclass(frozen=True)
class CalibrationFile:
    """The content of a file of the format; `path` names it in messages, `sha256` is of
    its text, "" of a calibration that is in memory.
    """

    path: str
    content: Mapping[str, Any]
    sha256: str = ""


@dataclass(frozen=True)
class UsedFrame:
    """A frame that a calibration rests on: its name, and
    `records.frame.frame_digest` of its pixels.
    """

    file: str = one_line()
    sha256: str = one_line()


@dataclass(frozen=True, kw_only=True)
class Appearance:
    """What the frames of an eye show beside their dents: the wall's thickness, and the
    eye's size by its curvature (1: as in the study), each with its spread; the number
    of frames.
    """

    thickness_um: float = computed(_THICKNESS.low, _THICKNESS.high)
    thickness_sd_um: float = computed(0.0, 1e4)
    size: float = computed(0.1, 10.0)
    size_sd: float = computed(0.0, 10.0)
    frames: int = computed(1, inf)


def _in_file(
    low: float | None, high: float | None, unit: HumanUnit | None = None
) -> Unit:
    return Unit(unit, low=low, high=high, exact=True)


def _read_eye(stated: Mapping[str, Any]) -> Eye:
    globe = stated.get("globe", OPEN)
    if globe.can_be_sealed and not globe.sd > 0.0:
        raise StudyError(
            "globe.rigidity_mmhg13_per_ul: lowest above highest, or sd not above 0"
        )
    modulus = Modulus(
        mean_pa=stated["mean_mpa"],
        sd_pa=stated.get("effective_sd_mpa", stated["sd_mpa"]),
        source="shape" if stated.get("without_force") else "own",
    )
    return Eye(
        modulus=modulus,
        thickness_m=stated["thickness_um"],
        globe=globe,
        stiffening=stated.get("stiffening", 0.0),
        discrepancy=stated.get("discrepancy"),
        relaxation=stated.get("relaxation"),
        calibrated_lean_rad=stated.get("lean_deg"),
        iop_pa=stated.get("assumed_iop_mmhg"),
        iop_assumed=None if stated.get("assumed_iop_mmhg") is None else True,
    )


def _no_writing(_: Eye) -> Mapping[str, Any]:
    raise NotImplementedError("`Calibration.to_dict` writes the eyes of a file")


# An eye in a calibration file: what its frames have shown, in one table.
_EYE_FORM = TableForm(
    {
        "mean_mpa": (float, _in_file(_MODULUS.low, _MODULUS.high, "mpa")),
        "sd_mpa": (float, _in_file(0.0, _MODULUS.high, "mpa")),
        "effective_sd_mpa": (float, _in_file(0.0, _MODULUS.high, "mpa")),
        "thickness_um": (float, _in_file(_THICKNESS.low, _THICKNESS.high, "um")),
        "globe": (Globe, Unit()),
        "discrepancy": (ForceDiscrepancy | None, Unit()),
        "stiffening": (float, _in_file(0.0, STIFFEST_TISSUE)),
        "relaxation": (Relaxation | None, Unit()),
        "lean_deg": (float | None, _in_file(0.0, _LEAN.high, "deg")),
        "without_force": (bool, Unit()),
        "assumed_iop_mmhg": (float | None, _in_file(0.0, _IOP.high, "mmhg")),
    },
    _read_eye,
    _no_writing,
    needed=("mean_mpa", "sd_mpa", "thickness_um"),
)


@dataclass(frozen=True, kw_only=True)
class CalibratedEye:
    """One eye of a calibration, and the frames that it rests on.

    `eye` has the modulus, with its posterior's mean and the standard deviation with
    which forces are read ("own", or "shape" where it is from the shape of the dents
    alone), the wall's thickness as calibrated, estimated along with E if asked for, the
    globe after the frames (open in early files), and the discrepancy, stiffening and
    relaxation of its tissue (None and 0 with linear mechanics and in early files). Its
    `calibrated_lean_rad` is that of the needle, where the forces were those along the
    wall's normal. `status` is "ok", or says that the calibration diverged: the standard
    deviation then means nothing.
    `appearance`: what its frames show, None in early files.
    """

    eye: Eye = formed(_EYE_FORM)
    frames: tuple[UsedFrame, ...]
    status: str = one_line("ok")
    appearance: Appearance | None = None

    @property
    def usable(self) -> bool:
        """True if the eye may be read with this modulus."""
        return self.status == "ok"


@dataclass(frozen=True, kw_only=True)
class CalibrationSummary:
    """Eyes by id, the population, and the source.

    `population_sd_pa` is the spread of the eyes' means, None for one eye.
    `population_stiffening` is b of their tissue: 1 + b is the geometric mean.
    `mechanics`: of the fit; an E of the linear wall does not fit the other at high
    forces.
    """

    eyes: Mapping[str, CalibratedEye]
    population_mean_pa: float = computed(
        _MODULUS.low, _MODULUS.high, "mpa", key="population.mean_mpa"
    )
    population_sd_pa: float | None = computed(
        0.0, _MODULUS.high, "mpa", key="population.sd_mpa"
    )
    population_stiffening: float = computed(
        0.0, STIFFEST_TISSUE, default=0.0, key="population.stiffening"
    )
    mechanics: str = required(*MECHANICS)
    path: str = not_in_files("")
    sha256: str = not_in_files("")

    def __post_init__(self) -> None:
        for eye in self.eyes:
            if fault := name_fault(eye):
                raise StudyError(f"eyes: {fault}")

    @property
    def digests(self) -> frozenset[str]:
        """The digests of the frames that were used, whatever their files are called
        (`UsedFrame.sha256`).
        """
        return frozenset(
            frame.sha256 for eye in self.eyes.values() for frame in eye.frames
        )


def read_calibration(path: str | PathLike[str]) -> CalibrationSummary:
    """Read the moduli from the file that `scleraforce calibrate` writes; raises
    `CalibrationError`.
    """
    return summary_of(open_calibration(path))


def open_calibration(path: str | PathLike[str]) -> CalibrationFile:
    """Read a calibration file for `summary_of` or
    `calibration.calibration.parse_calibration`; raises `CalibrationError`.
    """
    return parse_calibration_file(
        read_bytes(Path(path), KINDS["calibration"]), str(path)
    )


def write_calibration(content: Mapping[str, Any], path: Path) -> None:
    """Write what `Calibration.to_dict` returns, whole or not at all; raises
    `InputError`.
    """
    write_whole(json.dumps(content, indent=1, allow_nan=False) + "\n", path)


def decode_file(file: CalibrationFile, kind: type[Record]) -> Record:
    """Return the parts of a file that a record has; raises `CalibrationError`."""
    try:
        return decode_record(kind, file.content, Source(file.path))
    except StudyError as fault:
        raise CalibrationError(f"{fault}; {WRITER}") from fault


def summary_of(file: CalibrationFile) -> CalibrationSummary:
    """Return the part of a file that others than `calibration` need; raises
    `CalibrationError`.
    """
    summary = decode_file(file, CalibrationSummary)
    return replace(summary, path=file.path, sha256=file.sha256)


def parse_calibration_file(text: bytes, name: str) -> CalibrationFile:
    """Return a calibration file of this text; `name` stands for its path; raises
    `CalibrationError`.
    """
    try:
        content = parse_json(text)
    except ValueError as fault:
        raise CalibrationError(f"{name}: {fault}") from fault

    if not isinstance(content, dict) or content.get("format") != CALIBRATION_FORMAT:
        found = (
            f"found {content.get('format')!r:.40}"
            if isinstance(content, dict)
            else "found no object"
        )
        wanted = f"expected a JSON object with format {CALIBRATION_FORMAT}"
        raise CalibrationError(
            f"{name}: format: {wanted}, {found}; {WRITER} of this version"
        )

    return CalibrationFile(name, content, hashlib.sha256(text).hexdigest())


def globe_entry(globe: Globe) -> dict[str, Any]:
    """Return the entry of a globe in the file, with the band that holds its rigidity
    with 90 %.
    """
    low, high = (from_si(end, "mmhg13_per_ul") for end in globe.band)
    # the band is computed anew from what a file has: its last digits would move
    band = {"low": float(f"{low:.9g}"), "high": float(f"{high:.9g}")}
    moments = {
        name: from_si(getattr(globe, name), "mmhg13_per_ul")
        for name in ("mean", "sd", "lowest", "highest")
    }
    return {
        "kind": globe.kind,
        "rigidity_law": globe.law,
        "rigidity_mmhg13_per_ul": band | moments,
        "correlation": globe.correlation,
        "calibrated": globe.calibrated,
        "rigidity_told": globe.rigidity_told,
    }


def known_of_eye(setup: Setup, summary: CalibrationSummary, eye: str) -> Setup:
    """Return an experiment whose eye is completed by a calibration.

    A modulus comes with the stiffening of its tissue; one of the eye's own also with
    the wall's thickness of the calibration, and with its globe, unless a kind was
    declared then and another one now. If the calibration diverged, the modulus is
    unknown, and the globe too where the frames contradict its declaration: it is
    unknown in the file then.
    """
    own = summary.eyes.get(eye)
    if own is None:
        found = _as_of_population(setup.eye, summary)
    elif own.usable:
        found = _as_calibrated(setup.eye, own.eye)
    else:
        globe = None if _is_contradicted(own.eye) else setup.eye.globe
        found = replace(setup.eye, modulus=None, globe=globe)

    return replace(setup, eye=found)


def _is_contradicted(own: Eye) -> bool:
    """Return whether the frames contradict what was declared of the globe."""
    return own.globe is not None and own.globe.kind == "unknown"


def _as_calibrated(declared: Eye, own: Eye) -> Eye:
    """Return an eye with what its own frames have shown; a leak stays as declared."""
    globe = own.globe
    if globe is not None:
        stated = declared.globe
        if stated is None or globe.kind in (stated.kind, "unknown"):
            globe = replace(globe, leak_time_s=declared.leak_time_s)
        else:
            globe = stated

    same_wall = own.thickness_m == declared.thickness_m
    if declared.iop_pa is None and own.iop_assumed:
        # the modulus was found at that pressure, and makes up for its error
        declared = replace(declared, iop_pa=own.iop_pa, iop_assumed=True)

    return replace(
        declared,
        modulus=own.modulus,
        globe=globe,
        thickness_m=own.thickness_m,
        thickness_sd_m=declared.thickness_sd_m if same_wall else None,
        calibrated_lean_rad=own.calibrated_lean_rad,
        stiffening=own.stiffening,
        discrepancy=own.discrepancy,
        relaxation=own.relaxation or declared.relaxation,
    )


def _as_of_population(declared: Eye, summary: CalibrationSummary) -> Eye:
    """Return an eye that a calibration does not have, with the population's modulus and
    tissue.
    """
    usable = [one.eye for one in summary.eyes.values() if one.usable]
    leans = [eye.calibrated_lean_rad for eye in usable]
    stated = [lean for lean in leans if lean is not None]
    leans_known = 0 < len(stated) == len(leans)
    return replace(
        declared,
        modulus=population_modulus(summary),
        stiffening=summary.population_stiffening,
        relaxation=declared.relaxation or population_relaxation(summary),
        calibrated_lean_rad=sum(stated) / len(stated) if leans_known else None,
    )


def population_relaxation(summary: CalibrationSummary) -> Relaxation | None:
    """Return how the eyes of a calibration relax, with their spread; None if that is
    not known of all in one way.
    """
    found = [one.eye.relaxation for one in summary.eyes.values() if one.usable]
    eyes = [one for one in found if one is not None]
    if not eyes or len(eyes) < len(found) or len({one.times_s for one in eyes}) > 1:
        return None

    joined: dict[str, Any] = {"source": "population", "times_s": eyes[0].times_s}
    for mean, covariance in MOMENTS.items():
        means = np.array([getattr(one, mean) for one in eyes])
        within = np.mean([getattr(one, covariance) for one in eyes], axis=0)
        between = np.cov(means.T) if len(eyes) > 1 else within
        joined |= {
            mean: tuple(means.mean(axis=0).tolist()),
            covariance: matrix_rows(within + between),
        }

    if any(one.other for one in eyes):
        others = [one.other or one.shares for one in eyes]
        joined["other"] = tuple(np.mean(others, axis=0).tolist())

    for name in ("every_s", "held_s"):
        found_s = [getattr(one, name) for one in eyes]
        joined[name] = None if None in found_s else float(np.median(found_s))

    return Relaxation(**joined)


def calibrated_modulus(summary: CalibrationSummary, eye: str) -> Modulus | None:
    """Return an eye's own modulus if a calibration found it, else the population's with
    the spread of eyes.

    None for an eye whose calibration diverged, as the model does not describe it, and
    if that holds for all eyes. The spread is at least the paper's. A single eye says
    nothing of it, and may itself lie off the mean by as much: another eye then differs
    from it by the spread of two eyes.
    """
    own = summary.eyes.get(eye)
    if own is None:
        return population_modulus(summary)
    return own.eye.modulus if own.usable else None


def population_modulus(summary: CalibrationSummary) -> Modulus | None:
    """Return the modulus of an eye that a calibration does not have
    (`calibrated_modulus`).
    """
    if not any(eye.usable for eye in summary.eyes.values()):
        return None

    mean_pa = summary.population_mean_pa
    if summary.population_sd_pa is None:
        return Modulus(
            mean_pa=mean_pa,
            sd_pa=sqrt(2.0) * POPULATION_SD * mean_pa,
            source="population",
        )

    return Modulus(
        mean_pa=mean_pa,
        sd_pa=max(summary.population_sd_pa, POPULATION_SD * mean_pa),
        source="population",
    )


def choice_of_eye(summary: CalibrationSummary) -> str:
    """Return what to give where nothing names the eye that is read."""
    count = len(summary.eyes)
    has = (
        f"has 1 eye: give {_names(summary)}"
        if count == 1
        else (f"has {count} eyes: give one of {_names(summary)}")
    )
    return f"{summary.path} {has}; any other gets the population's modulus"


def _names(summary: CalibrationSummary) -> str:
    more = ", ..." if len(summary.eyes) > NAMED_EYES else ""
    return ", ".join(list(summary.eyes)[:NAMED_EYES]) + more


def foreign_modulus(summary: CalibrationSummary, eye: str) -> str | None:
    """Return a sentence if an eye is read without a modulus of its own, with the file's
    eyes; None if it has one.
    """
    own = summary.eyes.get(eye)
    if own is not None and own.usable:
        return None

    there = "is not in" if own is None else f"is not usable ({own.status}) in"
    modulus = calibrated_modulus(summary, eye)
    count = "1 eye" if len(summary.eyes) == 1 else f"{len(summary.eyes)} eyes"

    if modulus is None:
        read = "as one of unknown modulus" + (
            " in an unknown globe" if own and _is_contradicted(own.eye) else ""
        )
    else:
        sd = f"{from_si(modulus.relative_sd, 'percent'):.0f} %"
        read = (
            f"with the population's modulus, {from_si(modulus.mean_pa, 'mpa'):.3g} MPa"
            f" +- {sd}"
        )

    file = f"{summary.path}, which has {count} ({_names(summary)})"
    return f"{eye} {there} {file}: read {read}"


# standard deviations and shares by which two recordings of an eye may differ
SAME_SD = 4.0
SAME_THICKNESS = 0.06
SAME_SIZE = 0.06


def other_eye(calibrated: Appearance, shown: Appearance) -> str | None:
    """Return why two recordings cannot show one eye; None: they may."""
    pairs = (
        (
            "a wall of {1:.0f} µm is seen, not of {0:.0f} µm",
            (calibrated.thickness_um, calibrated.thickness_sd_um),
            (shown.thickness_um, shown.thickness_sd_um),
            SAME_THICKNESS,
        ),
        (
            "its curvature is that of an eye {1:.2f} times as large as usual, not"
            " {0:.2f} times",
            (calibrated.size, calibrated.size_sd),
            (shown.size, shown.size_sd),
            SAME_SIZE,
        ),
    )
    for words, (before, before_sd), (now, now_sd), share in pairs:
        slack = max(share * before, SAME_SD * float(np.hypot(before_sd, now_sd)))
        if abs(now - before) > slack:
            return words.format(before, now)

    return None


def appearance_of(
    thickness_m: Sequence[float], sizes: Sequence[float]
) -> Appearance | None:
    """Return what frames show, by the thickness and the size that each shows; None if
    they show none.
    """
    seen_m = np.array([m for m in thickness_m if np.isfinite(m)])
    shown = np.array([size for size in sizes if np.isfinite(size)])
    if not len(seen_m) or not len(shown):
        return None

    return Appearance(
        thickness_um=float(from_si(float(np.median(seen_m)), "um")),
        thickness_sd_um=float(from_si(float(seen_m.std()), "um")),
        size=float(np.median(shown)),
        size_sd=float(shown.std()),
        frames=len(shown),
    )


def appearance_doubt(
    summary: CalibrationSummary, eye: str, shown: Appearance | None
) -> str | None:
    """Return a sentence if frames cannot be of the eye that bears their name in a
    calibration; None: they may be.
    """
    own = summary.eyes.get(eye)
    if own is None or own.appearance is None or shown is None:
        return None

    why = other_eye(own.appearance, shown)
    if why is None:
        return None
    return (
        f"{summary.path}: eyes.{eye}: {why} as in its calibration; is that of another"
        " eye, or was the scanner's scale another one?"
    )
