"""An eye at rest at a wrong scale: a force counts only if no flat surface without a dent lies nearer than the wall.

A cornea or a limbus in a picture that was stretched looks like a wall with a shallow dent, and flatter than an eye. The
section of an eye without a needle is the arc of an ellipse at any scale, or two arcs that meet at a limbus: here of
third order. A true dent does not flatten the wall beside it.
"""

from dataclasses import replace

import numpy as np

from scleraforce.arrays import Floats
from scleraforce.library.fit import BoundaryFit
from scleraforce.library.fit_frame import COLUMNS, CORRELATED_M, OUTER_SD_M
from scleraforce.library.placement import CAUCHY
from scleraforce.library.prior import FREE_SD
from scleraforce.library.unknowns import SIZE, SOFT_M
from scleraforce.reader.answer import Answer, unusable
from scleraforce.reader.verdicts import DEVIATION_SD
from scleraforce.segmentation.observations import Boundaries
from scleraforce.study import Study

SIDE_M, STEP_M = 1e-3, SOFT_M  # from a surface's ends and between the places tried of a limbus
ROUNDS, RIDGE = 4, 1e-9  # of least squares; for a limbus near the end of a surface, with nothing beyond
NOISE = 1.0  # mean square of the distances from a true wall
ONE_UNKNOWN = 2.0  # squares of standard deviations that one unknown more is worth (Akaike)


def unless_at_rest(answer: Answer, fit: BoundaryFit, boundaries: Boundaries, study: Study) -> Answer:
    """Return an answer, or an unusable one if its force is above the first bound and the eye seems to be at rest.

    A wall that lies as near as its noise lets it is doubted only if the other surface lies nearer by an unknown more.
    """
    if answer.force_n is None or answer.force_n <= study.classes.bounds_n[0]:
        return answer
    largest_m = study.eye.radius_m * float(np.exp(DEVIATION_SD * FREE_SD[SIZE]))
    dented, resting, independent = distances(fit, boundaries.lateral_m, boundaries.depth_m[0], largest_m)
    if dented <= resting + (ONE_UNKNOWN / independent if dented <= NOISE else 0.0):
        return answer
    reason = "a surface without a dent, flatter than an eye's, lies nearer than the dented wall: is the scale right?"
    return replace(unusable(len(answer.probabilities or ()), reason), readings=answer.readings)


def distances(fit: BoundaryFit, lateral_m: Floats, outer_m: Floats, radius_m: float) -> tuple[float, float, float]:
    """Return the distances from a frame's surface of the fitted wall and of the nearest surface without a dent.

    They are mean squares in standard deviations of a boundary, with Cauchy's weights; then follows the number of
    independent places. One arc of the surface is flatter than a circle of the radius; if none is, its distance is
    infinite. `lateral_m` (column,) increases; `outer_m` is the depth of the frame's surface, NaN where unseen.
    """
    wall_m = fit.wall_bmc[0][np.argsort(fit.wall_bmc[0][:, 0])]
    seen = np.flatnonzero(np.isfinite(outer_m) & (lateral_m > wall_m[0, 0]) & (lateral_m < wall_m[-1, 0]))
    seen = seen[:: -(-len(seen) // COLUMNS)]
    at_m, depth_m = lateral_m[seen], outer_m[seen]
    dented_m, width_m = np.interp(at_m, *wall_m.T), at_m[-1] - at_m[0]
    sd_m = OUTER_SD_M * np.hypot(1.0, np.gradient(dented_m, at_m))
    limbus = np.arange(at_m[0] + SIDE_M, at_m[-1] - SIDE_M, STEP_M) / width_m
    along = at_m / width_m
    beyond = along - limbus[:, None]
    ramp = 0.5 * (beyond + np.hypot(beyond, SOFT_M / width_m))
    arcs = [np.broadcast_to(along**power, ramp.shape) for power in range(4)]
    basis = np.stack([*arcs, ramp, ramp**2], axis=1) * (OUTER_SD_M / sd_m)  # (limbus, term, column)
    wanted, weight = (depth_m - depth_m.mean()) / sd_m, np.ones(ramp.shape)
    for _ in range(ROUNDS):
        weighted = basis * weight[:, None]
        normal = weighted @ basis.swapaxes(1, 2) + RIDGE * np.eye(basis.shape[1])
        terms = np.linalg.solve(normal, weighted @ wanted[:, None])
        off = wanted - (terms.swapaxes(1, 2) @ basis)[:, 0]
        weight = 1.0 / (1.0 + (off / CAUCHY) ** 2)
    square, cube, change = terms[:, 2, 0], terms[:, 3, 0], terms[:, 5, 0]
    bends = square + 1.5 * cube * (limbus + along[0]), square + 1.5 * cube * (limbus + along[-1]) + change
    is_flat = np.minimum(*bends) * 2.0 * OUTER_SD_M / width_m**2 < 1.0 / radius_m  # in the mean of an arc
    off = np.vstack([off[is_flat], (depth_m - dented_m) / sd_m])
    found = (off**2 / (1.0 + (off / CAUCHY) ** 2)).mean(axis=1)
    return float(found[-1]), float(found[:-1].min(initial=np.inf)), float(width_m / CORRELATED_M)
