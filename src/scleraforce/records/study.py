"""The study: one typed record of everything that a run depends on, all values SI, read
from TOML and written as TOML.

The defaults are the paper's (`paper.toml` is the same, commented). In a file, an
unknown key, a wrong type or a value out of bounds is an error with its line.
"""

import dataclasses  # whose `fields` would be hidden by the module of that name here
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

from scleraforce.base.errors import StudyError
from scleraforce.base.units import to_si
from scleraforce.base.whole_files import KINDS, read_text
from scleraforce.records.decoder import format_record, format_section, parse_record
from scleraforce.records.eye import Modulus
from scleraforce.records.fields import (
    Choice as Choice,
    Range as Range,
    Sampled as Sampled,
    StudySection,
    allowed_bounds,
    draw as draw,
    field_key,
    fixed as fixed,
    option,
    quantity,
)
from scleraforce.records.study_of_eye import (
    EyeStudy as EyeStudy,
    FormStudy as FormStudy,
    GlobeStudy as GlobeStudy,
    MechanicsStudy as MechanicsStudy,
    MeshStudy as MeshStudy,
    NeedleStudy as NeedleStudy,
    SupportsStudy as SupportsStudy,
    TissueStudy as TissueStudy,
)
from scleraforce.records.study_of_images import (
    OctStudy as OctStudy,
    PhantomStudy as PhantomStudy,
    SceneEyeStudy as SceneEyeStudy,
    SceneOverStudy as SceneOverStudy,
    SceneScannerStudy as SceneScannerStudy,
    ScenesStudy as ScenesStudy,
    SceneTissueStudy as SceneTissueStudy,
    SceneWindowStudy as SceneWindowStudy,
    SliceStudy as SliceStudy,
)
from scleraforce.records.study_of_networks import (
    NetworkStudy as NetworkStudy,
    RawReaderStudy as RawReaderStudy,
    ReaderStudy as ReaderStudy,
    WallFinderStudy as WallFinderStudy,
)


@dataclass(frozen=True)
class ClassesStudy(StudySection):
    """Bounds of the force classes: class k lies between bounds k-1 and k; a bound
    belongs to the class above 0.

    A force of exactly the last bound is still the class below it (class 1: from 5 to 30
    mN; class 2: above 30 mN).
    """

    bounds_n: tuple[float, ...] = quantity((5.0, 30.0), "mn", 0.0, 1000.0)

    def _check(self) -> None:
        if len(self.bounds_n) != 2 or not self.bounds_n[0] < self.bounds_n[1]:
            raise StudyError("bounds_mn: give two increasing forces, like [5.0, 30.0]")

    def classify(self, force_n: float) -> int:
        """Return the class of a force: 0 below the first bound, 2 above the second,
        else 1.
        """
        low, high = self.bounds_n
        return 0 if force_n < low else 2 if force_n > high else 1


@dataclass(frozen=True, kw_only=True)
class CalibrationStudy(StudySection):
    """The prior of E, which frames count, and the paper's filter (sec. 2.2, 3.2);
    `docs/calibration.md` explains each value, and who uses it.
    """

    prior_mean_pa: float = quantity(
        0.49,
        "mpa",
        allowed_bounds("youngs_modulus").low,
        allowed_bounds("youngs_modulus").high,
    )
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

    def prior(self, source: str = "population") -> Modulus:
        """Return the prior of E, by default as the modulus of other eyes."""
        return Modulus(
            mean_pa=self.prior_mean_pa, sd_pa=self.prior_sd_pa, source=source
        )


LEAST_STIFFENINGS = 4  # that cubic splines run through


@dataclass(frozen=True, kw_only=True)
class LibraryStudy(StudySection):
    """Ranges of the library and the density of its grid; `docs/library.md` states the
    error of the interpolation.

    Thicknesses, and tensions p R/(E t) at their low part, are evenly spaced in their
    logarithm; tensions are denser towards the one at which the wall bursts (0.416 with
    a Poisson's ratio of 0.45), as sealed eyes rise far above their pressure at rest.
    `max_force_ratio_m2` is the largest F/E. `elements` and `layers` divide the wall's
    meridian.
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

    def _check(self) -> None:
        for key, bounds in (
            ("thickness_um", self.thickness_m.bounds),
            ("tension", self.tension.bounds),
        ):
            if bounds[0] == bounds[1]:
                raise StudyError(
                    f"{key}: a range has to be given, like {{ min = ..., max = ... }}"
                )

        low, high = self.stiffening.bounds
        if self.stiffenings > 1 and low == high:
            raise StudyError(
                "stiffening: a range has to be given, like { min = ..., max = ... }; or"
                " stiffenings = 1"
            )
        if 1 < self.stiffenings < LEAST_STIFFENINGS:
            raise StudyError(
                f"stiffenings: {self.stiffenings}; give 1, or at least"
                f" {LEAST_STIFFENINGS}"
            )


@dataclass(frozen=True, kw_only=True)
class DatasetGroup(StudySection):
    """A part of the data set with one wall thickness."""

    thickness_m: float = quantity(500.0, "um", 300.0, 1200.0)
    images: int = quantity(4000, None, 1, 10_000_000)
    max_force_n: float = quantity(60.0, "mn", 0.1, 1000.0)


PAPER_GROUPS = (
    DatasetGroup(thickness_m=400e-6, images=3200, max_force_n=45e-3),
    *(
        DatasetGroup(thickness_m=to_si(t, "um"), images=4000, max_force_n=60e-3)
        for t in (500.0, 600.0, 700.0, 800.0)
    ),
)


@dataclass(frozen=True)
class DatasetStudy(StudySection):
    """The simulated slices (paper sec. 2.3, 3.3). `framing_*` shifts the window, `gap`
    overrides the needle's.
    """

    seed: int = quantity(0, None, 0, 2**31 - 1)
    contacts: int = quantity(200, None, 2, 100_000)
    validation_fraction: float = quantity(0.1, None, 0.01, 0.9)
    framing_lateral_m: Sampled = quantity(fixed(0.0), "mm", -10.0, 10.0)
    framing_depth_m: Sampled = quantity(fixed(0.0), "mm", -10.0, 10.0)
    gap_m: Sampled | None = quantity(None, "mm", 0.0, 5.0)
    tilt_rad: Sampled = quantity(fixed(0.0), "deg", -45.0, 45.0)
    direction_rad: Sampled = quantity(fixed(0.0), "deg", -180.0, 180.0)
    group: tuple[DatasetGroup, ...] = PAPER_GROUPS

    def _check(self) -> None:
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

    def __repr__(self) -> str:
        return f"<Study {study_hash(self)[:12]}: its sections are its attributes>"


# Studies to begin from, by name: their files beside this one. The first is the default,
# the paper's.
PRESET_FILES = {"ex-vivo": "paper.toml", "living": "living.toml"}
PRESETS = tuple(PRESET_FILES)
# in a preset: stands for all of its keys, which are explained in `study_of_images`
SCENES_TABLE = "[scenes]"


def preset_toml(name: str) -> str:
    """Return the text of a preset.

    >>> parse_study(preset_toml("living")).eye.youngs_modulus_pa
    1800000.0
    """
    text = (
        files("scleraforce.records")
        .joinpath(PRESET_FILES[name])
        .read_text(encoding="utf-8")
    )
    return text.replace(
        SCENES_TABLE, format_section("scenes", ScenesStudy(), noted=True)
    )


def read_study(path: str | PathLike[str]) -> Study:
    """Read a study file.

    Raises:
        StudyError: the file is missing or not TOML, or a key or value in it cannot be
            used.

    >>> import scleraforce as sf
    >>> sf.read_study("study.toml").eye.radius_m
    0.012
    """
    return parse_study(read_text(Path(path), KINDS["study"]), str(path))


def parse_study(text: str, name: str = "study") -> Study:
    r"""Read a study from TOML text; `name` is for messages.

    >>> import scleraforce as sf
    >>> sf.parse_study('[eye]\nradius_mm = 11.0').eye.radius_m
    0.011

    Raises:
        StudyError: naming the file, the line and the key.
    """
    return parse_record(Study, text, name)


def format_study(study: Study) -> str:
    """Write a study as TOML that `parse_study` reads back to an equal record."""
    return format_record(study)


def study_hash(study: Study) -> str:
    """Return the SHA-256 of a study's canonical TOML, in hexadecimal."""
    return hashlib.sha256(format_study(study).encode()).hexdigest()


# Keys that would change the eye of a command if its mechanics knew them: it refuses
# them.
LEAK = ("globe.leak_time_s",)  # of a globe in time
FINITE_STRAIN_ONLY = (
    "form.semi_axes",
    "form.wave",
    "form.region",
    "form.cornea",
    "needle.tilt_deg",
    "needle.tilt_direction_deg",
    "mechanics.follower",
    "tissue.stiffening",
    "tissue.softer_through",
    "tissue.stiffer_around",
    "globe.kind",
    "globe.rigidity_mmhg13_per_ul",
    "globe.rigidity_law",
    *LEAK,
)
SUPPORTS = tuple(
    f"supports.{field_key(item)}" for item in dataclasses.fields(SupportsStudy)
)
EYE_MOVEMENT = ("phantom.eye_drift_deg", "phantom.eye_saccade_deg")
# walls that serve many contacts: even, clamped at the base
SHARED_WALL = (
    *FINITE_STRAIN_ONLY,
    *SUPPORTS,
)
# walls of revolution about the needle, without weight
LIBRARY = (
    *SHARED_WALL,
    "eye.density_kg_m3",
)

# of the paper's filter, which has linear mechanics
FILTER = tuple(
    f"calibration.{key}"
    for key in (
        "points",
        "span_mm",
        "sigma_points",
        "positive",
        "iterations",
        "gate_sd",
        "shift_sd_mm",
        "turn_sd_deg",
        "inner_sd_mm",
        "model_error_percent",
    )
)

# Command, and mechanics where it has a choice: the keys that it does not use.
# Relaxation is `phantom`'s: elsewhere a force makes its dent at once, or the log shows
# how it falls; only `reproduce` refuses it.
UNUSED: dict[tuple[str, str | None], tuple[str, ...]] = {
    ("simulate", "linear"): FINITE_STRAIN_ONLY,
    ("simulate", "finite-strain"): LEAK,
    ("phantom", "linear"): FINITE_STRAIN_ONLY,
    ("phantom", "finite-strain"): (),
    ("generate", "linear"): SHARED_WALL,
    ("generate", "finite-strain"): LIBRARY,
    ("calibrate", "linear"): SHARED_WALL,
    ("calibrate", "finite-strain"): (
        *(key for key in LIBRARY if key != "tissue.stiffening"),
        *FILTER,
    ),
    ("library", None): LIBRARY,
    ("train kind=reader", None): LIBRARY,
    ("train kind=raw-reader", None): (
        *LIBRARY,
        *EYE_MOVEMENT,
        "phantom.needle_count",
    ),
    ("reproduce", None): (*SHARED_WALL, "tissue.relaxation", *EYE_MOVEMENT),
}

# Why a key is not used, where its name does not tell.
REASONS = {
    "tissue.stiffening": (
        "linear mechanics knows no tissue that stiffens, and a library has a range of"
        " it, [library]"
    )
}


def refuse_unused(study: Study, command: str, mechanics: str | None = None) -> None:
    """Refuse a study that sets a key which a command does not use, or which another key
    switches off.
    """
    changed = set(_changed(study))
    if found := [key for key in UNUSED[command, mechanics] if key in changed]:
        wall = f" with {mechanics} mechanics" if mechanics else ""
        wall += "".join(
            f" ({reason})" for key, reason in REASONS.items() if key in found
        )
        remedy = f"leave {'it' if len(found) == 1 else 'them'} out"
        others = [
            kind
            for name, kind in UNUSED
            if name == command and kind and not {*found} & {*UNUSED[name, kind]}
        ]
        remedy += f", or give `mechanics={others[0]}`" if others else ""
        raise StudyError(
            f"study: {', '.join(found)}: not used by `{command}`{wall}; {remedy}"
        )

    for key, cause, remedy in _switched_off(study):
        if key in changed:
            raise StudyError(
                f"study: {key}: has no effect with {cause}; leave it out, or give"
                f" {remedy}"
            )


def _changed(study: Study) -> Iterator[str]:
    defaults = Study()
    for section in dataclasses.fields(study):
        record: Any = getattr(study, section.name)
        default = getattr(defaults, section.name)
        for item in dataclasses.fields(record):
            if getattr(record, item.name) != getattr(default, item.name):
                yield f"{section.name}.{field_key(item)}"


def _switched_off(study: Study) -> Iterator[tuple[str, str, str]]:
    supports = study.supports
    _, *bed, strap, azimuth = SUPPORTS
    parts = {
        "bed": (supports.has_bed, bed),
        "straps": (supports.has_straps, (strap, azimuth)),
    }

    for part, (there, keys) in parts.items():
        for key in () if there else keys:
            yield (
                key,
                f'supports.kind = "{supports.kind}"',
                f'"{part}" or "bed-and-straps"',
            )

    if study.needle.tilt_rad == 0.0:
        yield "needle.tilt_direction_deg", "needle.tilt_deg = 0", "a tilt"
    if study.globe.kind == "open":
        for key in ("globe.rigidity_mmhg13_per_ul", "globe.rigidity_law", *LEAK):
            yield key, 'globe.kind = "open"', '"sealed"'
