"""What it costs to assume that the eye's pressure relaxes as its wall does: the table
of docs/physics.md.

3-D walls of 0.6 mm, radius 12 mm, needle at 35 deg. Their stress relaxes, the pressure
does not: with Se(C) the elastic second Piola-Kirchhoff stress, S = Se - sum g_i M_i and
dM_i/dt = (Se - M_i)/tau_i at every Gauss point. Before the push the wall has rested
under its pressure. The needle moves to a dent in 0.3 s and holds it. The Fe that is
read is the force at which an elastic wall of the instantaneous modulus has the nearest
section. `mechanics.tissue_material` then turns Fe into the felt force, with the
tissue's own g, or with the g that fits the felt force of a hold at 20 mN best. No
light, no noise. Forces are in mN, after holds of 1, 10 and 100 s. A minute and a half
on one core.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import click
import numpy as np
from scipy.optimize import nnls

from figures.printing import ROWS, listed, print_table, whole_number
from figures.pushed_walls import (
    CONTACT,
    NEEDLE_RADIUS_M,
    NU,
    RADIUS_M,
    THICKNESS_M,
    ElasticSections,
    Floats,
    push,
    surfaces,
)
from scleraforce.base.units import to_si
from scleraforce.mechanics.equilibrium import Dent, Solve, solve_balance
from scleraforce.mechanics.finite_strain_wall import FiniteWall, WallEquilibrium
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.hexahedral_mesh import sum_at
from scleraforce.mechanics.load_path_tracing import PathEnd, pressurise
from scleraforce.mechanics.loads_and_supports import NeedleLoad, needle_at
from scleraforce.mechanics.stiffness_factor import factor_sum
from scleraforce.mechanics.tissue_material import (
    PronySeries,
    lame_constants,
    line_weights,
)

CORE = 4  # quads along the side of the mesh's core
EYES = ((0.4, 2.0), (0.4, 10.0), (1.2, 18.0))  # MPa at once, mmHg
TISSUES = {
    "27 %": PronySeries((0.12, 0.15), (1.2, 12.0)),
    "pork": PronySeries((0.27, 0.33), (0.4, 4.3)),
}
# elastic ones at the dents that are held: one calibrates, the other is read
CALIBRATED_N = 20e-3
READ_N = 30e-3
RAMP_S = 0.3
RAMP_STEPS = 6
SHOWN_S = (1.0, 10.0, 100.0)  # of a hold
TIMES_S = (0.1, 1.0, 10.0, 100.0)  # of the shares that are found
ONE = 1.0 - 1e-12  # a share, below 1


class RelaxingWall(WallEquilibrium):
    """A wall whose stress relaxes, for `load_path_tracing`, at E = 1 Pa. Se is taken as
    straight between two samples.
    """

    def __init__(
        self,
        wall: FiniteWall,
        needle: NeedleLoad,
        modulus_pa: float,
        tissue: PronySeries,
    ) -> None:
        """Prepare a wall whose stress has relaxed, for `pressurise`."""
        super().__init__(wall, needle, modulus_pa, 0.0)
        self._finite = wall
        self._tissue = tissue
        self._shares = np.array(tissue.shares)
        self._left = 1.0 - sum(tissue.shares)
        self._lost = np.zeros((*wall.solid.points.volumes_ep.shape, 3, 3))

    def settle(self, u: Floats) -> None:
        """Start from a state that has lasted: M_i = Se."""
        self._elastic = self._stress(u)
        self._memory = np.repeat(self._elastic[..., None], len(self._shares), axis=-1)

    def pass_time(self, step_s: float) -> None:
        """Prepare the state after a step: S = left Se - lost, where `lost` is what the
        state before determines.
        """
        old, kept, self._new = line_weights(np.array([step_s]), self._tissue.times_s)[0]
        self._come = self._elastic[..., None] * old + kept * self._memory
        self._left = 1.0 - float(self._shares @ self._new)
        self._lost = self._come @ self._shares

    def arrive(self, u: Floats) -> None:
        """Take u as the state after the step."""
        self._elastic = self._stress(u)
        self._memory = self._come + self._elastic[..., None] * self._new

    def residual(self, u: Floats, pressure: float) -> Floats:
        """Return the forces out of balance without the needle."""
        displaced_nc = self._finite.full_nc(u)
        points = self._finite.solid.points
        stress = (
            (np.eye(3) + self._gradient(u))
            @ self._lost
            * points.volumes_ep[..., None, None]
        )
        lost_enc = np.einsum(
            "epij,epnj->eni", stress, points.gradients_epnc, optimize=True
        )
        internal_nc = self._left * self._finite.solid.forces(displaced_nc)
        internal_nc -= sum_at(self._finite.mesh.cells_en, lost_enc, len(displaced_nc))

        return (
            internal_nc - pressure * self._finite.inner.forces(displaced_nc)
        ).ravel()[self._finite.free]

    def factor(self, u: Floats, pressure: float) -> Solve:
        """Factor the tangent."""
        displaced_nc = self._finite.full_nc(u)
        points = self._finite.solid.points
        elements = self._left * self._finite.solid.tangents(displaced_nc)
        weighted = points.gradients_epnc @ (
            self._lost * points.volumes_ep[..., None, None]
        )
        lost_enn = np.einsum(
            "epnj,epmj->enm", weighted, points.gradients_epnc, optimize=True
        )

        for i in range(3):
            elements[:, i, :, i] -= lost_enn

        self._finite.inner.add_tangent(elements, displaced_nc, -pressure)
        return factor_sum(self._finite.mesh, self._finite.held_nc, elements)

    def _gradient(self, u: Floats) -> Floats:
        local_enc = self._finite.full_nc(u)[self._finite.mesh.cells_en]
        gradients_epnc = self._finite.solid.points.gradients_epnc
        return np.asarray(
            np.einsum("eni,epnj->epij", local_enc, gradients_epnc, optimize=True),
            dtype=np.float64,
        )

    def _stress(self, u: Floats) -> Floats:
        """Second Piola-Kirchhoff stress mu (I - C^-1) + lambda ln J C^-1, (element,
        point, 3, 3).
        """
        lame_lambda, mu = lame_constants(1.0, NU)
        F = np.eye(3) + self._gradient(u)
        inverse = np.linalg.inv(F.swapaxes(-1, -2) @ F)
        log_ratio = np.log(np.linalg.det(F))[..., None, None]

        return np.asarray(
            mu * np.eye(3) + (lame_lambda * log_ratio - mu) * inverse, dtype=np.float64
        )


@dataclass(frozen=True)
class Hold:
    """A push of a wall that relaxes, (sample,): the felt force and the elastic force
    that its section shows.
    """

    time_s: Floats
    felt_n: Floats
    read_n: Floats

    def felt_by(self, series: PronySeries) -> Floats:
        """Return the felt force by the model of `mechanics.tissue_material`, from the
        forces that are read, N.
        """
        return series.felt_along(
            self.time_s.tolist(), self.read_n.tolist(), self.time_s
        )

    def shown(self, forces_n: Floats, form: str = ".1f") -> str:
        """Return forces after the shown holds, in mN."""
        samples = np.searchsorted(self.time_s, RAMP_S + np.array(SHOWN_S))
        return listed(1e3 * forces_n[samples], form)


def pushed(
    problem: RelaxingWall, pressure: float, tip_m: float, time_s: Floats
) -> Floats:
    """Push to a dent in `RAMP_S` and hold it; return displacement and F/E at samples,
    (sample, unknown + 1).

    The pressure is over the instantaneous modulus; the first sample is 0 s.
    """
    start = pressurise(problem, pressure)
    problem.settle(start)
    control = Dent(problem, start, pressure)
    states = [control.unloaded]

    for before_s, now_s in pairwise(time_s):
        problem.pass_time(now_s - before_s)
        control.tip_m = tip_m * min(now_s / RAMP_S, 1.0)
        states.append(solve_balance(control, states[-1])[0])
        control.largest_force = max(control.largest_force, float(states[-1][-1]))
        problem.arrive(states[-1][:-1])

    return np.array(states)


def found_shares(hold: Hold) -> PronySeries:
    """Return the shares that turn the forces read in a hold into those felt, by least
    squares.
    """
    lags_n = [
        hold.read_n - hold.felt_by(PronySeries((ONE,), (time_s,))) for time_s in TIMES_S
    ]
    shares = nnls(np.transpose(lags_n), hold.read_n - hold.felt_n)[0]
    return PronySeries(tuple(shares.tolist()), TIMES_S)


def eye_rows(
    wall: FiniteWall, eye: tuple[float, float], samples: int
) -> Iterator[list[str]]:
    """Yield an eye's rows, one for each tissue."""
    modulus_pa = 1e6 * eye[0]
    iop_pa = to_si(eye[1], "mmhg")
    path = push(wall, PathEnd(max_force=1.3 * READ_N), modulus_pa, iop_pa)
    elastic = ElasticSections(wall.mesh, path)
    needle = needle_at(wall.mesh, CONTACT, NEEDLE_RADIUS_M)
    holds_s = RAMP_S + np.union1d(np.geomspace(0.1, max(SHOWN_S), samples), SHOWN_S)
    time_s = np.concatenate([RAMP_S * np.arange(RAMP_STEPS + 1) / RAMP_STEPS, holds_s])

    def held(tissue: PronySeries, force_n: float) -> tuple[Hold, float]:
        problem = RelaxingWall(wall, needle, modulus_pa, tissue)
        states = pushed(problem, iop_pa / modulus_pa, path.tip_m(force_n), time_s)
        displaced_snc = np.stack([wall.full_nc(u) for u in states[:, :-1]])
        read_n, off_m = elastic.read_n(surfaces(wall.mesh, displaced_snc))
        read_n[0] = 0.0  # before the contact
        return Hold(time_s, modulus_pa * states[:, -1], read_n), float(off_m[-1])

    for name, tissue in TISSUES.items():
        found = found_shares(held(tissue, CALIBRATED_N)[0])
        hold, off_m = held(tissue, READ_N)
        yield [
            f"{eye[0]:g} MPa, {eye[1]:g} mmHg",
            name,
            hold.shown(hold.felt_n),
            hold.shown(hold.read_n),
            f"{1e6 * off_m:.0f}",
            *(
                hold.shown(hold.felt_by(series) - hold.felt_n, "+.2f")
                for series in (tissue, found)
            ),
        ]


@click.command(help=__doc__)
@ROWS
@whole_number("--rings", 8, "Rings of elements around the mesh's core.")
@whole_number("--samples", 12, "Samples of a hold.")
def main(rows: int | None, rings: int, samples: int) -> None:
    """Print the table."""
    wall = FiniteWall(graded_mesh(RADIUS_M, THICKNESS_M, CONTACT, CORE, rings), NU)
    head = ["E, IOP", "lost", "felt", "Fe read", "misfit, um"]
    errors = ["error by the tissue's g", "by g found at 20 mN"]
    eyes = (row for eye in EYES[:rows] for row in eye_rows(wall, eye, samples))
    print_table([*head, *errors], eyes)
