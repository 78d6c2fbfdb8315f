"""One eye under 30 mN at finite strain, as `simulate --mechanics finite-strain`
computes it.
"""

from functools import partial

from scleraforce.front.api.simulating import simulate
from speed.record import Table, rows_beside
from speed.run import Run, in_turns

BENT = "`simulate --mechanics finite-strain`"
LINEAR = "the same eye, linear"
GOALS_S = {BENT: 6.0}
SETTINGS = """`simulate --thickness-um 500 --force-mn 30` of the paper's study, in a
process that runs already: mesh, path from rest to the force, section and slice. In
turns. SOFA's corotational Newton does not converge beyond 6 mN on such a wall, so there
is no other program beside it."""


def measure(run: Run) -> Table:
    """Simulate an eye by both mechanics."""
    work = {
        name: partial(simulate, run.study, thickness_m=0.5e-3, mechanics=kind)
        for name, kind in ((BENT, "finite-strain"), (LINEAR, "linear"))
    }
    meshes = {name: bend(force_n=1e-4).mesh for name, bend in work.items()}
    force_n = run.count(30, 3) * 1e-3
    taken_s = in_turns(
        {name: partial(bend, force_n=force_n) for name, bend in work.items()},
        run.count(3, 1),
    )
    more = {
        name: {
            "elements": float(len(mesh.cells_en)),
            "unknowns": float(mesh.points_nc.size),
        }
        for name, mesh in meshes.items()
    }
    rows = rows_beside(taken_s, LINEAR, "s", settings={}, goals=GOALS_S, more=more)
    return Table("Finite strain, three-dimensional", SETTINGS, rows)
