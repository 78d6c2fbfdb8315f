"""What a calibration found of each frame, each eye and the population; in words, and as it is saved."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp, floor, isfinite, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce import __version__
from scleraforce.calibration.assimilation import PARAMETERS, RIGIDITY, SHARED, EyeFilter, EyeState, FrameStep
from scleraforce.calibration.eye_model import spread
from scleraforce.calibration.known_forces import KnownForce
from scleraforce.calibration.registration import NUISANCES, PoseBelief
from scleraforce.calibration.roukf import Posterior
from scleraforce.errors import CalibrationError
from scleraforce.known.calibration_file import (
    CALIBRATION_FORMAT,
    WRITER,
    CalibrationFile,
    globe_entry,
    number_of,
    summary_of_eye,
    table_of,
    text_of,
)
from scleraforce.known.eye import NO_DISCREPANCY, REFERENCE_N, ForceDiscrepancy, KnownGlobe
from scleraforce.units import HumanUnit, from_si


@dataclass(frozen=True, kw_only=True)
class FrameRecord:
    """What became of a frame: estimate of E after it, or the reason why it was not used.

    `sha256` is the frame's content (`recording.folder.frame_digest`), by which it is known again under any name.
    `force_n` is what the filter took, the label freed of offset and drift. `own_modulus_pa`: what the frame alone says;
    `again`: what is read in it in the end.
    """

    recording: str
    file: str
    sha256: str
    force_n: float
    mean_pa: float
    sd_pa: float
    own_modulus_pa: float | None = None
    again: KnownForce | None = None
    points: int = 0
    gated: tuple[int, ...] = ()
    nis: float = 0.0
    inflation: float = 1.0
    status: str = "ok"
    skipped: str | None = None


@dataclass(frozen=True, kw_only=True)
class UsedRecording:
    """A recording that was calibrated on: path as given, SHA-256 of its tables, zero of its force taken off.

    `doubts` are sentences on a log that does not go with the frames (`recording.labels`), and on the globe.
    """

    path: str
    sha256: str
    zero_n: float
    drift_n_per_s: float
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class EyeCalibration:
    """One eye: what is known after its frames.

    `names` of the uncertain parameters, `means` and `sds` of them in SI; `stated_thickness_m`: the recording's;
    `globe`: what is known of it after the frames; `discrepancy`: how far its forces lie off the library's;
    `stiffening`: b of the tissue whose walls explain its frames best. With a library, modulus and rigidity are those of
    the frames read again (`calibration.known_forces`), `state` is the filter's. `steps` are kept for figures, and are
    empty for what was read from a file.
    """

    id: str
    names: tuple[str, ...]
    means: tuple[float, ...]
    sds: tuple[float, ...]
    stated_thickness_m: float
    globe: KnownGlobe
    state: EyeState = field(repr=False)
    recordings: tuple[UsedRecording, ...] = field(repr=False)
    frames: tuple[FrameRecord, ...] = field(repr=False)
    discrepancy: ForceDiscrepancy | None = None
    stiffening: float = 0.0
    steps: tuple[FrameStep, ...] = field(default=(), repr=False)
    filter: EyeFilter | None = field(default=None, repr=False)

    @property
    def used(self) -> tuple[FrameRecord, ...]:
        """The frames that the estimate rests on."""
        return tuple(frame for frame in self.frames if frame.skipped is None)

    @property
    def mean_pa(self) -> float:
        """Posterior mean of Young's modulus."""
        return self.means[self.names.index("youngs_modulus_pa")]

    @property
    def sd_pa(self) -> float:
        """Posterior standard deviation of Young's modulus."""
        return self.sds[self.names.index("youngs_modulus_pa")]

    @property
    def thickness_m(self) -> float:
        """The wall's thickness: estimated where it was uncertain, or else as it was stated."""
        return dict(zip(self.names, self.means, strict=True)).get("thickness_m", self.stated_thickness_m)

    def by_class(self, bounds_n: tuple[float, ...]) -> tuple[float | None, ...]:
        """Return the median of what the frames of each force class say of E on their own, in Pa; None where none does.

        All the same for a wall that bends as the model says; falling with the force for one that bends more.
        """
        classes: list[list[float]] = [[] for _ in range(len(bounds_n) + 1)]
        for frame in self.used:
            if frame.own_modulus_pa is not None:
                classes[int(np.searchsorted(bounds_n, frame.force_n))].append(frame.own_modulus_pa)
        return tuple(float(np.median(values)) if values else None for values in classes)

    @property
    def status(self) -> str:
        """'ok', or the last sentence of a filter that diverged."""
        return next((frame.status for frame in reversed(self.used) if frame.status != "ok"), "ok")


@dataclass(frozen=True, eq=False)
class Calibration:
    """All eyes; the population is the mean of their means, its `sd` their spread (None for one eye).

    Eyes whose filter diverged are none of the population, unless all did.

    `mechanics`: "linear" or "finite-strain", what the wall was taken to do.
    """

    eyes: Mapping[str, EyeCalibration]
    study_sha256: str
    bounds_n: tuple[float, ...]
    mechanics: str

    @property
    def population(self) -> tuple[float, float | None]:
        """Mean and spread of the eyes' mean moduli, in Pa; one eye has no spread."""
        return spread([eye.mean_pa for eye in self._sound])

    @property
    def population_stiffening(self) -> float:
        """Return b of the eyes' tissue: 1 + b is the geometric mean."""
        return float(np.expm1(np.mean(np.log1p([eye.stiffening for eye in self._sound]))))

    def left_out(self, eye_id: str) -> float:
        """Return the population's mean without one eye, in Pa (that eye's own where it is the only one)."""
        others = [eye.mean_pa for eye in self._sound if eye.id != eye_id]
        return spread(others)[0] if others else self.population[0]

    @property
    def _sound(self) -> tuple[EyeCalibration, ...]:
        eyes = tuple(self.eyes.values())
        return tuple(eye for eye in eyes if eye.status == "ok") or eyes


# Parameter -> its name for people, its unit, and how that is printed.
PRINTED: dict[str, tuple[str, HumanUnit, str]] = {
    "iop_pa": ("IOP", "mmhg", "mmHg"),
    "thickness_m": ("thickness", "um", "µm"),
    "gap_m": ("gap", "mm", "mm"),
    RIGIDITY: ("k", "mmhg13_per_ul", "mmHg^(1/3)/µl"),
}
SURE = 2.0  # standard deviations, of what is said
MUCH = 2.0  # times what is expected


def found_words(eye: EyeCalibration) -> tuple[str, ...]:
    """Return mean and standard deviation of each parameter but the modulus, which has a column of its own.

    And how much the tissue stiffens, where it does; by how much the eye's forces lie off the library's, where that is
    sure: an uneven wall; and how far its frames scatter, where that is much: a wall that is none of the library's.
    """
    found = zip(eye.names, eye.means, eye.sds, strict=True)
    stiffens = (f"tissue stiffens, b {eye.stiffening:.2g}",) if eye.stiffening > 0.0 else ()
    others = (_words(name, mean, sd) for name, mean, sd in found if name != PARAMETERS["e"])
    return (*others, *stiffens, *_discrepancy_words(eye), *_scatter_words(eye))


def rigidity_words(eye: EyeCalibration) -> str:
    """Return mean and standard deviation of the rigidity of an eye that may be sealed."""
    place = eye.names.index(RIGIDITY)
    return _words(RIGIDITY, eye.means[place], eye.sds[place])


def _discrepancy_words(eye: EyeCalibration) -> tuple[str, ...]:
    mean, sd = (eye.discrepancy or NO_DISCREPANCY).at_reference()
    if abs(mean) <= SURE * sd:
        return ()
    percent = from_si(exp(mean) - 1.0, "percent")
    side = "above" if percent > 0.0 else "below"
    reference = f"{from_si(REFERENCE_N, 'mn'):g} mN"
    return (f"forces {abs(percent):.0f} ± {from_si(sd, 'percent'):.0f} % {side} the library's at {reference}",)


def _scatter_words(eye: EyeCalibration) -> tuple[str, ...]:
    scatter = (eye.discrepancy or NO_DISCREPANCY).scatter
    return (f"forces scatter {scatter:.1f} times as far as expected",) if scatter > MUCH else ()


def _words(name: str, mean: float, sd: float) -> str:
    """Return one parameter, its mean to the first digit of its standard deviation."""
    words, unit, printed = PRINTED[name]
    mean, sd = from_si(mean, unit), from_si(sd, unit)
    decimals = max(0, -floor(log10(sd))) if isfinite(sd) and sd > 0.0 else 3
    return f"{words} {mean:.{decimals}f} ± {sd:.{decimals}f} {printed}"


Array = NDArray[np.float64]

LARGEST = 1e15  # of what is only carried on; squares of it are still numbers
TINY = 1e-15  # of what is divided by
LONGEST_RECENT = 100
# What may be uncertain, and between which values (SI) it can be.
_RANGES = {
    "youngs_modulus_pa": (1e3, 100e6),
    "iop_pa": (-1e5, 1e5),
    "thickness_m": (1e-6, 10e-3),
    "gap_m": (-0.1, 0.1),
    RIGIDITY: (-1e10, 1e10),
}


def calibration_as_json(calibration: Calibration) -> dict[str, Any]:
    """Return a calibration as it stands in its file and in `calibrate --json`."""
    mean_pa, sd_pa = calibration.population
    return {
        "format": CALIBRATION_FORMAT,
        "scleraforce": __version__,
        "mechanics": calibration.mechanics,
        "study_sha256": calibration.study_sha256,
        "population": {
            "mean_mpa": from_si(mean_pa, "mpa"),
            "sd_mpa": from_si(sd_pa, "mpa"),
            "stiffening": calibration.population_stiffening,
            "eyes": len(calibration.eyes),
        },
        "class_bounds_n": list(calibration.bounds_n),
        "eyes": {name: _eye_entry(eye, calibration.bounds_n) for name, eye in calibration.eyes.items()},
    }


def _eye_entry(eye: EyeCalibration, bounds_n: tuple[float, ...]) -> dict[str, Any]:
    posterior, belief = eye.state.posterior, eye.state.belief
    return {
        "mean_mpa": from_si(eye.mean_pa, "mpa"),
        "sd_mpa": from_si(eye.sd_pa, "mpa"),
        "thickness_um": from_si(eye.thickness_m, "um"),
        "globe": globe_entry(eye.globe),
        "stiffening": eye.stiffening,
        "discrepancy": None if eye.discrepancy is None else vars(eye.discrepancy),
        "updates": posterior.updates,
        "status": eye.status,
        "by_class_mpa": [from_si(value, "mpa") for value in eye.by_class(bounds_n)],
        "recording": eye.recordings[0].path,
        "frames": [{"file": frame.file, "sha256": frame.sha256} for frame in eye.used],
        "parameters": {
            name: {"mean": mean, "sd": sd} for name, mean, sd in zip(eye.names, eye.means, eye.sds, strict=True)
        },
        "recordings": [vars(entry) for entry in eye.recordings],
        "steps": [_frame_entry(frame) for frame in eye.frames],
        "state": {
            "mean": posterior.mean.tolist(),
            "factor": posterior.factor.tolist(),
            "precision": posterior.precision.tolist(),
            "updates": posterior.updates,
            "recent": [list(entry) for entry in posterior.recent],
            "belief_mean": belief.mean.tolist(),
            "belief_covariance": belief.covariance.tolist(),
            "shared": list(SHARED),
            "sensitivity": eye.state.sensitivity.tolist(),
            "zero_covariance": eye.state.zero_covariance.tolist(),
        },
    }


def _frame_entry(frame: FrameRecord) -> dict[str, Any]:
    again = frame.again
    return {
        **vars(frame),
        "read_n": None if again is None else again.library_n,
        "read_sd_n": None if again is None else again.sd_n,
        "again": None if again is None else vars(again),
    }


def parse_calibration(file: CalibrationFile) -> Calibration:
    """Return the calibration of a file, to go on from it or to report it.

    Raises:
        CalibrationError: naming the file and the key.
    """
    name, content = file.path, file.content
    eyes = {eye: _parse_eye(eye, entry, f"{name}: eyes.{eye}") for eye, entry in content["eyes"].items()}
    bounds_n = _numbers(content, "class_bounds_n", name, 1)
    if not (np.diff(bounds_n) > 0.0).all() or not len(bounds_n):
        raise CalibrationError(f"{name}: class_bounds_n: expected bounds that increase; {WRITER}")
    return Calibration(eyes, text_of(content, "study_sha256", name), tuple(bounds_n.tolist()), content["mechanics"])


def _parse_eye(eye_id: str, entry: Any, place: str) -> EyeCalibration:
    summary = summary_of_eye(entry, place)
    parameters = table_of(entry, "parameters", place)
    if not parameters or set(parameters) - set(_RANGES) or "youngs_modulus_pa" not in parameters:
        known = ", ".join(_RANGES)
        raise CalibrationError(f"{place}.parameters: expected youngs_modulus_pa, and of {known} what else; {WRITER}")
    moments = {name: _moments(parameters, name, f"{place}.parameters") for name in parameters}
    found = EyeCalibration(
        id=eye_id,
        names=tuple(moments),
        means=tuple(mean for mean, _ in moments.values()),
        sds=tuple(sd for _, sd in moments.values()),
        stated_thickness_m=summary.thickness_m,
        globe=summary.globe,
        state=_parse_state(table_of(entry, "state", place), len(parameters), f"{place}.state"),
        recordings=tuple(_parse_recording(*named) for named in _entries(entry, "recordings", place)),
        frames=tuple(_parse_frame(*named) for named in _entries(entry, "steps", place)),
        discrepancy=summary.discrepancy,
        stiffening=summary.stiffening,
    )
    if not found.used:
        raise CalibrationError(f"{place}.steps: no frame that was used; {WRITER}")
    if not np.allclose((found.mean_pa, found.sd_pa), (summary.mean_pa, summary.sd_pa), rtol=1e-6):
        raise CalibrationError(f"{place}.parameters.youngs_modulus_pa: is not that of mean_mpa and sd_mpa; {WRITER}")
    return found


def _moments(parameters: dict[str, Any], name: str, place: str) -> tuple[float, float]:
    entry, (low, high) = table_of(parameters, name, place), _RANGES[name]
    return number_of(entry, "mean", f"{place}.{name}", low, high), number_of(entry, "sd", f"{place}.{name}", 0.0, high)


def _parse_state(state: dict[str, Any], size: int, place: str) -> EyeState:
    if state.get("shared") != list(SHARED):
        raise CalibrationError(f"{place}.shared: expected {', '.join(SHARED)}; {WRITER}")
    posterior = Posterior(
        _numbers(state, "mean", place, 1),
        _numbers(state, "factor", place, 2),
        _positive(state, "precision", place),
        round(number_of(state, "updates", place, 0.0, 1e9)),
        tuple((float(nis), round(count)) for nis, count in _pairs(state, "recent", place)),
    )
    belief = PoseBelief(_numbers(state, "belief_mean", place, 1), _positive(state, "belief_covariance", place))
    sensitivity = _numbers(state, "sensitivity", place, 2)
    zero = _positive(state, "zero_covariance", place)
    pose = len(NUISANCES)
    expected = ((size,), (size, size), (size, size), (pose,), (pose, pose), (size, len(SHARED)), (2, 2))
    arrays = (posterior.mean, posterior.factor, posterior.precision, *vars(belief).values(), sensitivity, zero)
    if tuple(array.shape for array in arrays) != expected:
        raise CalibrationError(f"{place}: its arrays do not fit {size} parameters; {WRITER}")
    if np.linalg.eigvalsh(posterior.precision).min() <= 0.0:
        raise CalibrationError(f"{place}.precision: is not positive definite; {WRITER}")
    return EyeState(posterior, belief, sensitivity, zero)


def _parse_recording(entry: Mapping[str, Any], place: str) -> UsedRecording:
    return UsedRecording(
        path=_text(entry, "path", place),
        sha256=text_of(entry, "sha256", place),
        zero_n=number_of(entry, "zero_n", place, -LARGEST, LARGEST),
        drift_n_per_s=number_of(entry, "drift_n_per_s", place, -LARGEST, LARGEST),
        doubts=tuple(text_of({"doubts": doubt}, "doubts", place) for doubt in _list(entry, "doubts", place)),
    )


def _parse_frame(entry: Mapping[str, Any], place: str) -> FrameRecord:
    gated, skipped = entry.get("gated"), entry.get("skipped")
    if not isinstance(gated, list) or not all(type(index) is int and index >= 0 for index in gated):
        raise CalibrationError(f"{place}.gated: expected a list of indices; {WRITER}")
    return FrameRecord(
        recording=_text(entry, "recording", place),
        file=text_of(entry, "file", place),
        sha256=text_of(entry, "sha256", place),
        force_n=number_of(entry, "force_n", place, -LARGEST, LARGEST),
        mean_pa=number_of(entry, "mean_pa", place, 0.0, LARGEST),
        sd_pa=number_of(entry, "sd_pa", place, 0.0, LARGEST),
        own_modulus_pa=_maybe(entry, "own_modulus_pa", place),
        again=_parse_again(entry, place),
        points=round(number_of(entry, "points", place, 0.0, LARGEST)),
        gated=tuple(gated),
        nis=number_of(entry, "nis", place, 0.0, LARGEST),
        inflation=number_of(entry, "inflation", place, 0.0, LARGEST),
        status=text_of(entry, "status", place),
        skipped=None if skipped is None else text_of(entry, "skipped", place),
    )


def _parse_again(entry: Mapping[str, Any], place: str) -> KnownForce | None:
    """Return what a frame reads again; None where it was not read, and in files of earlier versions."""
    if entry.get("again") is None:
        return None
    values, within = table_of(entry, "again", place), f"{place}.again"
    least = dict.fromkeys(("force_n", "library_n", "sd_n", "modulus_pa"), TINY)
    least |= dict.fromkeys(("rigidity", "by_modulus", "by_rigidity"), -LARGEST)
    loss = number_of(values, "loss", within, 0.0, LARGEST) if "loss" in values else 0.0
    return KnownForce(**{name: number_of(values, name, within, low, LARGEST) for name, low in least.items()}, loss=loss)


def _maybe(entry: Mapping[str, Any], key: str, place: str) -> float | None:
    return None if entry.get(key) is None else number_of(entry, key, place, 0.0, LARGEST)


def _entries(entry: Mapping[str, Any], key: str, place: str) -> list[tuple[Mapping[str, Any], str]]:
    """Return the objects of a list, each with its place."""
    found = _list(entry, key, place)
    if not all(isinstance(each, dict) for each in found):
        raise CalibrationError(f"{place}.{key}: expected a list of objects; {WRITER}")
    return [(each, f"{place}.{key}[{index}]") for index, each in enumerate(found)]


def _list(entry: Mapping[str, Any], key: str, place: str) -> list[Any]:
    found = entry.get(key)
    if not isinstance(found, list):
        raise CalibrationError(f"{place}.{key}: expected a list; {WRITER}")
    return found


def _text(entry: Mapping[str, Any], key: str, place: str) -> str:
    value = entry.get(key)
    if not isinstance(value, str):
        raise CalibrationError(f"{place}.{key}: expected a text, found {value!r:.40}; {WRITER}")
    return value


def _pairs(state: Mapping[str, Any], key: str, place: str) -> Array:
    found = _numbers(state, key, place, 2) if state.get(key) else np.empty((0, 2))
    if found.shape[1] != 2 or (found < 0.0).any() or len(found) > LONGEST_RECENT:
        raise CalibrationError(f"{place}.{key}: expected at most {LONGEST_RECENT} pairs of numbers; {WRITER}")
    return found


def _positive(state: Mapping[str, Any], key: str, place: str) -> Array:
    """Return a symmetric matrix that is nowhere negative."""
    found = _numbers(state, key, place, 2)
    slack = 1e-9 * np.abs(found).max()
    square = found.shape[0] == found.shape[1]
    if not square or np.abs(found - found.T).max() > slack or np.linalg.eigvalsh(found).min() < -slack:
        raise CalibrationError(f"{place}.{key}: is no covariance or precision; {WRITER}")
    return found


def _numbers(state: Mapping[str, Any], key: str, place: str, axes: int) -> Array:
    try:
        found = np.array(state.get(key), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.ndim != axes or not found.size or not (np.abs(found) <= LARGEST).all():
        raise CalibrationError(f"{place}.{key}: expected numbers within +-{LARGEST:g} along {axes} axes; {WRITER}")
    return found
