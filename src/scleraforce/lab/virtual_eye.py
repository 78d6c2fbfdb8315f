"""Virtual eyes: parameters, sections under a needle, the five of the paper's design;
one eye as `simulate` shows it.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import acos, atan2, pi, radians, remainder
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from scleraforce.base.arrays import Bytes, Floats
from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.optional_packages import package_for
from scleraforce.base.units import STANDARD_GRAVITY_M_S2, from_si
from scleraforce.base.whole_files import renamed_when_whole
from scleraforce.mechanics.contact_and_section import (
    Contact,
    ScanPlane,
    SliceWindow,
    WallSection,
)
from scleraforce.mechanics.finite_strain_wall import LoadPath, bend_eye
from scleraforce.mechanics.graded_mesh import supported_mesh
from scleraforce.mechanics.hexahedral_mesh import HexMesh
from scleraforce.mechanics.linear_wall import LinearWall, tip_displacement
from scleraforce.mechanics.load_path_tracing import PathEnd, Progress
from scleraforce.mechanics.loads_and_supports import study_springs
from scleraforce.mechanics.mesh_section import cut_sections, fill_section, slice_window
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.fields import check_quantity, declared
from scleraforce.records.globe import study_law
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import PhantomStudy, Study, draw, refuse_unused

SACCADE_S = 1.0  # from one saccade to the next


@dataclass(frozen=True, kw_only=True)
class EyeTurn:
    """A rotation of the globe from its start, about the eye's x and y axes, rad; none
    about its own (Listing's law).
    """

    about_x_rad: float
    about_y_rad: float


STILL = EyeTurn(about_x_rad=0.0, about_y_rad=0.0)


def turned_plane(plane: ScanPlane, turn: EyeTurn) -> ScanPlane:
    """Return the plane of the B-scan, and with it the contact, in the turned eye's
    coordinates.
    """
    back = Rotation.from_rotvec([-turn.about_x_rad, -turn.about_y_rad, 0.0])
    normal = back.apply(plane.contact.normal)
    lateral = back.apply(plane.lateral)
    contact = Contact(
        polar_rad=acos(min(normal[2], 1.0)), azimuth_rad=atan2(normal[1], normal[0])
    )
    direction_rad = atan2(lateral @ contact.parallel, lateral @ contact.meridian)

    return ScanPlane(
        contact, gap_m=plane.gap_m, direction_rad=direction_rad, tilt_rad=plane.tilt_rad
    )


def farthest_turn_rad(phantom: PhantomStudy) -> float:
    """Return the largest turn of an eye; 0 for one that keeps still."""
    return phantom.eye_drift_rad.bounds[1] + phantom.eye_saccade_rad.bounds[1]


def draw_turns(
    phantom: PhantomStudy, times_s: Floats, rng: np.random.Generator
) -> tuple[EyeTurn, ...]:
    """Draw the turns of an eye at ascending times (frame,): a steady drift, and a
    saccade every `SACCADE_S`.
    """
    drift_rad = draw(phantom.eye_drift_rad, rng)
    heading = _unit_vectors(rng, 1)
    count = int(times_s[-1] / SACCADE_S) + 1
    saccades = phantom.eye_saccade_rad.sample(rng, count)[:, None] * _unit_vectors(
        rng, count
    )
    turns = (
        drift_rad * (times_s / times_s[-1])[:, None] * heading
        + saccades[(times_s / SACCADE_S).astype(np.intp)]
    )

    return tuple(EyeTurn(about_x_rad=x, about_y_rad=y) for x, y in turns.tolist())


def _unit_vectors(rng: np.random.Generator, count: int) -> Floats:
    """Draw directions in the plane, (count, 2)."""
    angles = rng.uniform(-pi, pi, count)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


class TurnedSections:
    """An eye's sections for needle forces in N at any turn, from those at each of
    `knot_turns(reach_rad)`.
    """

    def __init__(self, knots: Sequence["SectionsAt"], reach_rad: float) -> None:
        self.knots = tuple(knots)
        self.reach_rad = reach_rad

    def __call__(self, forces_n: Sequence[float]) -> Sequence[WallSection]:
        """Return the sections of the eye at its start; the load paths of all knots are
        then known.
        """
        return self.turned(forces_n, [STILL] * len(forces_n))

    def turned(
        self, forces_n: Sequence[float], turns: Sequence[EyeTurn]
    ) -> Sequence[WallSection]:
        """Return the sections at each force and turn."""
        each = zip(turns, *[knot(forces_n) for knot in self.knots], strict=True)
        return [
            blended(sections, knot_weights(turn, self.reach_rad))
            for turn, *sections in each
        ]


def knot_turns(reach_rad: float) -> tuple[EyeTurn, ...]:
    """Return the turns of the knots, for eyes that turn by up to `reach_rad`."""
    return (
        STILL,
        replace(STILL, about_x_rad=reach_rad),
        replace(STILL, about_y_rad=reach_rad),
    )


def knot_weights(turn: EyeTurn, reach_rad: float) -> Floats:
    """Return the weights of the knots at a turn, (knot,); they add up to 1."""
    x = turn.about_x_rad / reach_rad
    y = turn.about_y_rad / reach_rad
    return np.array([1.0 - x - y, x, y])


def blended(sections: Sequence[WallSection], weights: Floats) -> WallSection:
    """Return the weighted sum of sections, point by point along their curves, as far as
    all of them reach.
    """
    blended = []
    for curves in zip(
        *((section.outer, section.inner) for section in sections), strict=True
    ):
        along = [_from_needle_m(curve) for curve in curves]
        first_m = max(distance[0] for distance in along)
        last_m = min(distance[-1] for distance in along)
        shared_m = along[0][(along[0] >= first_m) & (along[0] <= last_m)]
        blended.append(np.zeros((len(shared_m), 2)))

        for weight, distance, curve in zip(weights, along, curves, strict=True):
            blended[-1] += weight * np.stack(
                [np.interp(shared_m, distance, axis) for axis in curve.T], axis=1
            )

    return WallSection(*blended)


def _from_needle_m(curve: Floats) -> Floats:
    """Return the distance of a curve's points along it from lateral 0, where it passes
    the needle; (point,), m.
    """
    along_m = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))]
    )
    nearest = int(np.abs(curve[:, 0]).argmin())
    beside = slice(max(nearest - 1, 0), nearest + 2)
    return along_m - np.interp(0.0, curve[beside, 0], along_m[beside])


SectionsAt = Callable[[Sequence[float]], Sequence[WallSection]]

CLEAR_N = 2e-3  # of the bounds of the classes, in the paper's design
# whose displacements are cut together: 30 MB of them at the default mesh
FORCES_AT_ONCE = 16
WEIGHTS_AT_ONCE = 256  # deformations, as weights of a few modes, that are cut together


def checked_virtual_eye(setup: Setup) -> Setup:
    """Return an experiment that can be made of a virtual eye.

    Raises:
        InputError: the name cannot be that of a folder; thickness, modulus, IOP, gap or
            polar angle is not declared or out of bounds.
    """
    modulus = setup.eye.modulus
    numbers = {
        "thickness_m": setup.eye.thickness_m,
        "youngs_modulus_pa": None if modulus is None else modulus.mean_pa,
        "iop_pa": setup.eye.iop_pa,
        "gap_m": setup.needle.gap_m,
        "polar_angle_rad": setup.needle.polar_rad,
    }
    for key, number in numbers.items():
        check_number_of_eye(setup, key, number)

    check_eye_name(eye_name(setup))
    return setup


def eye_name(setup: Setup) -> str:
    """Return the name of a virtual eye; raises `InputError` if it has none."""
    return declared(setup.eye.name, "eye: id")


def check_number_of_eye(setup: Setup, key: str, number: float | None) -> None:
    """Raise an `InputError` with the eye's name unless a number is declared and within
    the bounds of its key.
    """
    try:
        check_quantity(key, declared(number, key))
    except InputError as fault:
        raise InputError(f"eye {setup.eye.name}: {fault}") from None


def check_eye_name(name: str) -> None:
    """Raise an `InputError` if a name cannot be that of a virtual eye's folder."""
    if not name or "/" in name or name.startswith("."):
        raise InputError(f"eye: id: {name!r}; must be a name without /")


def scan_plane(setup: Setup) -> ScanPlane:
    """Return the plane of the B-scan; a direction or an azimuth that is not declared
    is 0.
    """
    contact = Contact(
        polar_rad=declared(setup.needle.polar_rad, "needle: polar_rad"),
        azimuth_rad=setup.needle.azimuth_rad or 0.0,
    )
    return ScanPlane(
        contact,
        gap_m=declared(setup.needle.gap_m, "needle: gap_m"),
        direction_rad=setup.scan.direction_rad or 0.0,
        tilt_rad=setup.scan.tilt_rad or 0.0,
    )


def study_sections(
    setup: Setup, study: Study, progress: Progress | None = None
) -> SectionsAt:
    """Return an eye's sections for needle forces in N, by the study: as it keeps still,
    turns or leaks.
    """
    if study.mechanics.kind == "finite-strain" and study.globe.leak_time_s:
        return LeakingSections(setup, study, progress)

    eyes = turned_eyes(setup, study)
    report = progress or (lambda _: None)
    knots = list[SectionsAt]()

    for number, (turned, own) in enumerate(eyes):
        if study.mechanics.kind == "linear":
            knots.append(LinearSections(turned, own))
        else:
            share = partial(
                lambda before, part: report((before + part) / len(eyes)), number
            )
            knots.append(BentSections(turned, own, share))

    return (
        knots[0]
        if len(knots) == 1
        else TurnedSections(knots, farthest_turn_rad(study.phantom))
    )


def turned_eyes(setup: Setup, study: Study) -> list[tuple[Setup, Study]]:
    """Return an eye as the needle and the scanner meet it at each of `knot_turns`;
    unchanged if it keeps still.
    """
    found = [(setup, study)]
    resting_plane = scan_plane(setup)
    reach_rad = farthest_turn_rad(study.phantom)

    for turn in knot_turns(reach_rad)[1:] if reach_rad else ():
        plane = turned_plane(resting_plane, turn)
        needle = study.needle
        if needle.tilt_rad:
            # its direction counts from the meridian, as that of the plane does
            direction_rad = (
                needle.tilt_direction_rad
                + plane.direction_rad
                - resting_plane.direction_rad
            )
            needle = replace(
                needle, tilt_direction_rad=remainder(direction_rad, 2.0 * pi)
            )

        turned = replace(
            setup,
            needle=replace(setup.needle, **asdict(plane.contact)),
            scan=replace(setup.scan, direction_rad=plane.direction_rad),
        )
        found.append((turned, replace(study, needle=needle)))

    return found


class BentSections:
    """An eye's sections for needle forces in N, and its pressure under them, from one
    finite-strain load path.

    A call with a larger force than before computes the path (some 10 s on one core);
    `progress` is called with the finished share. Everything but thickness, modulus,
    pressure and contact is the study's (`bend_eye`).
    """

    def __init__(
        self,
        setup: Setup,
        study: Study,
        progress: Progress | None = None,
        bent: LoadPath | None = None,
    ) -> None:
        self.setup = setup
        self._study = study
        self._progress = progress
        self._bent = bent

    def cut(
        self, forces_n: Sequence[float], planes: Sequence[ScanPlane]
    ) -> Sequence[WallSection]:
        """Return the section by a plane of its own at each force."""
        bent = self._bent_to(forces_n)
        states_nc = map(bent.displacement_nc, forces_n)
        each = zip(states_nc, planes, strict=True)
        return [
            cut_sections(bent.mesh, [plane], nc[None], np.ones((1, 1, 1)))[0][0]
            for nc, plane in each
        ]

    def __call__(self, forces_n: Sequence[float]) -> Sequence[WallSection]:
        """Return the sections."""
        bent = self._bent_to(forces_n)
        plane = scan_plane(self.setup)
        sections = list[WallSection]()

        for start in range(0, len(forces_n), FORCES_AT_ONCE):
            part = forces_n[start : start + FORCES_AT_ONCE]
            states_fnc = np.stack([bent.displacement_nc(force_n) for force_n in part])
            sections += cut_sections(
                bent.mesh, [plane], states_fnc, np.eye(len(part))[None]
            )[0]

        return sections

    def travels_m(self, forces_n: Sequence[float]) -> list[float]:
        """Return the tip's inward displacement from rest at each force, m."""
        return list(map(self._bent_to(forces_n).travel_m, forces_n))

    def pressures_pa(self, forces_n: Sequence[float]) -> list[float]:
        """Return the eye pressure at each force in Pa."""
        return list(map(self._bent_to(forces_n).pressure_pa, forces_n))

    def _bent_to(self, forces_n: Sequence[float]) -> LoadPath:
        largest_n = max(forces_n, default=0.0)
        if self._bent is None or self._bent.max_force_n < largest_n:
            eye = self.setup.eye
            self._bent = bend_eye(
                self._study,
                scan_plane(self.setup).contact,
                PathEnd(max_force=largest_n),
                thickness_m=declared(eye.thickness_m, "eye: thickness_m"),
                youngs_modulus_pa=eye.modulus_pa,
                iop_pa=declared(eye.iop_pa, "eye: iop_pa"),
                progress=self._progress,
            )

        return self._bent


LEAK_STEP_S = 0.05  # of a leak's clock
LEAK_FORCES = 64  # at which the pressures of its knots are taken
LEAK_KNOTS = 3  # leaked volumes
LEAK_REACH = 1.25  # the largest one over that of an eye whose dents do not grow
LEAST_LEAK_M3 = 1e-12


class LeakingSections(BentSections):
    """A leaking eye's sections and pressures, interpolated between load paths after a
    few leaked volumes, the knots.
    """

    def along(
        self, force_n: Callable[[Floats], Floats], times_s: Sequence[float]
    ) -> tuple[Sequence[WallSection], list[float]]:
        """Return sections, and pressures in Pa, at times; `force_n`: elastic force at
        times from 0 on.
        """
        if farthest_turn_rad(self._study.phantom):
            raise StudyError(
                "globe.leak_time_s: of an eye that keeps still; leave out"
                " eye_drift_deg, eye_saccade_deg"
            )

        law = study_law(self._study.globe)
        iop_pa = declared(self.setup.eye.iop_pa, "eye: iop_pa")
        clock_s = np.arange(0.0, times_s[-1] + LEAK_STEP_S, LEAK_STEP_S)
        driven_n = force_n(clock_s)
        at_n = force_n(np.array(times_s)).tolist()
        grid_n = np.linspace(0.0, max([*driven_n, *at_n]), LEAK_FORCES)
        leaked = partial(
            law.leaked_m3,
            iop_pa,
            self._study.globe.leak_time_s / LEAK_STEP_S,
            driven_n,
        )
        dents_m3 = law.displaced_m3(
            iop_pa, np.array(self.pressures_pa(grid_n.tolist()))
        )
        alike_m3 = leaked(
            lambda at, left: float(
                law.pressure(iop_pa, np.interp(at, grid_n, dents_m3) - left)
            )
        )
        knots_m3 = np.linspace(0.0, LEAK_REACH * alike_m3.max(), LEAK_KNOTS)
        rests_pa = law.pressure(iop_pa, -knots_m3).tolist()
        softer = [
            replace(self.setup, eye=replace(self.setup.eye, iop_pa=rest_pa))
            for rest_pa in rests_pa[1:]
        ]
        knots = [self, *(BentSections(setup, self._study) for setup in softer)]
        grids_pa = np.array([knot.pressures_pa(grid_n.tolist()) for knot in knots])
        parabolas = np.linalg.inv(
            np.vander(np.linspace(0.0, 1.0, LEAK_KNOTS), increasing=True)
        ).T
        largest_m3 = max(knots_m3[-1], LEAST_LEAK_M3)

        def weights(leaked_m3: float) -> Floats:
            return parabolas @ (leaked_m3 / largest_m3) ** np.arange(LEAK_KNOTS)

        def pressed(at_n: float, leaked_m3: float) -> float:
            return float(
                weights(leaked_m3)
                @ [np.interp(at_n, grid_n, grid_pa) for grid_pa in grids_pa]
            )

        left_m3 = np.interp(times_s, clock_s, leaked(pressed)).tolist()
        each = zip(left_m3, *(knot(at_n) for knot in knots), strict=True)
        return [blended(sections, weights(left)) for left, *sections in each], [
            pressed(force, left) for force, left in zip(at_n, left_m3, strict=True)
        ]


def pressures_pa(
    setup: Setup,
    sections_at: SectionsAt,
    forces_n: Sequence[float],
    turns: Sequence[EyeTurn] = (),
) -> list[float]:
    """Return the pressure of an eye at each force (and turn), Pa; only sealed globes
    change it.
    """
    if isinstance(sections_at, TurnedSections) and turns:
        at_knots = [pressures_pa(setup, knot, forces_n) for knot in sections_at.knots]
        weights = [knot_weights(turn, sections_at.reach_rad) for turn in turns]
        return [
            float(weight @ found)
            for weight, *found in zip(weights, *at_knots, strict=True)
        ]

    if isinstance(sections_at, BentSections):
        return sections_at.pressures_pa(forces_n)

    return [declared(setup.eye.iop_pa, "eye: iop_pa")] * len(forces_n)


def linear_wall(
    study: Study,
    command: str,
    thickness_m: float,
    contact: Contact,
    youngs_modulus_pa: float,
) -> LinearWall:
    """Factor a wall on the study's supports; a command's study must have no keys that
    linear mechanics does not use.
    """
    refuse_unused(study, command, "linear")
    mesh = supported_mesh(study, thickness_m, contact, alone=command == "simulate")
    springs = study_springs(study.supports, mesh)
    return LinearWall(
        mesh,
        study.eye.poisson_ratio,
        springs=springs,
        springs_modulus_pa=youngs_modulus_pa,
    )


class LinearSections:
    """An eye's sections for needle forces in N, from linear mechanics, factored
    once.
    """

    def __init__(self, setup: Setup, study: Study) -> None:
        thickness_m = declared(setup.eye.thickness_m, "eye: thickness_m")
        self._modulus_pa = setup.eye.modulus_pa
        self._iop_pa = declared(setup.eye.iop_pa, "eye: iop_pa")
        self._plane = scan_plane(setup)
        contact = self._plane.contact
        wall = linear_wall(study, "phantom", thickness_m, contact, self._modulus_pa)
        self._needle_nc = wall.needle_cnc([contact], study.needle.outer_diameter_m / 2)[
            0
        ]
        self._modes_knc = np.stack([wall.pressure_nc, wall.gravity_nc, self._needle_nc])
        self._mesh = wall.mesh
        self._weight_n_m3 = study.eye.density_kg_m3 * STANDARD_GRAVITY_M_S2

    def __call__(self, forces_n: Sequence[float]) -> Sequence[WallSection]:
        """Return the sections."""
        loads = [[self._iop_pa, self._weight_n_m3, force_n] for force_n in forces_n]
        weights_fk = np.array(loads) / self._modulus_pa
        sections = list[WallSection]()

        for start in range(0, len(loads), WEIGHTS_AT_ONCE):
            part = weights_fk[None, start : start + WEIGHTS_AT_ONCE]
            sections += cut_sections(self._mesh, [self._plane], self._modes_knc, part)[
                0
            ]

        return sections

    def travels_m(self, forces_n: Sequence[float]) -> list[float]:
        """Return the tip's inward displacement from rest at each force, m."""
        unit_m = (
            tip_displacement(self._mesh, self._plane.contact, self._needle_nc)
            / self._modulus_pa
        )
        return [force_n * unit_m for force_n in forces_n]


def paper_eyes(
    study: Study, *, to_the_bounds: bool = False
) -> tuple[tuple[Setup, tuple[float, ...]], ...]:
    """Return the five virtual eyes of the paper's design (Tables 1 and 2), each with
    its forces in N, 45 in all.

    Moduli are Table 2's and, for the fifth, its mean. The forces of a class are spread
    evenly over it, 2 mN clear of its bounds (a label is uncertain by about 1 mN), or
    with `to_the_bounds` drawn from the whole of it. Contact angles, which the paper
    does not give ("near the limbus"), spread over the study's range.
    """
    # the trials of each class; the contact's place in the study's range
    design = (
        ("eye-1", 800e-6, 0.27e6, (0, 11, 14), 0.5),
        ("eye-2", 500e-6, 0.22e6, (1, 2, 2), 0.1),
        ("eye-3", 650e-6, 0.24e6, (2, 0, 3), 0.7),
        ("eye-4", 560e-6, 0.29e6, (2, 1, 2), 0.3),
        ("eye-5", 800e-6, 0.25e6, (2, 1, 2), 0.9),
    )
    low, high = study.needle.polar_angle_rad.bounds
    limits_n = (0.0, *study.classes.bounds_n, study.needle.max_force_n)
    rng = np.random.default_rng((study.phantom.seed, 45))
    eyes = []

    for name, thickness_m, modulus_pa, trials, place in design:
        polar_rad = round(low + place * (high - low), 6)
        eye = Eye(
            name,
            thickness_m=thickness_m,
            modulus=Modulus.stated(modulus_pa),
            iop_pa=study.eye.iop_pa,
        )
        needle = Needle(
            gap_m=study.needle.gap_m,
            polar_rad=polar_rad,
            azimuth_rad=radians(360 * place),
        )
        forces_n: list[float] = []

        for target, count in enumerate(trials):
            low_n = limits_n[target]
            high_n = limits_n[target + 1]
            first_n = 0.0 if target == 0 else low_n + CLEAR_N
            last_n = high_n - CLEAR_N
            drawn_n = [
                first_n + (last_n - first_n) * (index + 0.5) / count
                for index in range(count)
            ]

            if to_the_bounds:
                drawn_n = sorted(rng.uniform(low_n, high_n, count).tolist())

            forces_n += [round(force_n, 7) for force_n in drawn_n]

        step = next(step for step in (7, 5, 3, 2, 1) if len(forces_n) % step)
        # An order that mixes the classes and starts with the largest force: a clear
        # first contact.
        eyes.append(
            (
                Setup(eye=eye, needle=needle),
                tuple(
                    forces_n[-1 - (index * step) % len(forces_n)]
                    for index in range(len(forces_n))
                ),
            )
        )

    return tuple(eyes)


# cell types of meshio by their number of nodes
CELLS = {
    8: "hexahedron",
    20: "hexahedron20",
    27: "hexahedron27",
}


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedEye:
    """A wall with the needle on it."""

    mesh: HexMesh
    contact: Contact
    force_n: float  #: on the needle
    displacement_nc: Floats  #: (node, 3), from the unloaded wall, m
    # : (node, 3), the needle's part of it, from the state under IOP and gravity
    needle_nc: Floats
    # : inward displacement of the outer surface at the contact along the needle axis
    # from that state
    tip_m: float
    # : the same from the undented wall at `pressure_pa`, larger in a sealed globe
    dent_m: float
    pressure_pa: float  #: under the needle
    slice: Bytes  #: (rows, columns), 255 = wall, in `window`
    window: SliceWindow

    def __repr__(self) -> str:
        return (
            f"<SimulatedEye: {from_si(self.force_n, 'mn'):.1f} mN, dent of"
            f" {from_si(self.dent_m, 'mm'):.2f} mm>"
        )

    def to_meshio(self) -> Any:
        """Return meshio's mesh: undeformed, with the node fields `displacement` and
        `needle_displacement`, m.
        """
        # 28 ms: not for those who write no mesh
        import meshio  # type: ignore[import-untyped]  # comes without types

        fields = {
            "displacement": self.displacement_nc,
            "needle_displacement": self.needle_nc,
        }
        cells = [(CELLS[self.mesh.cells_en.shape[1]], self.mesh.cells_en)]

        return meshio.Mesh(self.mesh.points_nc, cells, point_data=fields)

    def to_pyvista(self) -> Any:
        """Return `to_meshio` as a grid of PyVista, to warp and plot; raises
        `InputError` without that package.
        """
        return package_for("pyvista", "to_pyvista", "mesh").from_meshio(
            self.to_meshio()
        )


def simulate_eye(
    study: Study,
    thickness_m: float,
    force_n: float,
    contact: Contact,
    progress: Progress | None = None,
    displacement_m: float | None = None,
) -> SimulatedEye:
    """Bend a wall by the study's `[mechanics]` and `[globe]` and cut its slice beside
    the needle.

    A `displacement_m` of the tip from rest takes precedence over the force, which is
    then found.
    """
    eye = study.eye
    modulus_pa = eye.youngs_modulus_pa
    iop_pa = eye.iop_pa

    if study.mechanics.kind == "linear":
        wall = linear_wall(study, "simulate", thickness_m, contact, modulus_pa)
        unit_nc = wall.needle_cnc([contact], 0.5 * study.needle.outer_diameter_m)[0]
        loads = {
            "youngs_modulus_pa": modulus_pa,
            "iop_pa": iop_pa,
            "density_kg_m3": eye.density_kg_m3,
        }

        if displacement_m is not None:
            force_n = (
                displacement_m
                * modulus_pa
                / tip_displacement(wall.mesh, contact, unit_nc)
            )

        states_nc = (
            wall.displacement(unit_nc, 0.0, **loads),
            wall.displacement(unit_nc, force_n, **loads),
        )
        mesh = wall.mesh
        pressure_pa = iop_pa
        tip_m = dent_m = tip_displacement(mesh, contact, states_nc[1] - states_nc[0])
    else:
        path = bend_eye(
            study,
            contact,
            (
                PathEnd(max_force=force_n)
                if displacement_m is None
                else PathEnd(max_travel_m=displacement_m)
            ),
            thickness_m=thickness_m,
            youngs_modulus_pa=modulus_pa,
            iop_pa=iop_pa,
            progress=progress,
        )
        mesh = path.mesh
        dent_m = (
            path.tip_m(force_n)
            if displacement_m is None
            else path.tip_of_travel_m(displacement_m)
        )
        states_nc = path.displacement_nc(0.0), path.displacement_at_tip_nc(dent_m)
        found_n, pressure_pa, tip_m = path.at_tip(dent_m)
        force_n = force_n if displacement_m is None else found_n

    plane = ScanPlane(contact, gap_m=study.needle.gap_m)
    resting, loaded = cut_sections(mesh, [plane], np.stack(states_nc), np.eye(2)[None])[
        0
    ]
    window = slice_window(study.slice, top_m=float(resting.outer[:, 1].min()))

    return SimulatedEye(
        mesh=mesh,
        contact=contact,
        force_n=force_n,
        displacement_nc=states_nc[1],
        needle_nc=states_nc[1] - states_nc[0],
        tip_m=tip_m,
        dent_m=dent_m,
        pressure_pa=pressure_pa,
        slice=fill_section(loaded, window),
        window=window,
    )


def write_vtu(eye: SimulatedEye, path: Path) -> None:
    """Write an eye's `to_meshio` as a file of VTK."""
    with renamed_when_whole(path) as part:
        eye.to_meshio().write(part, file_format="vtu")
