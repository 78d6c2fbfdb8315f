"""The result of a calibration: of each frame, each eye and the population; in words,
and as its file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import exp, floor, hypot, isfinite, log10, sqrt
from typing import Any

import numpy as np

from scleraforce.base.errors import CalibrationError
from scleraforce.base.notebook_cards import data_frame, html_card
from scleraforce.base.plain_text import wrapped
from scleraforce.base.units import HumanUnit, from_si, to_si
from scleraforce.base.version import __version__
from scleraforce.calibration.filter.eye_filter import (
    PARAMETERS,
    EyeFilter,
    EyeState,
    FrameStep,
)
from scleraforce.calibration.stiffness_from_forces import (
    KnownForce,
    finite,
    not_negative,
)
from scleraforce.fit.frames_of_an_eye import DeclaredErrors
from scleraforce.fit.prior_of_an_eye import FORCE_BY_LOG_THICKNESS
from scleraforce.records import calibration_file
from scleraforce.records.calibration_file import (
    WRITER,
    Appearance,
    CalibratedEye,
    CalibrationFile,
    decode_file,
)
from scleraforce.records.eye import (
    NO_DISCREPANCY,
    REFERENCE_N,
    ForceDiscrepancy,
    Modulus,
)
from scleraforce.records.fields import declared, one_line
from scleraforce.records.globe import Globe
from scleraforce.records.remark import Remark, numbered, sentences
from scleraforce.records.tissue_relaxation import Relaxation


@dataclass(frozen=True, kw_only=True)
class FrameRecord:
    """The result of a frame: estimate of E after it, or the reason why it was not used.

    `sha256` is the digest of the frame's pixels (`records.frame.frame_digest`),
    which identifies it under any name. `planes`: files and digests of the frames of all
    planes of its moment, if there are several. `force_n` is the label without offset
    and drift, 0 if none was used. `own_modulus_pa`: the modulus from the frame alone;
    `again`: the frame read again in the end.
    """

    recording: str
    file: str = one_line()
    sha256: str = one_line()
    force_n: float = finite()
    mean_pa: float = not_negative()
    sd_pa: float = not_negative()
    own_modulus_pa: float | None = not_negative(default=None)
    again: KnownForce | None = None
    points: int = not_negative(default=0)
    gated: tuple[int, ...] = not_negative(default=())
    nis: float = not_negative(default=0.0)
    inflation: float = not_negative(default=1.0)
    status: str = one_line("ok")
    skipped: str | None = one_line(None)
    planes: tuple[tuple[str, str], ...] = one_line(())

    @property
    def seen(self) -> tuple[tuple[str, str], ...]:
        """Files and digests of the frames that it rests on."""
        return self.planes or ((self.file, self.sha256),)


@dataclass(frozen=True, kw_only=True)
class UsedRecording:
    """A recording that was calibrated on: path as given, SHA-256 of its tables, zero of
    its force that was subtracted.

    `remarks` are on its log, walls and globe, and on the frames that were used.
    """

    path: str
    sha256: str = one_line()
    zero_n: float = finite()
    drift_n_per_s: float = finite()
    remarks: tuple[Remark, ...] = ()

    @property
    def doubts(self) -> tuple[str, ...]:
        """The sentences of the remarks, as calibration files have them."""
        return sentences(self.remarks)


@dataclass(frozen=True, eq=False, kw_only=True)
class EyeCalibration:
    """One eye after its frames.

    `names` of the uncertain parameters, `means` and `sds` of them in SI; `bounds_n`:
    the class bounds, by which the moduli of its frames are compared;
    `stated_thickness_m`: the recording's; `globe`: the known globe after the frames;
    `discrepancy`: of its forces from the library's; `stiffening`: b of the tissue whose
    walls explain its frames best; `relaxation`: how it relaxes; `lean_rad`: of the
    needle in the last recording; if it is known, forces are parts along the wall's
    normal, and E is of these. With a library, modulus and rigidity are from the frames
    read again (`calibration.stiffness_from_forces`); `without_force`: E is from the
    shape of the dents (`calibration.stiffness_from_shape`). The filter's `state`, from
    which the eye's next recording continues, its `steps`, for figures, the `prior` of
    E, and the `errors` of what is declared, are missing if read from a file.
    `assumed_iop_pa`: the pressure at which E was found; None: it was stated.
    `whole_sd_pa`: standard deviation of E with those errors, which forces do not feel;
    None: they are not known.
    """

    id: str
    names: tuple[str, ...]
    means: tuple[float, ...]
    sds: tuple[float, ...]
    bounds_n: tuple[float, ...]
    stated_thickness_m: float
    globe: Globe
    recordings: tuple[UsedRecording, ...] = field(repr=False)
    frames: tuple[FrameRecord, ...] = field(repr=False)
    discrepancy: ForceDiscrepancy | None = None
    stiffening: float = 0.0
    relaxation: Relaxation | None = None
    lean_rad: float | None = None
    assumed_iop_pa: float | None = None
    without_force: bool = False
    appearance: Appearance | None = None
    state: EyeState | None = field(default=None, repr=False)
    steps: tuple[FrameStep, ...] = field(default=(), repr=False)
    filter: EyeFilter | None = field(default=None, repr=False)
    prior: Modulus | None = None
    errors: DeclaredErrors | None = field(default=None, repr=False)
    whole_sd_pa: float | None = None

    def with_appearance(self, appearance: Appearance | None) -> "EyeCalibration":
        """Return the eye with what its frames show, which tells how far E is off."""
        if self.errors is None:
            return replace(self, appearance=appearance)

        shown_off_m = (
            None
            if appearance is None
            else to_si(appearance.thickness_um, "um") - self.stated_thickness_m
        )
        declared_pa = self.errors.log_modulus_sd(shown_off_m) * self.mean_pa
        whole_sd_pa = hypot(self.effective_sd_pa, declared_pa)
        return replace(self, appearance=appearance, whole_sd_pa=whole_sd_pa)

    @property
    def used(self) -> tuple[FrameRecord, ...]:
        """The frames that the estimate rests on."""
        return tuple(frame for frame in self.frames if frame.skipped is None)

    @property
    def mean_pa(self) -> float:
        """Posterior mean of Young's modulus."""
        return self.means[self.names.index("youngs_modulus_pa")]

    @property
    def effective_sd_pa(self) -> float:
        """Standard deviation of the modulus with which the eye's forces are read, at
        what is declared of it.
        """
        return self.sds[self.names.index("youngs_modulus_pa")]

    @property
    def sd_pa(self) -> float:
        """Standard deviation of Young's modulus, with the errors of what is declared of
        the eye, for which `mean_pa` makes up.
        """
        return self.effective_sd_pa if self.whole_sd_pa is None else self.whole_sd_pa

    @property
    def thickness_m(self) -> float:
        """The wall's thickness: estimated if it was uncertain, otherwise as stated."""
        return dict(zip(self.names, self.means, strict=True)).get(
            "thickness_m", self.stated_thickness_m
        )

    @property
    def by_class(self) -> tuple[float | None, ...]:
        """The median modulus, Pa, from the single frames of each force class; None
        without frames.

        The medians are equal for a wall that bends as the model, and fall with the
        force for one that bends more.
        """
        classes: list[list[float]] = [[] for _ in range(len(self.bounds_n) + 1)]
        for frame in self.used:
            if frame.own_modulus_pa is not None:
                label = int(np.searchsorted(self.bounds_n, frame.force_n))
                classes[label].append(frame.own_modulus_pa)

        return tuple(float(np.median(values)) if values else None for values in classes)

    @property
    def updates(self) -> int:
        """The number of frames that the estimate rests on."""
        return len(self.used)

    @property
    def status(self) -> str:
        """'ok', or the last sentence of a calibration that diverged."""
        return next(
            (frame.status for frame in reversed(self.used) if frame.status != "ok"),
            "ok",
        )

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What is to be known of its calibration: on its frames and what they show,
        then on each of its recordings.
        """
        own = (*_frame_remarks(self), *found_remarks(self))
        of_recordings = (
            remark.on(used.path) for used in self.recordings for remark in used.remarks
        )
        return (*(remark.on(self.id) for remark in own), *of_recordings)


@dataclass(frozen=True, eq=False)
class Calibration:
    """All eyes; the population is the mean of their means, its `sd` their spread (None
    for one eye).

    Eyes whose calibration diverged do not count in the population, unless all did.
    `mechanics`: "linear" or "finite-strain". `of_inputs`: remarks on what recordings
    state, known before they are calibrated on (`INPUT_CODES`).
    """

    eyes: Mapping[str, EyeCalibration]
    study_sha256: str
    bounds_n: tuple[float, ...]
    mechanics: str
    of_inputs: tuple[Remark, ...] = ()

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What is to be known of the inputs, and of the calibration of each eye."""
        of_eyes = (remark for eye in self.eyes.values() for remark in eye.remarks)
        return tuple(dict.fromkeys((*self.of_inputs, *of_eyes)))

    def __repr__(self) -> str:
        found = ", ".join(
            f"{eye.id} {from_si(eye.mean_pa, 'mpa'):.3f}" for eye in self.eyes.values()
        )
        return f"<Calibration, {self.mechanics}: E of {found} MPa>"

    def _repr_html_(self) -> str:
        """The moduli of the eyes, and remarks, for Jupyter."""
        rows = [(eye.id, eye.mean_pa, eye.sd_pa) for eye in self.eyes.values()]
        facts = {
            eye: f"E {from_si(mean, 'mpa'):.3f} ± {from_si(sd, 'mpa'):.3f} MPa"
            for eye, mean, sd in rows
        }
        return html_card(
            f"Calibration, {self.mechanics}", facts | numbered(self.remarks)
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of a calibration's file and of `calibrate`."""
        mean_pa, sd_pa = self.population
        population = {
            "mean_mpa": from_si(mean_pa, "mpa"),
            "sd_mpa": from_si(sd_pa, "mpa"),
            "stiffening": self.population_stiffening,
            "eyes": len(self.eyes),
        }

        return {
            "format": calibration_file.CALIBRATION_FORMAT,
            "scleraforce": __version__,
            "mechanics": self.mechanics,
            "study_sha256": self.study_sha256,
            "population": population,
            "class_bounds_n": list(self.bounds_n),
            "remarks": [remark.to_dict() for remark in self.remarks],
            "eyes": {name: _eye_entry(eye) for name, eye in self.eyes.items()},
        }

    def to_dataframe(self) -> Any:
        """Return a table of pandas with a row for each eye: its modulus, parameters and
        globe, units in the names, and `remarks`.
        """
        left_out = ("frames", "recordings", "steps", "state")
        return data_frame(
            {
                "eye": name,
                **{key: value for key, value in entry.items() if key not in left_out},
                "remarks": "; ".join(sentences(self.eyes[name].remarks)),
            }
            for name, entry in self.to_dict()["eyes"].items()
        )

    @property
    def population(self) -> tuple[float, float | None]:
        """Mean and spread of the eyes' mean moduli, in Pa; one eye has no spread."""
        return _mean_and_sd([eye.mean_pa for eye in self._sound])

    @property
    def population_stiffening(self) -> float:
        """Return b of the eyes' tissue: 1 + b is the geometric mean."""
        return float(
            np.expm1(np.mean(np.log1p([eye.stiffening for eye in self._sound])))
        )

    @property
    def _sound(self) -> tuple[EyeCalibration, ...]:
        eyes = tuple(self.eyes.values())
        return tuple(eye for eye in eyes if eye.status == "ok") or eyes


def _mean_and_sd(values: Sequence[float]) -> tuple[float, float | None]:
    """Return mean and sample standard deviation; a single value has no spread: None."""
    mean = sum(values) / len(values)
    return mean, (
        sqrt(sum((v - mean) ** 2 for v in values) / (len(values) - 1))
        if len(values) > 1
        else None
    )


# name of the parameter of an eye that may be sealed, in calibration files too
RIGIDITY = "rigidity_pa13_per_m3"
# Parameter -> its name for people, its unit, and how that is printed.
PRINTED: dict[str, tuple[str, HumanUnit, str]] = {
    "iop_pa": ("IOP", "mmhg", "mmHg"),
    "thickness_m": ("thickness", "um", "µm"),
    "gap_m": ("gap", "mm", "mm"),
    RIGIDITY: ("k", "mmhg13_per_ul", "mmHg^(1/3)/µl"),
}
# Remarks on what recordings state, which are known before the calibration.
INPUT_CODES = ("outside-training", "inputs-ignored", "missing-input")
SURE = 2.0  # standard deviations, from which a discrepancy is worth a remark
MUCH = 2.0  # times what is expected
# thickness over the one that frames show, from which it is worth a remark: two standard
# deviations of a thickness that is known to 3 %
OTHER_THICKNESS = 1.06


def found_remarks(eye: EyeCalibration) -> tuple[Remark, ...]:
    """Return remarks on what the frames of an eye show beside its modulus, which has a
    column of its own.

    First each parameter with its standard deviation; then the thickness, where frames
    show another one; the stiffening of the tissue, if any, and how it relaxes; the
    discrepancy of the eye's forces from the library's, if that is sure (an uneven
    wall); and the scatter of its frames, if that is large (a wall that the library does
    not have).
    """
    found = list[Remark]()
    if eye.without_force:
        found.append(Remark("modulus-from-shape", "E from shape", ("modulus",)))

    for name, mean, sd in zip(eye.names, eye.means, eye.sds, strict=True):
        if name != PARAMETERS["e"]:
            field_name = "globe" if name == RIGIDITY else name
            words = _words(name, mean, sd)
            found.append(Remark("parameter-found", words, (field_name,)))

    if eye.appearance is not None:
        found += _thickness_remarks(eye, eye.appearance)

    if eye.stiffening > 0.0:
        words = f"tissue stiffens, b {eye.stiffening:.2g}"
        found.append(Remark("tissue-stiffens", words, ("stiffening",)))

    if eye.relaxation is not None:
        found += _relaxation_remarks(eye.relaxation)

    discrepancy = eye.discrepancy or NO_DISCREPANCY
    mean, sd = discrepancy.at_reference()
    if abs(mean) > SURE * sd:
        percent = from_si(exp(mean) - 1.0, "percent")
        side = "above" if percent > 0.0 else "below"
        reference = f"{from_si(REFERENCE_N, 'mn'):g} mN"
        size = f"{abs(percent):.0f} ± {from_si(sd, 'percent'):.0f} %"
        words = f"forces {size} {side} the library's at {reference}"
        found.append(Remark("forces-beside-library", words, ("discrepancy",)))

    if discrepancy.scatter > MUCH:
        words = f"forces scatter {discrepancy.scatter:.1f} times as far as expected"
        found.append(Remark("forces-scatter", words, ("discrepancy",)))

    return tuple(found)


def _thickness_remarks(eye: EyeCalibration, shown: Appearance) -> list[Remark]:
    """Return a remark if frames show a wall of another thickness than the one that the
    modulus is of, and how stiff that wall would be.
    """
    thickness_um = from_si(eye.thickness_m, "um")
    ratio = thickness_um / shown.thickness_um
    if 1.0 / OTHER_THICKNESS <= ratio <= OTHER_THICKNESS:
        return []

    mean_mpa = from_si(eye.mean_pa, "mpa") * ratio**FORCE_BY_LOG_THICKNESS
    words = (
        f"frames show a wall of {shown.thickness_um:.0f} µm, not {thickness_um:.0f}:"
        f" its E would be {mean_mpa:.2g} MPa"
    )
    return [Remark("thickness-beside-frames", words, ("thickness_m", "modulus"))]


def _relaxation_remarks(relaxation: Relaxation) -> list[Remark]:
    """Return what is known of the relaxation of an eye, and why; nothing if its force
    stays in all holds.
    """
    lost = from_si(float(np.dot(relaxation.shares, relaxation.held)), "percent")
    relaxes = f"tissue relaxes, {lost:.0f} % of a force lost at its frames"
    finding = relaxation.finding

    if relaxation.source == "declared":
        declared_as = f"declared: {relaxes}" if lost else "declared: tissue is elastic"
        return [_of_relaxation(declared_as)]
    if finding is None or finding.cause == "steady":
        return [_of_relaxation(relaxes)] if lost else []
    if finding.hold_s is None or finding.fall is None:
        words = "no hold of the log shows how the tissue relaxes: as in other tissue"
        return [_of_relaxation(words, is_known=False)]

    part = ""
    if finding.tissue_share is not None and finding.tissue_share_sd is not None:
        share = from_si(finding.tissue_share, "percent")
        sd = from_si(finding.tissue_share_sd, "percent")
        part = (
            f"{finding.frames} frames of holds make {share:.0f} ± {sd:.0f} % of the"
            " fall the tissue's"
        )

    fall = (
        f"the force falls by {from_si(finding.fall, 'percent'):.0f} % in holds of"
        f" {finding.hold_s:.0f} s"
    )
    causes = {
        "tissue": f"{relaxes}; the dent stays in a hold: {part}",
        "needle": f"{fall}, and the dent with it: the needle yields; {part}",
        "both": f"{relaxes}, and the needle yields; {part}",
        "undecided": (
            f"{fall}, by tissue or needle; "
            + (part or "no two frames of one hold show which")
            + ": intervals cover both"
        ),
    }
    found = [_of_relaxation(causes[finding.cause], finding.cause != "undecided")]

    if finding.not_estimated_s and finding.cause != "needle":
        times = ", ".join(f"{time_s:g}" for time_s in finding.not_estimated_s)
        words = f"time constants not estimated: {times} s"
        found.append(_of_relaxation(words, is_known=False))

    return found


def _of_relaxation(words: str, is_known: bool = True) -> Remark:
    code = "relaxation-found" if is_known else "relaxation-unknown"
    return Remark(code, words, ("relaxation",))


def _frame_remarks(eye: EyeCalibration) -> list[Remark]:
    """Return remarks on outlying points, on a calibration that diverged, and on single
    frames that do not agree on E.
    """
    found = list[Remark]()
    if gated := sum(len(frame.gated) for frame in eye.used):
        found.append(Remark("points-left-out", f"{gated} outlying points left out"))
    if eye.status != "ok":
        found.append(Remark("filter-diverged", eye.status))
    if words := _softening(eye):
        found.append(Remark("bends-otherwise", words, ("modulus",)))
    return found


def rigidity_words(eye: EyeCalibration) -> str:
    """Return mean and standard deviation of the rigidity of an eye that may be
    sealed.
    """
    place = eye.names.index(RIGIDITY)
    return _words(RIGIDITY, eye.means[place], eye.sds[place])


def _words(name: str, mean: float, sd: float) -> str:
    """Return one parameter, its mean to the first digit of its standard deviation."""
    words, unit, printed = PRINTED[name]
    mean = from_si(mean, unit)
    sd = from_si(sd, unit)
    decimals = max(0, -floor(log10(sd))) if isfinite(sd) and sd > 0.0 else 3
    return f"{words} {mean:.{decimals}f} ± {sd:.{decimals}f} {printed}"


# Each uncertain parameter, and the values (SI) that it may have in a file.
_RANGES = {
    "youngs_modulus_pa": (1e3, 100e6),
    "iop_pa": (-1e5, 1e5),
    "thickness_m": (1e-6, 10e-3),
    "gap_m": (-0.1, 0.1),
    RIGIDITY: (-1e10, 1e10),
}


def _eye_entry(eye: EyeCalibration) -> dict[str, Any]:
    moments = zip(eye.names, eye.means, eye.sds, strict=True)
    return {
        "mean_mpa": from_si(eye.mean_pa, "mpa"),
        "sd_mpa": from_si(eye.sd_pa, "mpa"),
        "effective_sd_mpa": from_si(eye.effective_sd_pa, "mpa"),
        "thickness_um": from_si(eye.thickness_m, "um"),
        "globe": calibration_file.globe_entry(eye.globe),
        "stiffening": eye.stiffening,
        "relaxation": eye.relaxation and asdict(eye.relaxation),
        "lean_deg": from_si(eye.lean_rad, "deg"),
        "assumed_iop_mmhg": from_si(eye.assumed_iop_pa, "mmhg"),
        "discrepancy": eye.discrepancy and vars(eye.discrepancy),
        "updates": eye.updates,
        "without_force": eye.without_force,
        "appearance": eye.appearance and vars(eye.appearance),
        "status": eye.status,
        "by_class_mpa": [from_si(value, "mpa") for value in eye.by_class],
        "recording": eye.recordings[0].path,
        "frames": [
            {"file": file, "sha256": sha256}
            for frame in eye.used
            if frame.force_n or not eye.without_force
            for file, sha256 in frame.seen
        ],
        "parameters": {name: {"mean": mean, "sd": sd} for name, mean, sd in moments},
        "recordings": [_recording_entry(entry) for entry in eye.recordings],
        "steps": [_frame_entry(frame) for frame in eye.frames],
    }


def _recording_entry(used: UsedRecording) -> dict[str, Any]:
    remarks = [remark.to_dict() for remark in used.remarks]
    return {**vars(used), "doubts": list(used.doubts), "remarks": remarks}


def _frame_entry(frame: FrameRecord) -> dict[str, Any]:
    again = frame.again
    read = {
        "read_n": again and again.library_n,
        "read_sd_n": again and again.sd_n,
        "again": again and vars(again),
    }

    return {**vars(frame), **read}


def parse_calibration(file: CalibrationFile) -> Calibration:
    """Return the calibration of a file, to continue it or to report it; raises
    `CalibrationError`.
    """
    summary = calibration_file.summary_of(file)
    saved = decode_file(file, _SavedCalibration)
    if not saved.bounds_n or not (np.diff(saved.bounds_n) > 0.0).all():
        raise CalibrationError(
            f"{file.path}: class_bounds_n: expected bounds that increase; {WRITER}"
        )

    eyes = {
        name: _saved_eye(name, eye, saved, f"{file.path}: eyes.{name}")
        for name, eye in summary.eyes.items()
    }
    found = Calibration(eyes, saved.study_sha256, saved.bounds_n, summary.mechanics)
    of_inputs = (
        remark
        for remark in saved.remarks
        if remark.code in INPUT_CODES and remark not in found.remarks
    )
    return replace(found, of_inputs=tuple(of_inputs))


@dataclass(frozen=True, kw_only=True)
class _MeanAndSd:
    mean: float = finite()
    sd: float = not_negative()


@dataclass(frozen=True, kw_only=True)
class _SavedRecording:
    """An entry of `recordings`; earlier versions wrote the sentences of its remarks
    alone.
    """

    path: str
    sha256: str = one_line()
    zero_n: float = finite()
    drift_n_per_s: float = finite()
    doubts: tuple[str, ...] = one_line(())
    remarks: tuple[Remark, ...] | None = None

    @property
    def used(self) -> UsedRecording:
        """The recording."""
        remarks = self.remarks
        if remarks is None:
            remarks = tuple(Remark("earlier-version", words) for words in self.doubts)
        return UsedRecording(
            path=self.path,
            sha256=self.sha256,
            zero_n=self.zero_n,
            drift_n_per_s=self.drift_n_per_s,
            remarks=remarks,
        )


@dataclass(frozen=True, kw_only=True)
class _SavedEye:
    """The part of an entry of `eyes` that `calibration` reads beside its summary."""

    parameters: Mapping[str, _MeanAndSd]
    sd_pa: float = not_negative("mpa", key="sd_mpa")
    recordings: tuple[_SavedRecording, ...]
    steps: tuple[FrameRecord, ...]


@dataclass(frozen=True, kw_only=True)
class _SavedCalibration:
    """The part of a file that `calibration` reads beside its summary."""

    study_sha256: str
    bounds_n: tuple[float, ...] = finite(key="class_bounds_n")
    eyes: Mapping[str, _SavedEye]
    remarks: tuple[Remark, ...] = ()


def _saved_eye(
    name: str, summary: CalibratedEye, calibration: _SavedCalibration, place: str
) -> EyeCalibration:
    eye = summary.eye
    saved = calibration.eyes[name]
    modulus = declared(eye.modulus, "modulus")
    if set(saved.parameters) - set(_RANGES) or PARAMETERS["e"] not in saved.parameters:
        known = ", ".join(_RANGES)
        raise CalibrationError(
            f"{place}.parameters: expected youngs_modulus_pa, and others of {known};"
            f" {WRITER}"
        )

    for parameter, moments in saved.parameters.items():
        low, high = _RANGES[parameter]
        if not (low <= moments.mean <= high and moments.sd <= high):
            raise CalibrationError(
                f"{place}.parameters.{parameter}: {moments.mean:g} ± {moments.sd:g} is"
                f" not within {low:g} to {high:g}; {WRITER}"
            )

    found = EyeCalibration(
        id=name,
        names=tuple(saved.parameters),
        means=tuple(moments.mean for moments in saved.parameters.values()),
        sds=tuple(moments.sd for moments in saved.parameters.values()),
        bounds_n=calibration.bounds_n,
        stated_thickness_m=declared(eye.thickness_m, "thickness_m"),
        globe=declared(eye.globe, "globe"),
        without_force=modulus.source == "shape",
        recordings=tuple(entry.used for entry in saved.recordings),
        frames=saved.steps,
        discrepancy=eye.discrepancy,
        stiffening=declared(eye.stiffening, "stiffening"),
        relaxation=eye.relaxation,
        lean_rad=eye.calibrated_lean_rad,
        assumed_iop_pa=eye.iop_pa,
        appearance=summary.appearance,
        whole_sd_pa=saved.sd_pa,
    )
    if not found.used or not found.recordings:
        raise CalibrationError(
            f"{place}.steps: no frame, or no recording, that was used; {WRITER}"
        )
    if not np.allclose(
        (found.mean_pa, found.effective_sd_pa),
        (modulus.mean_pa, modulus.sd_pa),
        rtol=1e-6,
    ):
        raise CalibrationError(
            f"{place}.parameters.youngs_modulus_pa: is not that of mean_mpa and"
            f" effective_sd_mpa; {WRITER}"
        )

    return found


# relative difference between the moduli of low and high forces that is worth a remark
BENDS_OTHERWISE = 0.1


def calibration_lines(calibration: Calibration) -> list[str]:
    """Return a table of the eyes, the population below, and a note for each doubt about
    a recording.
    """
    notes = [
        wrapped(str(remark.on(used.path)), "note: ")
        for eye in calibration.eyes.values()
        for used in eye.recordings
        for remark in used.remarks
    ]
    return [*_table(calibration, with_remarks=True), *notes]


def modulus_lines(calibration: Calibration) -> list[str]:
    """Return the table of the eyes without remarks, and the population below."""
    return _table(calibration, with_remarks=False)


def _table(calibration: Calibration, with_remarks: bool) -> list[str]:
    head = f"{'eye':<16}{'E/MPa':>8}{'sd/MPa':>9}{'updates':>9}"
    lines = [f"{head}  remark" if with_remarks else head]
    lines += [_line(name, eye, with_remarks) for name, eye in calibration.eyes.items()]
    mean_pa, sd_pa = calibration.population
    population = f"{'population':<16}{from_si(mean_pa, 'mpa'):>8.3f}"

    if sd_pa is None:
        population = wrapped(
            "the spread needs at least two eyes", f"{population}{'-':>9}{'':>9}  "
        )
    else:
        population += f"{from_si(sd_pa, 'mpa'):>9.4f}"

    return [*lines, population]


def _line(name: str, eye: EyeCalibration, with_remarks: bool) -> str:
    remarks = (*_frame_remarks(eye), *found_remarks(eye)) if with_remarks else ()
    text = "; ".join(remark.words for remark in remarks)
    modulus = f"{from_si(eye.mean_pa, 'mpa'):>8.3f}{from_si(eye.sd_pa, 'mpa'):>9.4f}"

    return wrapped(text, f"{name:<16}{modulus}{eye.updates:>9}  ")


def _softening(eye: EyeCalibration) -> str:
    """Return a sentence where low and high forces do not agree on E; a frame alone
    cannot tell E from a rigidity.
    """
    _, low, high = eye.by_class
    if (
        eye.globe.can_be_sealed
        or low is None
        or high is None
        or abs(high / low - 1) < BENDS_OTHERWISE
    ):
        return ""

    force = f"{from_si(eye.bounds_n[-1], 'mn'):g} mN"
    moduli = (
        f"{from_si(low, 'mpa'):.3f} MPa below {force} and {from_si(high, 'mpa'):.3f}"
        " above"
    )
    return f"E is {moduli}: the wall bends otherwise than the model"
