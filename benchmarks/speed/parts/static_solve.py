"""The first static solve of R1, in this package and in what one would use instead:
time, memory, error.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from reference_r1 import E_PA, NU
from speed.children import ask_module
from speed.record import Row, Table, rows_beside, spread
from speed.run import Run
from speed.solvers.calculix import calculate, force_cards, input_deck, is_installed
from speed.solvers.problem import Solved, error_percent, r1_forces, r1_mesh, tip_mm

GOALS_S = {"ours, default": 0.3}
DENSITY_KG_M3 = 1100.0  # CalculiX wants one
BESIDE = "CalculiX C3D20"
OURS = {
    "default": "what `simulate` solves: small elements under the needle, 27 nodes",
    "even": (
        "20 quads along an edge, one layer, 27 nodes: the mesh of `phantom`,"
        " `calibrate`, `generate`"
    ),
    "20-node": "20 quads along an edge, one layer, 20 nodes",
    "paper's": "9,600 trilinear hexahedra in two layers: it locks",
}
ELEMENTS = {
    "C3D20": "20-node",
    "C3D20R": "20-node",
    "C3D8": "paper's",
    "C3D8I": "paper's",
}
SCIKIT_FEM = "plain scikit-fem"
WORDS = {
    **{f"ours, {name}": words for name, words in OURS.items()},
    **{
        f"CalculiX {element}": (
            f"SPOOLES, the mesh of `ours, {mesh}`, concentrated forces equal to our"
            " nodal ones"
        )
        for element, mesh in ELEMENTS.items()
    },
    SCIKIT_FEM: (
        "20 quads along an edge, 27-node elements with straight edges, three Gauss"
        " points each way, `solve` with SciPy's default solver; solved once"
    ),
}
# SOFA v26.06, HexahedronFEMForceField, StaticSolver, Eigen LDLT: s, unknowns, tip in mm
# beside a converged 2.135.
SOFA = {"9,600": (3.0, 43_929, 1.743), "14,400": (9.3, 58_572, 1.867)}
SOFA_SOURCE = (
    "SOFA v26.06, trilinear hexahedra, StaticSolver, Eigen LDLT, one thread, by hand on"
    " another day; its tip beside 2.135 mm, where it was read"
)
SETTINGS = """Reference problem R1: half-sphere of 12 mm and 0.5 mm, 0.25 MPa, nu 0.45,
clamped base, 30 mN at 35° as a Gaussian of 0.35 mm. One thread each. Every solve is a
process of its own, the programs in turns. The time is that of the work: mesh, matrix,
factor, load and displacements in a process that has loaded its code and reads no file;
for CalculiX what it says of itself, from the matrix's structure to the end of the step.
"process" is all of it, start and files included; "peak" the largest memory of the
process. "error" is that of the displacement at the load's centre against 60 quads along
an edge (2.168 mm); negative is too stiff."""


@dataclass(frozen=True)
class Taken:
    """One solve: its own figures, and the seconds of the whole process."""

    solved: Solved
    process_s: float


def measure(run: Run) -> Table:
    """Solve R1 in every program, in turns."""
    quick = ["--quick"] if run.quick else []
    solvers: dict[str, Callable[[], Taken]] = {
        f"ours, {name}": partial(_told, "ours", name, *quick) for name in OURS
    }
    absent = []
    if is_installed():
        for element in ELEMENTS:
            solvers[f"CalculiX {element}"] = partial(_calculix, element, run)
    else:
        words = "`ccx` is not installed here"
        absent = [Row(what="CalculiX", value=None, unit="s", settings=words)]

    taken: dict[str, list[Taken]] = defaultdict(list)
    for _ in range(run.count(5, 1)):
        for name, solve in solvers.items():
            taken[name].append(solve())

    taken[SCIKIT_FEM].append(_told("plain_scikit_fem", *quick))
    taken_s: dict[str, list[float]] = {}
    more: dict[str, dict[str, float | None]] = {}
    for name, found in taken.items():
        taken_s[name] = [each.solved.seconds for each in found]
        more[name] = {
            "process, s": spread([each.process_s for each in found])["value"],
            "peak, MB": max(each.solved.peak_mb for each in found),
            "unknowns": float(found[0].solved.unknowns),
            "error, %": error_percent(found[0].solved.tip_mm),
        }

    rows = rows_beside(taken_s, BESIDE, "s", settings=WORDS, goals=GOALS_S, more=more)
    sofa = [
        Row(
            what=f"SOFA, {elements} elements",
            value=seconds,
            unit="s",
            source=SOFA_SOURCE,
            more={"unknowns": float(unknowns), "error, %": 100.0 * (tip / 2.135 - 1.0)},
        )
        for elements, (seconds, unknowns, tip) in SOFA.items()
    ]
    return Table("First static solve", SETTINGS, (*rows, *absent, *sofa))


def _told(module: str, *words: str) -> Taken:
    told, process_s = ask_module(f"speed.solvers.{module}", *words)
    return Taken(Solved(**told), process_s)


def _calculix(element: str, run: Run) -> Taken:
    mesh = r1_mesh(ELEMENTS[element], run.quick)
    deck = input_deck(
        mesh,
        element,
        force_cards(r1_forces(mesh)),
        youngs_modulus_pa=E_PA,
        poisson_ratio=NU,
        density_kg_m3=DENSITY_KG_M3,
    )
    folder = run.folder / f"calculix-{element}"
    folder.mkdir(exist_ok=True)
    found = calculate(folder, deck, len(mesh.points_nc))
    solved = Solved(
        seconds=found.own_seconds,
        unknowns=mesh.points_nc.size,
        tip_mm=tip_mm(mesh, found.displacement_nc),
        peak_mb=found.peak_mb,
    )

    return Taken(solved, found.seconds)
