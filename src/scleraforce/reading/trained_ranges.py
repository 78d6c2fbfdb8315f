"""The ranges that a model was trained on, and where an eye and its B-scans lie outside:
known before a frame is read.

Every range is that of the model's study. A reader refuses an eye outside its training
(`outside_training`); the remarks on a recording have the same sentences, and others on
the frames, the needle and the scan.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import exp, hypot, inf, sqrt
from pathlib import Path

from scleraforce.base.units import HumanUnit, from_si
from scleraforce.fit import unknowns
from scleraforce.fit.prior_of_an_eye import FREE_SD, LIBRARY_RADIUS_M
from scleraforce.reading.frame_checks import (
    DEVIATION_SD,
    LEAST_FRAME_M,
    least_wall_m,
    read_by_fit,
    wall_seen,
)
from scleraforce.records.eye import (
    OWN_SOURCES,
    Modulus,
    open_doubts,
)
from scleraforce.records.globe import UNKNOWN
from scleraforce.records.model_folder import folder_study, model_name, read_folder
from scleraforce.records.needle import nearest_gauge
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.records.study import (
    Choice,
    LibraryStudy,
    Range,
    ReaderStudy,
    Sampled,
    Study,
)

# kinds of models that read forces
CLASSIFIER, READER, RAW_READER = KINDS = (
    "classifier",
    "reader",
    "raw-reader",
)
SAME_INDEX = 1e-3  # of refractive indices
MODULUS, PRESSURE, WALL, GAP = EYE = (
    "Young's modulus",
    "IOP",
    "wall thickness",
    "gap between B-scan and needle axis",
)


RADIUS = "radius of the globe"
SIZE_REACH = DEVIATION_SD * FREE_SD[unknowns.SIZE]  # of a radius that a fit may find
# coarsest pixel that forces are read from; walls are found in coarser ones
COARSEST_M = 30e-6


@dataclass(frozen=True)
class _Compared:
    """A value (None: unknown) of a field of a record, and the range that a model was
    trained on, SI, with the unit that both are printed in.
    """

    name: str
    field: str
    value: float | None
    trained: Sampled
    unit: HumanUnit
    printed: str

    @property
    def covered(self) -> str:
        """The range in words."""
        low, high = (from_si(bound, self.unit) for bound in self.trained.bounds)
        if high == inf:
            return f"{low:.4g} {self.printed} or more"

        return (
            f"{low:.4g} {self.printed}"
            if low == high
            else f"{low:.4g} to {high:.4g} {self.printed}"
        )

    @property
    def outside(self) -> Remark | None:
        """A remark if the value is outside, in the printed unit to four digits; None
        if it is inside or unknown.
        """
        if self.value is None:
            return None

        low, high = (from_si(bound, self.unit) for bound in self.trained.bounds)
        found = from_si(self.value, self.unit)
        slack = 1e-4 * max(abs(low), abs(high), 1.0)
        if low - slack <= found <= high + slack:
            return None

        return _outside(
            f"{self.name} {found:.4g} {self.printed}, the model was trained on"
            f" {self.covered}",
            self.field,
        )


def _outside(words: str, *fields: str) -> Remark:
    return Remark("outside-training", words, fields)


def outside_training(
    setup: Setup,
    trained: ReaderStudy,
    library: LibraryStudy,
    library_radius_m: float = LIBRARY_RADIUS_M,
) -> str | None:
    """Return why a model cannot read an eye: a known value lies outside the training;
    None: all lie inside.

    A value that is not a number is outside. A modulus of the eye's own may lie outside
    by its uncertainty: its standard deviation, and the error that it takes from
    thickness and IOP, which the training's moduli have too.
    """
    refused = _refusals(setup, trained, library, library_radius_m)
    return refused[0].words if refused else None


def limit_remarks(model: Path, info: RecordingInfo) -> tuple[Remark, ...]:
    """Return a remark for each value of a recording outside a model's training; raises
    `ModelError`.
    """
    folder = read_folder(model, KINDS)
    name = model_name(folder.path)
    eye = info.setup
    scan = info.scan
    gauge = info.needle.gauge
    found = untrained_values(
        folder.record["kind"], folder_study(folder), eye, scan, gauge
    )

    return tuple(
        replace(remark, words=f"outside the range of {name}: {remark.words}")
        for remark in found
    )


def reading_ranges(model: Path) -> tuple[tuple[str, str], ...]:
    """Return name and range in words of each quantity of a model's study; () for a wall
    finder; raises `ModelError`.
    """
    folder = read_folder(model)
    kind = folder.record["kind"]
    if kind not in KINDS:
        return ()

    study = folder_study(folder)
    window = study.slice
    radius_m = _largest_radius_m(study)
    least_m = least_wall_m(study.slice)
    width = f"{from_si(least_m, 'mm'):.4g} mm or more"

    if kind == READER:
        width = (
            f"{from_si(LEAST_FRAME_M, 'mm'):.4g} mm or more; {width} without a"
            " calibration, and for the monitor"
        )

    # of the surface over that width
    curve_mm = from_si(radius_m - sqrt(radius_m**2 - (least_m / 2) ** 2), "mm")
    depth = (
        f"{curve_mm:.1f} mm or more, for deep dents"
        f" {from_si(window.rows * window.pixel_m, 'mm'):.4g} mm"
    )
    frames = (("width of the frames", width), ("depth of the frames", depth))
    compared = (_of_slices if kind == CLASSIFIER else _of_walls)(
        study, NOTHING_KNOWN, None
    )

    return (
        *frames,
        *((entry.name, entry.covered) for entry in compared),
        ("needle", _needle_words(study)),
    )


def untrained_values(
    kind: str, study: Study, setup: Setup, scan: Scan, gauge: int | None = None
) -> tuple[Remark, ...]:
    """Return a remark for each known value that the training of a kind of model did
    not cover.

    A reader was trained on its library's walls, wherever on the eye the needle pushes;
    a classifier on its data set, without sealed globes.
    """
    if kind == CLASSIFIER:
        sealed = (
            Remark("inputs-ignored", words, ("globe",))
            for words in open_doubts(setup.eye.globe)
        )
        compared = _remarks(_of_slices(study, setup, scan))
        return (
            *_unseen(study, scan, kind),
            *sealed,
            *compared,
            *other_needle(study, gauge),
        )

    refused = _refusals(
        setup, read_by_fit(study.reader), study.library, study.eye.radius_m
    )
    others = _remarks(
        entry for entry in _of_walls(study, setup, scan) if entry.name not in EYE
    )
    index = (
        other_index(study, scan.refractive_index or 1.0) if kind == RAW_READER else None
    )

    return (
        *_unseen(study, scan, kind),
        *refused,
        *others,
        *other_needle(study, gauge),
        *([_outside(index, "refractive_index")] if index else ()),
    )


def _radius(radius_m: float | None, library_radius_m: float) -> _Compared:
    radii = Range(
        min=library_radius_m * exp(-SIZE_REACH), max=library_radius_m * exp(SIZE_REACH)
    )
    return _Compared(RADIUS, "radius_m", radius_m, radii, "mm", "mm")


def radius_fault(radius_m: float | None, library_radius_m: float) -> str | None:
    """Return why no fit reaches a declared radius; None: one may."""
    outside = _radius(radius_m, library_radius_m).outside
    return None if outside is None else outside.words


def other_index(study: Study, refractive_index: float) -> str | None:
    """Return why a network that sees below the surface cannot read frames of an index;
    None: it can.
    """
    trained = study.oct.refractive_index
    if abs(refractive_index - trained) <= SAME_INDEX:
        return None
    return (
        f"refractive index {refractive_index:g} of the frame, the model was trained"
        f" with {trained:g}"
    )


def _of_eye(setup: Setup, trained: ReaderStudy) -> tuple[_Compared, ...]:
    return (
        _Compared(
            MODULUS,
            "modulus",
            _uncovered_modulus(setup.eye.modulus, trained),
            trained.youngs_modulus_pa,
            "mpa",
            "MPa",
        ),
        _Compared(PRESSURE, "iop_pa", setup.eye.iop_pa, trained.iop_pa, "mmhg", "mmHg"),
        _Compared(
            WALL, "thickness_m", setup.eye.thickness_m, trained.thickness_m, "um", "µm"
        ),
        _Compared(GAP, "gap_m", setup.needle.gap_m, trained.gap_m, "mm", "mm"),
    )


def _of_walls(study: Study, setup: Setup, scan: Scan | None) -> tuple[_Compared, ...]:
    """Return the ranges of a reader's training: of the eye, of the plane, and of the
    scale of its frames.
    """
    trained = read_by_fit(study.reader)
    rigidity = (
        setup.eye.globe.mean
        if setup.eye.globe and setup.eye.globe.can_be_sealed
        else None
    )
    rigidities = Range(min=UNKNOWN.lowest, max=UNKNOWN.highest)
    return (
        *_of_eye(setup, trained),
        _Compared(
            "rigidity of a sealed globe",
            "globe",
            rigidity,
            rigidities,
            "mmhg13_per_ul",
            "mmHg^(1/3)/µl",
        ),
        _Compared(
            "tilt of the B-scan",
            "tilt_rad",
            scan.tilt_rad if scan else None,
            trained.tilt_rad,
            "deg",
            "°",
        ),
        _pixel(study, scan),
    )


def _of_slices(study: Study, setup: Setup, scan: Scan | None) -> tuple[_Compared, ...]:
    """Return the ranges of a classifier's data set."""
    gap = study.dataset.gap_m or Choice((study.needle.gap_m,))
    thickness = Choice(tuple(group.thickness_m for group in study.dataset.group))
    direction_rad = scan.direction_rad if scan else None
    return (
        _Compared(GAP, "gap_m", setup.needle.gap_m, gap, "mm", "mm"),
        _Compared(WALL, "thickness_m", setup.eye.thickness_m, thickness, "um", "µm"),
        _Compared(
            "polar angle",
            "polar_rad",
            setup.needle.polar_rad,
            study.needle.polar_angle_rad,
            "deg",
            "°",
        ),
        _Compared(
            "tilt of the B-scan",
            "tilt_rad",
            scan.tilt_rad if scan else None,
            study.dataset.tilt_rad,
            "deg",
            "°",
        ),
        _Compared(
            "direction of the B-scan",
            "direction_rad",
            direction_rad,
            study.dataset.direction_rad,
            "deg",
            "°",
        ),
        _pixel(study, scan),
    )


def _pixel(study: Study, scan: Scan | None) -> _Compared:
    """Return the scale, compared with that of the scenes that the wall finder was
    trained on.
    """
    pixel_m = scan.scale.depth_m if scan else None
    drawn = study.scenes.window.pixel_m.bounds
    return _Compared(
        "depth of a pixel",
        "depth_m",
        pixel_m,
        Range(min=drawn[0], max=min(drawn[1], COARSEST_M)),
        "um",
        "µm",
    )


def _refusals(
    setup: Setup,
    trained: ReaderStudy,
    library: LibraryStudy,
    library_radius_m: float,
) -> tuple[Remark, ...]:
    radius = _radius(setup.eye.radius_m, library_radius_m)
    reasons = _remarks((*_of_eye(setup, trained), radius))
    softest, stiffest = library.stiffening_ends
    stiffening = setup.eye.stiffening or 0.0
    if softest <= stiffening <= stiffest:
        return reasons

    tissue = _outside(
        f"stiffening {stiffening:.4g} of the tissue, the model was trained on"
        f" {softest:g} to {stiffest:g}",
        "stiffening",
    )
    return (*reasons, tissue)


def _uncovered_modulus(modulus: Modulus | None, trained: ReaderStudy) -> float | None:
    """Return a modulus, Pa, to compare with the training's range; None if it is an
    eye's own and near enough.

    At a given dent F goes as E t^2 IOP^(1/3) (`lab.training.reader_samples`), so a
    calibrated E takes twice the error of the thickness and a third of the pressure's.
    """
    if modulus is None:
        return None

    low, high = trained.youngs_modulus_pa.bounds
    carried = hypot(
        2.0 * trained.thickness_noise_fraction, trained.iop_noise_fraction / 3.0
    )
    reach = (
        hypot(modulus.relative_sd, carried) if modulus.source in OWN_SOURCES else 0.0
    )

    return (
        None
        if low * (1.0 - reach) <= modulus.mean_pa <= high * (1.0 + reach)
        else modulus.mean_pa
    )


def covers_modulus(
    setup: Setup, trained: ReaderStudy, any_pressure: bool = False
) -> bool:
    """Return whether a model was trained on an eye's modulus, at its pressure."""
    low_pa, high_pa = trained.iop_pa.bounds
    other = setup.eye.iop_pa is not None and not low_pa <= setup.eye.iop_pa <= high_pa
    if other and not any_pressure:
        return False
    return _uncovered_modulus(setup.eye.modulus, trained) is None


def _remarks(compared: Iterable[_Compared]) -> tuple[Remark, ...]:
    return tuple(remark for entry in compared if (remark := entry.outside))


def _unseen(study: Study, scan: Scan, kind: str) -> tuple[Remark, ...]:
    """Return why frames show too little of a wall: they are too narrow, or less deep
    than its curve or its dents.

    Of a sphere of radius R that touches the top edge, a frame of depth d shows 2
    sqrt(R^2 - (R - d)^2).
    """
    radius_m = _largest_radius_m(study)
    _, columns = scan.shape
    width_m, depth_m = scan.extent_m
    left_m = max(radius_m - depth_m, 0.0)
    between_columns_m = width_m * (1.0 - 1.0 / columns)
    window = study.slice
    most_m = min(
        between_columns_m,
        window.columns * window.pixel_m,
        2.0 * sqrt(radius_m**2 - left_m**2),
    )
    width_mm = from_si(width_m, "mm")
    depth_mm = from_si(depth_m, "mm")
    frames = f"frames of {width_mm:.4g} x {depth_mm:.4g} mm: at most"

    if short := wall_seen(
        most_m, least_wall_m(window, width_m if kind == READER else inf)
    ):
        return (_outside(f"{frames} {short}", "width_m", "depth_m"),)

    narrow = wall_seen(
        most_m,
        least_wall_m(window),
        "are needed without a calibration, and by the monitor",
    )
    found = [_outside(f"{frames} {narrow}", "width_m", "depth_m")] if narrow else []

    needed_mm = from_si(window.rows * window.pixel_m, "mm")
    if depth_mm < needed_mm:
        words = (
            f"frames {depth_mm:.4g} mm deep: deep dents leave them, the model reads"
            f" {needed_mm:.4g} mm"
        )
        found.append(_outside(words, "depth_m"))

    return tuple(found)


def _largest_radius_m(study: Study) -> float:
    return study.eye.radius_m * study.reader.size.bounds[1]


def other_needle(study: Study, gauge: int | None) -> tuple[Remark, ...]:
    """Return a remark on a needle of another gauge than the model's, whose dent has
    another form.
    """
    if gauge is None or gauge == nearest_gauge(study.needle.outer_diameter_m):
        return ()
    words = f"needle of {gauge} gauge, the model was trained on {_needle_words(study)}"
    return (_outside(words, "diameter_m"),)


def _needle_words(study: Study) -> str:
    diameter_m = study.needle.outer_diameter_m
    return f"{nearest_gauge(diameter_m)} gauge ({from_si(diameter_m, 'mm'):.4g} mm)"
