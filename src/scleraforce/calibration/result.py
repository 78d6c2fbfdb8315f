"""What a calibration found: of each frame, of each eye, and of the population."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from scleraforce.calibration.assimilation import EyeFilter, EyeState, FrameStep
from scleraforce.calibration.known_forces import KnownForce
from scleraforce.calibration.parameters import spread
from scleraforce.known.discrepancy import ForceDiscrepancy
from scleraforce.known.globe import KnownGlobe


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
    the frames read again (`calibration.discrepancy`), `state` is the filter's. `steps` are kept for figures, and are
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
