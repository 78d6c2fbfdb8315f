"""Verdicts on a frame: the wall of an eye, a dent that leaves the window, enough of the
wall to read or calibrate.

An eye at rest at a wrong scale: a force counts only if no flat surface without a dent
lies nearer than the wall. A cornea or a limbus in a picture that was stretched looks
like a wall with a shallow dent, and flatter than an eye. The section of an eye without
a needle is the arc of an ellipse at any scale, or two arcs that meet at a limbus: here
of third order. A true dent does not flatten the wall beside it.
"""

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from scleraforce.base.arrays import Bytes, Floats
from scleraforce.base.units import from_si
from scleraforce.fit import unknowns
from scleraforce.fit.compiled_fit import COLUMNS, CORRELATED_M, OUTER_SD_M
from scleraforce.fit.least_squares import cauchy_weight
from scleraforce.fit.one_frame import NO_WALL_M, BoundaryFit
from scleraforce.fit.prior_of_an_eye import FREE_SD, Prior
from scleraforce.reading.answer import Answer, Reading, unusable_answer
from scleraforce.records.frame import Pixels
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, ReaderStudy, SliceStudy, Study
from scleraforce.wall.conjunctiva import second_surface_m
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.frame_light import as_logarithmic
from scleraforce.wall.needle_in_frame import SeenNeedle
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import (
    Boundaries,
    assumed_inner_row,
    boundary_slices,
)
from scleraforce.wall.wall_network import WallFinder

# Of the slice's width, from end to end, or of a narrower frame's. In frames of 5 and 7
# mm plates, cups and large balls look like dented eyes of 3 to 20 mN. The forces of a
# calibration show that there is an eye, at its true scale.
LEAST_WALL_SHARE = 0.7
LEAST_FRAME_M = 5e-3
# deep dents have steep sides, which are segmented badly: in a fit that is good
# otherwise
OUTLIERS = 0.3
# ... in one that is less good they say that it is another surface
ROUGH_M = 8e-6
ROUGH_OUTLIERS = 0.1
DEVIATION_SD = 4.0  # of thickness and size from their known values
# A layer below the wall may be taken for a part of it (the choroid); hardly anything
# makes it look thinner.
THINNER_M = 40e-6
THICKER_M = 200e-6
# Of contacts up to the edge of the training, the network placed none more than 0.15 mm
# beyond it; the fit none more than 0.09 mm where there was a dent, and 1.9 of its own
# standard deviations where there was hardly any.
CONTACT_SLACK_M = 0.25e-3
CONTACT_SD = 3.0
# A limbus, or a surface that curves more than the sides of an ellipsoid: an eye has one
# cornea, 5 mm and more across.
SIDES = ("left", "right")
CORNEA_RAD = -0.05
CORNEA_CURVATURE = 25.0
DENT_M = 1e-3  # to either side of the contact: the dent's deepest part
CALIBRATED_SPAN_M = 4e-3  # to either side of the contact
CALIBRATED_SHARE = 0.6  # of the columns there: both boundaries are seen


def fit_leaves(fit: BoundaryFit, slice_study: SliceStudy) -> bool:
    """Return True if the fitted wall leaves the slice's window at the bottom within its
    dent.
    """
    lateral_m, depth_m = fit.wall_bmc[0].T
    dent = depth_m[np.abs(lateral_m - fit.contact_m) < DENT_M]
    return bool(dent.max(initial=0.0) > slice_study.rows * slice_study.pixel_m)


def no_class(
    interval_n: tuple[float, float], bounds_n: tuple[float, ...]
) -> str | None:
    """Return a sentence if an interval reaches into every class, else None."""
    low_n, high_n = interval_n
    if low_n >= bounds_n[0] or high_n <= bounds_n[-1]:
        return None
    return (
        f"from {from_si(low_n, 'mn'):.0f} to {from_si(high_n, 'mn'):.0f} mN, every"
        " class is possible"
    )


def too_little_wall(
    lateral_m: Floats,
    outer_m: Floats,
    slice_study: SliceStudy,
    is_calibrated: bool = False,
) -> str | None:
    """Return why too little of a wall is seen to fit it, None if enough is.

    `lateral_m`: increasing places of a frame's columns from its middle; `outer_m`:
    depth there, NaN where unseen; `is_calibrated`: E is from frames of known force.
    """
    width_m = slice_study.columns * slice_study.pixel_m
    seen = lateral_m[(np.abs(lateral_m) <= width_m / 2) & np.isfinite(outer_m)]
    extent_m = float(seen[-1] - seen[0]) if len(seen) else 0.0
    frame_m = (
        float(lateral_m[-1] - lateral_m[0]) * len(lateral_m) / (len(lateral_m) - 1)
    )

    short = wall_seen(extent_m, least_wall_m(slice_study, frame_m))
    if short or is_calibrated:
        return short

    return wall_seen(
        extent_m, least_wall_m(slice_study), "are needed without a calibration"
    )


def least_wall_m(slice_study: SliceStudy, frame_m: float = inf) -> float:
    """Return the least extent of a wall, from end to end, that has to be seen in frames
    of a width.
    """
    return LEAST_WALL_SHARE * min(
        max(frame_m, LEAST_FRAME_M), slice_study.columns * slice_study.pixel_m
    )


def wall_seen(
    extent_m: float, least_m: float, needing: str = "are needed"
) -> str | None:
    """Return a sentence if too little of a wall is seen, else None."""
    if extent_m >= least_m:
        return None
    seen_mm = from_si(extent_m, "mm")
    least_mm = from_si(least_m, "mm")
    return (
        f"{seen_mm:.1f} mm of the wall are visible; at least {least_mm:.1f} mm"
        f" {needing}"
    )


def seen_by_network(extent_m: float, slice_study: SliceStudy) -> str | None:
    """Return a sentence if a network sees too little of a wall, else None: it was
    trained on wide slices.
    """
    return wall_seen(extent_m, least_wall_m(slice_study), "are needed by the network")


def contact_outside(reading: Reading, trained: ReaderStudy) -> str | None:
    """Return why a contact lies outside the framing that a model was trained on; None:
    inside, or it is not known.
    """
    low_m, high_m = trained.lateral_m.bounds
    slack_m = CONTACT_SLACK_M + CONTACT_SD * reading.contact_sd_m
    if low_m - slack_m <= reading.contact_m <= high_m + slack_m:
        return None

    covered = f"{from_si(low_m, 'mm'):.4g} to {from_si(high_m, 'mm'):.4g} mm"
    return (
        f"contact {from_si(reading.contact_m, 'mm'):.1f} mm from the frame's middle,"
        f" the model was trained on {covered}"
    )


NO_EYE = "does not look like the wall of an eye"


def no_wall_of_an_eye(fit: BoundaryFit, prior: Prior) -> str | None:
    """Return why a frame does not show a wall that the library knows; None if it does.

    Other surfaces lie far from every wall of the library, or near one that is thicker,
    thinner, larger or smaller than this eye can be.
    """
    if not fit.misfit_m <= NO_WALL_M:
        return (
            f"{NO_EYE}: {from_si(fit.misfit_m, 'um'):.0f} µm from the closest"
            " simulated one"
        )
    if not fit.outliers <= (OUTLIERS if fit.misfit_m <= ROUGH_M else ROUGH_OUTLIERS):
        return (
            f"{NO_EYE}: {fit.outliers:.0%} of the columns are far from the closest"
            " simulated one"
        )

    away = np.abs(fit.unknown - prior.mean) / prior.sd
    if not away[unknowns.SIZE] <= DEVIATION_SD:
        return (
            f"{NO_EYE}: its curvature is that of an eye"
            f" {np.exp(fit.unknown[unknowns.SIZE]):.2f} times as large"
        )

    form = dict(zip(unknowns.FORMS, fit.unknown[unknowns.FORM].tolist(), strict=True))
    if all(
        form[f"{side}_angle_rad"] < CORNEA_RAD
        or form[f"{side}_curvature"] > CORNEA_CURVATURE
        for side in SIDES
    ):
        return f"{NO_EYE}: it bends like a cornea on both sides of the contact"

    shown_m = float(
        fit.unknown[unknowns.THICKNESS] + fit.unknown[unknowns.INNER_OFFSET]
    )
    stated_m = float(prior.mean[unknowns.THICKNESS])

    slack_m = DEVIATION_SD * float(prior.sd[unknowns.THICKNESS])
    if not -THINNER_M - slack_m <= shown_m - stated_m <= THICKER_M + slack_m:
        return (
            f"the wall looks {from_si(shown_m, 'um'):.0f} µm thick, not "
            f"{from_si(stated_m, 'um'):.0f} µm as it should"
        )

    return None


SLACK_M = 0.1e-3  # of a stated gap, beyond the needle's radius


def read_by_fit(trained: ReaderStudy) -> ReaderStudy:
    """Return the ranges that the fit reads: a model's training, with gaps from 0.

    The library's walls are surfaces of revolution about the needle axis: they have a
    section at any gap.
    """
    return replace(trained, gap_m=Range(min=0.0, max=trained.gap_m.bounds[1]))


def needle_elsewhere(
    needle: SeenNeedle | None, setup: Setup, radius_m: float
) -> str | None:
    """Return why a needle in the picture contradicts the known gap; None if it does
    not.

    >>> seen = SeenNeedle(
    ...     angle_rad=0.0,
    ...     tip_m=(0.0, 1e-3),
    ...     tip=(256.0, 128.0),
    ...     top=(256.0, -0.5),
    ...     hidden=(244, 268),
    ... )
    >>> from scleraforce.records.needle import Needle
    >>> far = Setup(needle=Needle(gap_m=0.8e-3))
    >>> needle_elsewhere(seen, far, 0.35e-3).partition(": ")[0]
    'a needle is seen, although the B-scan is said to pass 0.8 mm from its axis'
    >>> needle_elsewhere(seen, Setup(needle=Needle(gap_m=0.1e-3)), 0.35e-3)
    """
    if (
        needle is None
        or setup.needle.gap_m is None
        or setup.needle.gap_m <= radius_m + SLACK_M
    ):
        return None
    return (
        "a needle is seen, although the B-scan is said to pass"
        f" {from_si(setup.needle.gap_m, 'mm'):.4g} mm from its axis: its radius is"
        f" {from_si(radius_m, 'mm'):.4g} mm"
    )


NEEDLE_SEEN = (
    "a needle hides a part of the wall, and the network was not trained on such slices"
)

NO_THICKNESS = (
    "the wall's end is not seen, and its thickness is not stated (eye.thickness_m)"
)

_NOTHING = np.zeros((1, 0, 0), dtype=np.uint8)  # no slice


@dataclass(frozen=True, eq=False)
class SlicedFrame:
    """The segmentation of a frame, and slices of it if there is a wall to read.

    `cuts` (slice, row, column): the slice, and the same shifted in depth if the model
    reads several. `reason` says why the frame cannot be read, None if it can.
    `dent_leaves` is that of the slice, `extent_m` of the surface (`boundary_slices`).
    """

    segmentation: Segmentation
    cuts: Bytes
    reason: str | None
    dent_leaves: bool = False
    extent_m: float = 0.0

    @property
    def needle(self) -> SeenNeedle | None:
        """The needle that crosses the frame."""
        return self.segmentation.needle


def no_slice(seen: SlicedFrame, thickness_m: float | None) -> str | None:
    """Return why a network cannot read the slices of a frame: nothing says how thick
    the wall is; None if it can.
    """
    if seen.segmentation.inner_found or thickness_m is not None:
        return None
    return NO_THICKNESS


def surface_read(wall: Segmentation) -> Remark:
    """Return the remark on an answer that was read from a wall's surface alone."""
    why = wall.inner_doubt or "no edge shows where the wall ends"
    words = f"read from the surface alone: {why}"
    return Remark("surface-alone", words, ("thickness_m",))


SECOND_SURFACE = (
    "another surface lies {:.0f} µm below the first, which may be that of soft layers"
    " over the sclera; declare the wall's thickness"
)


def segment_and_slice(
    frame: Pixels,
    scale: PixelScale,
    slice_study: SliceStudy,
    shifts: tuple[float, ...] = (0.0,),
    thickness_m: float | None = None,
    finder: WallFinder | None = None,
    wall: Segmentation | None = None,
    *,
    ends_at_thickness: bool = False,
) -> SlicedFrame:
    """Segment a frame, or take its `wall`, which was given, and draw the slices that a
    model reads.

    Where the thickness is not known and there is time for a finder, a second surface
    below the first is a fault. An inner boundary that is not seen lies at the known
    thickness; with `ends_at_thickness` slices show all of them there.
    """
    found = find_wall(frame, scale, thickness_m, finder if wall is None else None)
    found = found if wall is None else replace(wall, needle=found.needle)
    if not found.usable:
        return SlicedFrame(found, _NOTHING, found.reason)

    if thickness_m is None and finder is not None and wall is None:
        below_m = second_surface_m(as_logarithmic(frame), scale, found)
        if below_m is not None:
            return SlicedFrame(
                found, _NOTHING, SECOND_SURFACE.format(from_si(below_m, "um"))
            )

    drawn = found
    is_assumed = ends_at_thickness or not found.inner_found
    if is_assumed and thickness_m is not None and wall is None:
        inner_row = assumed_inner_row(found, scale, thickness_m)
        drawn = replace(found, inner_row=inner_row)
        found = found if found.inner_found else drawn

    cuts, leaves, extent_m = boundary_slices(drawn, scale, slice_study, shifts)
    reason = None if cuts[0].any() else "the wall lies outside the window of the slice"
    return SlicedFrame(found, cuts, reason, leaves, extent_m)


def can_calibrate(
    seen: SlicedFrame, boundaries: Boundaries, contact_m: float = 0.0
) -> bool:
    """Return True if enough of the wall is in view about a contact, m from the middle,
    to calibrate on a frame.
    """
    near = np.abs(boundaries.lateral_m - contact_m) <= CALIBRATED_SPAN_M
    if seen.dent_leaves or not seen.segmentation.inner_found or not near.any():
        return False
    both = np.isfinite(boundaries.depth_m[:, near]).all(axis=0)
    return bool(both.mean() >= CALIBRATED_SHARE)


# widest interval of a dent that leaves the window: its flanks must be as sure as this
WIDEST_N = 6e-3


def judged_answer(reading: Reading, name: str, leaves: bool, study: Study) -> Answer:
    """Return the answer that one method gives; `leaves`: the dent leaves the window.

    Then the interval has to be narrow, or within one class by a fit: a network alone
    has met few such dents.
    """
    classes = len(study.classes.bounds_n) + 1
    if not reading.finite:
        return unusable_answer(classes, f"the reading of the {name} is not a number")

    reason = contact_outside(reading, study.reader)
    if reason:
        return unusable_answer(classes, reason)

    low, high = (study.classes.classify(end_n) for end_n in reading.interval_n)
    if leaves and not (reading.width_n < WIDEST_N or (name == "fit" and low == high)):
        return unusable_answer(
            classes,
            "the dent leaves the window of the slice, and its flanks leave the force"
            f" uncertain by {from_si(reading.width_n, 'mn'):.0f} mN",
        )

    return Answer(
        predicted=reading.predicted,
        probabilities=reading.probabilities,
        usable=True,
        reason=None,
        force_n=reading.force_n,
        interval_n=reading.interval_n,
        contact_m=reading.contact_m,
    )


# from a surface's ends and between the places tried of a limbus
SIDE_M = 1e-3
STEP_M = unknowns.SOFT_M
ROUNDS = 4  # of least squares
RIDGE = 1e-9  # for a limbus near the end of a surface, with nothing beyond
NOISE = 1.0  # mean square of the distances from a true wall
# squares of standard deviations that one unknown more is worth (Akaike)
ONE_UNKNOWN = 2.0


def unless_at_rest(
    answer: Answer, fit: BoundaryFit, boundaries: Boundaries, study: Study
) -> Answer:
    """Return an answer, or an unusable one if its force is above the first bound and
    the eye seems to be at rest.

    A wall that lies as near as its noise lets it is doubted only if the other surface
    lies nearer by an unknown more.
    """
    if answer.force_n is None or answer.force_n <= study.classes.bounds_n[0]:
        return answer

    largest_m = study.eye.radius_m * float(
        np.exp(DEVIATION_SD * FREE_SD[unknowns.SIZE])
    )
    dented, resting, independent = wall_distances(
        fit, boundaries.lateral_m, boundaries.depth_m[0], largest_m
    )
    if dented <= resting + (ONE_UNKNOWN / independent if dented <= NOISE else 0.0):
        return answer

    reason = (
        "a surface without a dent, flatter than an eye's, lies nearer than the dented"
        " wall: is the scale right?"
    )
    return replace(
        unusable_answer(len(answer.probabilities or ()), reason),
        readings=answer.readings,
    )


def wall_distances(
    fit: BoundaryFit, lateral_m: Floats, outer_m: Floats, radius_m: float
) -> tuple[float, float, float]:
    """Return the distances from a frame's surface of the fitted wall and of the nearest
    surface without a dent.

    They are mean squares in standard deviations of a boundary, with Cauchy's weights;
    then follows the number of independent places. One arc of the surface is flatter
    than a circle of the radius; if none is, its distance is infinite. `lateral_m`
    (column,) increases; `outer_m` is the depth of the frame's surface, NaN where
    unseen.
    """
    wall_m = fit.wall_bmc[0][np.argsort(fit.wall_bmc[0][:, 0])]
    seen = np.flatnonzero(
        np.isfinite(outer_m) & (lateral_m > wall_m[0, 0]) & (lateral_m < wall_m[-1, 0])
    )
    seen = seen[:: -(-len(seen) // COLUMNS)]
    at_m = lateral_m[seen]
    depth_m = outer_m[seen]
    dented_m = np.interp(at_m, *wall_m.T)
    width_m = at_m[-1] - at_m[0]
    sd_m = OUTER_SD_M * np.hypot(1.0, np.gradient(dented_m, at_m))
    limbus = np.arange(at_m[0] + SIDE_M, at_m[-1] - SIDE_M, STEP_M) / width_m
    along = at_m / width_m
    beyond = along - limbus[:, None]
    ramp = 0.5 * (beyond + np.hypot(beyond, unknowns.SOFT_M / width_m))
    arcs = [np.broadcast_to(along**power, ramp.shape) for power in range(4)]
    # (limbus, term, column)
    basis = np.stack([*arcs, ramp, ramp**2], axis=1) * (OUTER_SD_M / sd_m)
    wanted = (depth_m - depth_m.mean()) / sd_m
    weight = np.ones(ramp.shape)

    for _ in range(ROUNDS):
        weighted = basis * weight[:, None]
        normal = weighted @ basis.swapaxes(1, 2) + RIDGE * np.eye(basis.shape[1])
        terms = np.linalg.solve(normal, weighted @ wanted[:, None])
        off = wanted - (terms.swapaxes(1, 2) @ basis)[:, 0]
        weight = cauchy_weight(off)

    square = terms[:, 2, 0]
    cube = terms[:, 3, 0]
    change = terms[:, 5, 0]
    bends = (
        square + 1.5 * cube * (limbus + along[0]),
        square + 1.5 * cube * (limbus + along[-1]) + change,
    )
    # in the mean of an arc
    is_flat = np.minimum(*bends) * 2.0 * OUTER_SD_M / width_m**2 < 1.0 / radius_m
    off = np.vstack([off[is_flat], (depth_m - dented_m) / sd_m])
    found = (off**2 * cauchy_weight(off)).mean(axis=1)

    return (
        float(found[-1]),
        float(found[:-1].min(initial=np.inf)),
        float(width_m / CORRELATED_M),
    )
