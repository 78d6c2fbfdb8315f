"""The force that strains a wall as the paper's bound strains the paper's wall: a bound for any thickness and stiffness.

The measures are the largest principal stretch and the largest principal Cauchy stress on the inner surface of the wall
of revolution under the needle. A blunt needle stretches the wall most there, on the axis. The rim of the needle's disc,
where the pressure jumps and values grow with mesh refinement, is on the other surface, a thickness away.

This is not a criterion of damage and was not tested on tissue: `docs/monitor_decision.md` has the reasons and a table.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import isfinite, pi

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.mechanics.axisymmetric import AxisymmetricWall
from scleraforce.mechanics.continuation import pressurise, trace
from scleraforce.mechanics.elements import gauss_points
from scleraforce.mechanics.material import lame_constants
from scleraforce.mechanics.meridian import MeridianMesh, MeridianSize, meridian_mesh, quad_shapes
from scleraforce.study import Study

Floats = NDArray[np.float64]

REFERENCE_THICKNESS_M = 500e-6  # of the wall whose bound the study states; its modulus and IOP are the study's
HIGHEST = 2.0  # times the reference's bound; no wall gets more
THICKNESS_M = (350e-6, 900e-6)
MODULUS_PA = (0.12e6, 0.8e6)
IOP_RATIO = (8e-5, 6e-3)
SIZE = MeridianSize(elements=64, layers=4)
ALONG_POINTS = 2  # of an element of 9 nodes, where derivatives are most exact
DEEPEST_M, LARGEST_STEP_M = 10e-3, 2.5e-4


@dataclass(frozen=True, eq=False)
class InnerPath:
    """A load path, (state,) each: F/E, the contact's inward displacement, and two measures of the wall's inner surface.

    They are its largest principal stretch, and its largest principal Cauchy stress over E.
    """

    force_ratio_m2: Floats
    tip_m: Floats
    stretch: Floats
    stress_ratio: Floats


def adaptive_bound_n(study: Study, *, thickness_m: float, youngs_modulus_pa: float, iop_pa: float) -> float:
    """Return the bound of the force for a wall, N.

    The study's upper class bound B is assumed right for a wall of 500 um with the study's E and IOP. With stretch s0
    and stress q0 that B causes there, let F_s and F_q be the least forces at which this wall has s0 and q0. The bound
    is F_s where that is below B; else the least of F_s, F_q and 2 B, but not below B.

    >>> round(1e3 * adaptive_bound_n(Study(), thickness_m=500e-6, youngs_modulus_pa=0.25e6, iop_pa=266.64), 1)
    30.0
    """
    checked = {
        "thickness_m": (thickness_m, THICKNESS_M),
        "youngs_modulus_pa": (youngs_modulus_pa, MODULUS_PA),
        "IOP/E": (iop_pa / youngs_modulus_pa if youngs_modulus_pa else np.nan, IOP_RATIO),
    }
    for name, (value, (low, high)) in checked.items():
        if not (isfinite(value) and low <= value <= high):
            raise InputError(f"adaptive bound: {name} is {value:g}; must be {low:g} to {high:g}")
    bound_n, modulus_pa = study.classes.bounds_n[-1], study.eye.youngs_modulus_pa
    sizes = (study.eye.radius_m, study.eye.poisson_ratio, 0.5 * study.needle.outer_diameter_m)
    stated = inner_path(*sizes, REFERENCE_THICKNESS_M, study.eye.iop_pa / modulus_pa, bound_n / modulus_pa)
    stretch = float(np.interp(bound_n / modulus_pa, stated.force_ratio_m2, stated.stretch))
    stress_pa = modulus_pa * float(np.interp(bound_n / modulus_pa, stated.force_ratio_m2, stated.stress_ratio))
    highest_n = HIGHEST * bound_n
    ratio = iop_pa / youngs_modulus_pa
    path = inner_path(*sizes, thickness_m, ratio, highest_n / youngs_modulus_pa)
    stretched_n = youngs_modulus_pa * _least_force(path.force_ratio_m2, path.stretch, stretch)
    if stretched_n <= bound_n:
        return stretched_n
    stressed_n = youngs_modulus_pa * _least_force(path.force_ratio_m2, path.stress_ratio, stress_pa / youngs_modulus_pa)
    return max(bound_n, min(stretched_n, stressed_n, highest_n))


@lru_cache(maxsize=16)
def inner_path(
    radius_m: float,
    poisson_ratio: float,
    needle_radius_m: float,
    thickness_m: float,
    iop_ratio: float,
    max_force_ratio_m2: float,
    size: MeridianSize = SIZE,
) -> InnerPath:
    """Return stretch and stress of the inner surface along the load path of an even wall of revolution.

    The path goes to F/E of `max_force_ratio_m2`, or to a dent of 10 mm.
    """
    mesh = meridian_mesh(radius_m, thickness_m, needle_radius_m, 0.5 * pi, size)
    wall = AxisymmetricWall(mesh, poisson_ratio)
    path = trace(
        wall,
        pressurise(wall, iop_ratio),
        iop_ratio,
        max_tip_m=DEEPEST_M,
        max_force=max_force_ratio_m2,
        largest_step_m=LARGEST_STEP_M,
    )
    displacement_snc = np.zeros((len(path.tip_m), mesh.points_nc.size))
    displacement_snc[:, wall.free] = path.displacement_su
    found = [inner_surface(mesh, u.reshape(-1, 2), poisson_ratio) for u in displacement_snc]
    stretch, stress = np.array([(stretch_pk.max(), stress_pk.max()) for stretch_pk, stress_pk in found]).T
    return InnerPath(path.force, path.tip_m, stretch, stress)


def inner_surface(mesh: MeridianMesh, displacement_nc: Floats, poisson_ratio: float) -> tuple[Floats, Floats]:
    """Return principal stretches and principal Cauchy stresses over E along the inner surface, both (point, 3).

    sigma_k = (mu (s_k^2 - 1) + lambda ln J) / J for the energy of `neo_hookean`; s_k are the roots of the eigenvalues
    of F F^T in the meridian, larger first, and r/R around the axis. There are two points an element, from the axis on.
    """
    layers = len(mesh.cells_en) // ((len(mesh.inner_n) - 1) // 2)
    cells_en = mesh.cells_en[layers - 1 :: layers]
    along_p = gauss_points(1, ALONG_POINTS)[0][:, 0]
    values_pn, slopes_pnk = quad_shapes(np.stack([along_p, np.ones_like(along_p)], axis=1))
    before_enc = mesh.points_nc[cells_en]
    after_enc = before_enc + displacement_nc[cells_en]
    tangent_before, tangent_after = (np.einsum("enc,pnk->epck", x, slopes_pnk) for x in (before_enc, after_enc))
    F = tangent_after @ np.linalg.inv(tangent_before)
    around_ep = (after_enc[..., 0] @ values_pn.T) / (before_enc[..., 0] @ values_pn.T)
    plane_epk = np.sqrt(np.linalg.eigvalsh(F @ F.swapaxes(-1, -2))[..., ::-1])
    stretch_pk = np.concatenate([plane_epk, around_ep[..., None]], axis=-1).reshape(-1, 3)
    lame_lambda, lame_mu = lame_constants(1.0, poisson_ratio)
    J_p = stretch_pk.prod(axis=-1)[:, None]
    stress_pk: Floats = (lame_mu * (stretch_pk**2 - 1.0) + lame_lambda * np.log(J_p)) / J_p
    return stretch_pk, stress_pk


def _least_force(force: Floats, measure: Floats, limit: float) -> float:
    """Return the least force of all states that reach the limit, or the path's largest force if none does.

    A wall that snaps carries one force at several dents, and a robot that holds the needle can reach each of them.
    """
    rising = (measure[:-1] < limit) & (measure[1:] >= limit)
    before, after = np.flatnonzero(rising), np.flatnonzero(rising) + 1
    share = (limit - measure[before]) / (measure[after] - measure[before])
    crossing = force[before] + share * (force[after] - force[before])
    return float(np.concatenate([[force.max()], crossing, force[measure >= limit]]).min())
