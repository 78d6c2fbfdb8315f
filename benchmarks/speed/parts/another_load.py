"""Another force, or another contact, on an eye whose wall is factored already."""

import numpy as np
from scipy.sparse.linalg import splu

from reference_r1 import CONTACT, E_PA, FORCE_N, NU
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from speed.record import Row, Table, rows_beside
from speed.run import Run, in_turns
from speed.solvers.plain_scikit_fem import assemble
from speed.solvers.problem import r1_mesh

NEEDLE_RADIUS_M = 0.35e-3
PEER = "SciPy's factor of scikit-fem's matrix"
# right-hand sides in one triangular solve, as the data set's walls are solved
TOGETHER = 32
MANY = f"another contact, of {TOGETHER} together"
GOALS_MS = {"another contact": 5.0, MANY: 2.0, "another force": 2.0}
SOFA_MS = 26.0
SETTINGS = """An eye of 0.5 mm, prepared: mesh made, matrix factored. What is timed is
the displacement of all nodes, and its value under the needle. In turns, in one
process."""
WORDS = {
    "another contact": (
        "the needle at a contact that was not seen before: one more right-hand side"
    ),
    MANY: "the same for each of them: one solve for all, which reads the factor once",
    "another force": (
        "the same contact, with pressure and weight: superposition of known solutions"
    ),
    PEER: (
        "`splu` with its ordering for symmetric matrices, a right-hand side that is"
        " ready"
    ),
}


def measure(run: Run) -> Table:
    """Time further loads, in this package and with a factor that one keeps oneself."""
    wall = LinearWall(r1_mesh("even", run.quick), NU)
    rng = np.random.default_rng(0)
    needle_nc = wall.needle_cnc([CONTACT], NEEDLE_RADIUS_M)[0]
    peer = assemble(run.quick)
    free = peer.basis.complement_dofs(peer.held)
    factor = splu(peer.stiffness[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A")
    load = peer.load[free]

    def contacts(count: int) -> list[float]:
        places = rng.uniform([0.4, -3.0], [0.8, 3.0], (count, 2)).tolist()
        pressed = [Contact(polar_rad=a, azimuth_rad=b) for a, b in places]
        moved_cnc = wall.needle_cnc(pressed, NEEDLE_RADIUS_M)

        return [
            tip_displacement(wall.mesh, contact, FORCE_N / E_PA * moved_nc)
            for contact, moved_nc in zip(pressed, moved_cnc, strict=True)
        ]

    def another_force() -> float:
        state = {"youngs_modulus_pa": E_PA, "iop_pa": 266.0, "density_kg_m3": 1100.0}
        return tip_displacement(
            wall.mesh, CONTACT, wall.displacement(needle_nc, 0.02, **state)
        )

    another_force()  # pressure and weight are solved for at the first
    taken_s = in_turns(
        {
            "another contact": lambda: contacts(1),
            MANY: lambda: contacts(TOGETHER),
            "another force": another_force,
            PEER: lambda: factor.solve(load),
        },
        run.count(40, 3),
    )
    taken_s[MANY] = [seconds / TOGETHER for seconds in taken_s[MANY]]
    taken_ms = {name: [1e3 * s for s in found] for name, found in taken_s.items()}
    sofa = Row(
        what="SOFA, factor kept",
        value=SOFA_MS,
        unit="ms",
        source="SOFA v26.06 in C++, by hand, another day",
    )
    rows = rows_beside(taken_ms, PEER, "ms", settings=WORDS, goals=GOALS_MS)
    return Table("Another load on the same eye", SETTINGS, (*rows, sofa))
