"""The study in one record, all values SI; the defaults are the paper's (`paper.toml` is the same, commented)."""

from dataclasses import dataclass, field

from scleraforce.errors import StudyError
from scleraforce.study.eye import (
    EyeStudy,
    FormStudy,
    GlobeStudy,
    MechanicsStudy,
    MeshStudy,
    NeedleStudy,
    SupportsStudy,
    TissueStudy,
)
from scleraforce.study.fields import Range, Sampled, Section, allowed, fixed, option, quantity
from scleraforce.study.imaging import OctStudy, PhantomStudy, SliceStudy
from scleraforce.study.networks import NetworkStudy, RawReaderStudy, ReaderStudy, WallFinderStudy
from scleraforce.study.scenes import ScenesStudy
from scleraforce.units import to_si


@dataclass(frozen=True)
class ClassesStudy(Section):
    """Bounds of the force classes: class k lies between bounds k-1 and k; a bound belongs to the class above 0.

    A force of exactly the last bound is still the class below it (class 1: from 5 to 30 mN; class 2: above 30 mN).
    """

    bounds_n: tuple[float, ...] = quantity((5.0, 30.0), "mn", 0.0, 1000.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.bounds_n) != 2 or not self.bounds_n[0] < self.bounds_n[1]:
            raise StudyError("bounds_mn: give two increasing forces, like [5.0, 30.0]")

    def classify(self, force_n: float) -> int:
        """Return the class of a force: 0 below the first bound, 2 above the second, else 1."""
        low, high = self.bounds_n
        return 0 if force_n < low else 2 if force_n > high else 1


@dataclass(frozen=True, kw_only=True)
class CalibrationStudy(Section):
    """The reduced-order unscented Kalman filter (paper sec. 2.2, 3.2); `docs/calibration.md` explains each value."""

    prior_mean_pa: float = quantity(0.49, "mpa", allowed("youngs_modulus").low, allowed("youngs_modulus").high)
    prior_sd_pa: float = quantity(0.34, "mpa", 0.0001, 100.0)
    points: int = quantity(10, None, 2, 200)
    span_m: float = quantity(4.0, "mm", 0.5, 20.0)
    sigma_points: str = option("simplex", "simplex", "canonical", "star")
    positive: bool = True
    iterations: int = quantity(10, None, 1, 100)
    gate_sd: float = quantity(5.0, None, 1.0, 1e6)
    min_force_n: float = quantity(5.0, "mn", 0.0, 1000.0)
    shift_sd_m: float = quantity(0.2, "mm", 0.001, 10.0)
    turn_sd_rad: float = quantity(0.3, "deg", 0.001, 45.0)
    inner_sd_m: float = quantity(0.05, "mm", 0.0001, 1.0)
    surface_smoothing_m: float = quantity(0.18, "mm", 0.0, 2.0)
    model_error_fraction: float = quantity(1.0, "percent", 0.0, 100.0)
    iop_sd_pa: float = quantity(0.5, "mmhg", 0.001, 80.0)
    thickness_sd_m: float = quantity(25.0, "um", 0.1, 1000.0)
    gap_sd_m: float = quantity(0.1, "mm", 0.001, 5.0)


LEAST_STIFFENINGS = 4  # that cubic splines run through


@dataclass(frozen=True, kw_only=True)
class LibraryStudy(Section):
    """Ranges of the library and the density of its grid; `docs/library.md` states the error of the interpolation.

    Thicknesses, and tensions p R/(E t) at their low part, are evenly spaced in their logarithm; tensions are denser
    towards the one at which the wall bursts (0.416 with a Poisson's ratio of 0.45), as sealed eyes rise far above their
    pressure at rest. `max_force_ratio_m2` is the largest F/E. `elements` and `layers` divide the wall's meridian.
    """

    thickness_m: Sampled = quantity(Range(min=350.0, max=900.0), "um", 100.0, 3000.0)
    thicknesses: int = quantity(10, None, 4, 1000)
    tension: Sampled = quantity(Range(min=2e-4, max=0.35), None, 1e-7, 1.0)
    tensions: int = quantity(16, None, 4, 1000)
    max_tip_m: float = quantity(10.0, "mm", 0.1, 50.0)
    tips: int = quantity(56, None, 4, 10_000)
    stiffening: Sampled = quantity(Range(min=0.0, max=30.0), None, 0.0, 200.0)
    stiffenings: int = quantity(5, None, 1, 1000)
    max_force_ratio_m2: float = quantity(0.5, "mm2", 1e-4, 100.0)
    elements: int = quantity(64, None, 8, 2000)
    layers: int = quantity(1, None, 1, 20)

    @property
    def stiffening_ends(self) -> tuple[float, float]:
        """The least and the largest stiffening that a library of it holds."""
        low, high = self.stiffening.bounds
        return low, high if self.stiffenings > 1 else low

    def __post_init__(self) -> None:
        super().__post_init__()
        for key, bounds in (("thickness_um", self.thickness_m.bounds), ("tension", self.tension.bounds)):
            if bounds[0] == bounds[1]:
                raise StudyError(f"{key}: a range has to be given, like {{ min = ..., max = ... }}")
        low, high = self.stiffening.bounds
        if self.stiffenings > 1 and low == high:
            raise StudyError("stiffening: a range has to be given, like { min = ..., max = ... }; or stiffenings = 1")
        if 1 < self.stiffenings < LEAST_STIFFENINGS:
            raise StudyError(f"stiffenings: {self.stiffenings}; give 1, or at least {LEAST_STIFFENINGS}")


@dataclass(frozen=True, kw_only=True)
class DatasetGroup(Section):
    """A part of the data set with one wall thickness."""

    thickness_m: float = quantity(500.0, "um", 300.0, 1200.0)
    images: int = quantity(4000, None, 1, 10_000_000)
    max_force_n: float = quantity(60.0, "mn", 0.1, 1000.0)


PAPER_GROUPS = (
    DatasetGroup(thickness_m=400e-6, images=3200, max_force_n=45e-3),
    *(DatasetGroup(thickness_m=to_si(t, "um"), images=4000, max_force_n=60e-3) for t in (500.0, 600.0, 700.0, 800.0)),
)


@dataclass(frozen=True)
class DatasetStudy(Section):
    """The simulated slices (paper sec. 2.3, 3.3). `framing_*` shifts the window, `gap` overrides the needle's."""

    seed: int = quantity(0, None, 0, 2**31 - 1)
    contacts: int = quantity(200, None, 2, 100_000)
    validation_fraction: float = quantity(0.1, None, 0.01, 0.9)
    framing_lateral_m: Sampled = quantity(fixed(0.0), "mm", -10.0, 10.0)
    framing_depth_m: Sampled = quantity(fixed(0.0), "mm", -10.0, 10.0)
    gap_m: Sampled | None = quantity(None, "mm", 0.0, 5.0)
    tilt_rad: Sampled = quantity(fixed(0.0), "deg", -45.0, 45.0)
    direction_rad: Sampled = quantity(fixed(0.0), "deg", -180.0, 180.0)
    group: tuple[DatasetGroup, ...] = PAPER_GROUPS

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.group:
            raise StudyError("group: give at least one [[dataset.group]]")


@dataclass(frozen=True)
class Study:
    """Everything that a run depends on; without arguments, the paper's.

    >>> import scleraforce as sf
    >>> study = sf.Study()
    >>> study.eye.youngs_modulus_pa, study.classes.bounds_n
    (250000.0, (0.005, 0.03))
    """

    eye: EyeStudy = field(default_factory=EyeStudy)
    mesh: MeshStudy = field(default_factory=MeshStudy)
    needle: NeedleStudy = field(default_factory=NeedleStudy)
    oct: OctStudy = field(default_factory=OctStudy)
    slice: SliceStudy = field(default_factory=SliceStudy)
    classes: ClassesStudy = field(default_factory=ClassesStudy)
    calibration: CalibrationStudy = field(default_factory=CalibrationStudy)
    dataset: DatasetStudy = field(default_factory=DatasetStudy)
    network: NetworkStudy = field(default_factory=NetworkStudy)
    phantom: PhantomStudy = field(default_factory=PhantomStudy)
    library: LibraryStudy = field(default_factory=LibraryStudy)
    reader: ReaderStudy = field(default_factory=ReaderStudy)
    form: FormStudy = field(default_factory=FormStudy)
    mechanics: MechanicsStudy = field(default_factory=MechanicsStudy)
    tissue: TissueStudy = field(default_factory=TissueStudy)
    globe: GlobeStudy = field(default_factory=GlobeStudy)
    supports: SupportsStudy = field(default_factory=SupportsStudy)
    scenes: ScenesStudy = field(default_factory=ScenesStudy)
    wall_finder: WallFinderStudy = field(default_factory=WallFinderStudy)
    raw_reader: RawReaderStudy = field(default_factory=RawReaderStudy)
