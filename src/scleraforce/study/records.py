"""The study: everything that a run depends on, in one typed record. All values are SI.

The defaults are the paper's study; `paper.toml` beside this file is the same, commented (a test compares them).
"""

from dataclasses import dataclass, field

from scleraforce.errors import StudyError
from scleraforce.study.fields import check_fields, option, quantity
from scleraforce.study.form import FormStudy
from scleraforce.study.globe import GlobeStudy
from scleraforce.study.library import LibraryStudy
from scleraforce.study.mechanics import MechanicsStudy
from scleraforce.study.phantom import PhantomStudy
from scleraforce.study.raw_reader import RawReaderStudy
from scleraforce.study.reader import ReaderStudy
from scleraforce.study.sampled import Choice, Range, Sampled, fixed
from scleraforce.study.scenes import ScenesStudy
from scleraforce.study.supports import SupportsStudy
from scleraforce.study.tissue import TissueStudy
from scleraforce.study.wall_finder import WallFinderStudy
from scleraforce.units import to_si


@dataclass(frozen=True, kw_only=True)
class EyeStudy:
    """The half-sphere and its material (paper sec. 2.1, 2.2)."""

    radius_m: float = quantity(12.0, "mm", 5.0, 30.0)
    poisson_ratio: float = quantity(0.45, None, 0.0, 0.499)
    density_kg_m3: float = quantity(1100.0, None, 0.0, 5000.0)
    iop_pa: float = quantity(2.0, "mmhg", 0.0, 80.0)
    thickness_m: Sampled = quantity(Choice((400.0, 500.0, 600.0, 700.0, 800.0)), "um", 300.0, 1200.0)
    youngs_modulus_pa: float = quantity(0.25, "mpa", 0.001, 100.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class MeshStudy:
    """The finite-element mesh: quads on the sphere, extruded inward.

    "hexahedra": Catmull-Clark subdivision of a half cube, `divisions` and `level`. "graded": small elements at the
    contact, `core` quads along the side of a square there and `rings` around it; finite strain always uses it.
    """

    kind: str = option("hexahedra", "hexahedra", "graded")
    divisions: int = quantity(10, None, 2, 200)
    level: int = quantity(1, None, 0, 6)
    core: int = quantity(6, None, 2, 40)
    rings: int = quantity(14, None, 1, 200)
    layers: int = quantity(1, None, 1, 20)
    order: int = quantity(2, None, 1, 2)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.divisions % 2:
            raise StudyError(f"divisions: {self.divisions} is odd; a half cube needs an even number per edge")
        if self.core % 2:
            raise StudyError(f"core: {self.core} is odd; the square under the needle needs an even number per side")


@dataclass(frozen=True, kw_only=True)
class NeedleStudy:
    """The needle and where it pushes (22G: 0.7 mm).

    `tilt_rad`: angle of its force against the inward normal of the contact, in finite strain; the force then has a part
    along the wall, `tilt_direction_rad` from the meridian (0: away from the pole) towards growing azimuth.
    """

    outer_diameter_m: float = quantity(0.7, "mm", 0.1, 5.0)
    gap_m: float = quantity(0.5, "mm", 0.0, 5.0)
    polar_angle_rad: Sampled = quantity(Range(min=25.0, max=45.0), "deg", 0.0, 80.0)
    max_force_n: float = quantity(60.0, "mn", 1.0, 1000.0)
    tilt_rad: float = quantity(0.0, "deg", 0.0, 30.0)
    tilt_direction_rad: float = quantity(0.0, "deg", -360.0, 360.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class OctStudy:
    """The scanner's raw frame (paper sec. 3.1). `refractive_index` 1: depth is corrected already."""

    width_m: float = quantity(15.0, "mm", 0.1, 50.0)
    depth_m: float = quantity(4.0, "mm", 0.1, 50.0)
    columns: int = quantity(512, None, 32, 8192)
    rows: int = quantity(512, None, 32, 8192)
    bits: int = quantity(12, None, 8, 16)
    refractive_index: float = quantity(1.0, None, 1.0, 2.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class SliceStudy:
    """The binary slice. `margin_m`: depth of the unloaded wall's top below row 0."""

    columns: int = quantity(140, None, 8, 4096)
    rows: int = quantity(40, None, 8, 4096)
    pixel_m: float = quantity(0.1, "mm", 0.001, 1.0)
    margin_m: float = quantity(0.3, "mm", 0.0, 10.0)

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class ClassesStudy:
    """Bounds of the force classes: class k lies between bounds k-1 and k; a bound belongs to the class above 0.

    A force of exactly the last bound is still the class below it (class 1: from 5 to 30 mN; class 2: above 30 mN).
    """

    bounds_n: tuple[float, ...] = quantity((5.0, 30.0), "mn", 0.0, 1000.0)

    def __post_init__(self) -> None:
        check_fields(self)
        if len(self.bounds_n) != 2 or not self.bounds_n[0] < self.bounds_n[1]:
            raise StudyError("bounds_mn: give two increasing forces, like [5.0, 30.0]")

    def classify(self, force_n: float) -> int:
        """Return the class of a force: 0 below the first bound, 2 above the second, else 1."""
        low, high = self.bounds_n
        return 0 if force_n < low else 2 if force_n > high else 1


@dataclass(frozen=True, kw_only=True)
class CalibrationStudy:
    """The reduced-order unscented Kalman filter (paper sec. 2.2, 3.2); `docs/calibration.md` explains each value."""

    prior_mean_pa: float = quantity(0.49, "mpa", 0.001, 100.0)
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

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class DatasetGroup:
    """A part of the data set with one wall thickness."""

    thickness_m: float = quantity(500.0, "um", 300.0, 1200.0)
    images: int = quantity(4000, None, 1, 10_000_000)
    max_force_n: float = quantity(60.0, "mn", 0.1, 1000.0)

    def __post_init__(self) -> None:
        check_fields(self)


PAPER_GROUPS = (
    DatasetGroup(thickness_m=400e-6, images=3200, max_force_n=45e-3),
    *(DatasetGroup(thickness_m=to_si(t, "um"), images=4000, max_force_n=60e-3) for t in (500.0, 600.0, 700.0, 800.0)),
)


@dataclass(frozen=True)
class DatasetStudy:
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
        check_fields(self)
        if not self.group:
            raise StudyError("group: give at least one [[dataset.group]]")


@dataclass(frozen=True, kw_only=True)
class NetworkStudy:
    """The classifier and its training (paper sec. 2.4). `dropout` is the fraction dropped.

    `dropout_masks` are drawn for each sample of a step, and their losses averaged. `mirror` shows half of the samples
    with left and right exchanged: the same B-scan plane, seen from behind. `warmup` is the share of all steps over
    which the rate rises; gradients longer than `max_gradient_norm` are scaled.
    `search_widths` and `search_depths` span the grid of `train --search`: units in a hidden layer, and hidden layers.
    """

    hidden: tuple[int, ...] = quantity((600, 600), None, 1, 100_000)
    dropout: float = quantity(0.8, None, 0.0, 0.99)
    dropout_masks: int = quantity(4, None, 1, 64)
    mirror: bool = True
    learning_rate: float = quantity(0.05, None, 1e-8, 10.0)
    momentum: float = quantity(0.9, None, 0.0, 0.9999)
    warmup: float = quantity(0.1, None, 0.0, 0.9)
    max_gradient_norm: float = quantity(1.0, None, 1e-6, 1e6)
    batch_size: int = quantity(128, None, 1, 100_000)
    epochs: int = quantity(10, None, 1, 100_000)
    seed: int = quantity(0, None, 0, 2**31 - 1)
    search_widths: tuple[int, ...] = quantity((150, 300, 600, 1200), None, 1, 100_000)
    search_depths: tuple[int, ...] = quantity((1, 2, 3), None, 1, 20)

    def __post_init__(self) -> None:
        check_fields(self)
        if not (self.search_widths and self.search_depths):
            key = "search_depths" if self.search_widths else "search_widths"
            raise StudyError(f"{key}: an empty list; give at least one value")


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
