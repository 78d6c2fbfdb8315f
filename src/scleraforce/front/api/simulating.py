"""Virtual eyes: one under one force, or a whole recording of one."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import radians
from os import PathLike
from pathlib import Path
from typing import Any

from scleraforce.base.errors import InputError
from scleraforce.front.api.progress import (
    Counting,
    by_percent,
    check_rigidity,
    counting_for,
)
from scleraforce.lab.virtual_eye import (
    PhantomEye,
    SimulatedEye,
    simulate_eye,
    study_sections,
)
from scleraforce.lab.virtual_recording import (
    in_planes,
    plan_moving_phantom,
    plan_phantom,
    write_phantom,
)
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.fields import check_quantity
from scleraforce.records.scan import Plane, check_planes
from scleraforce.records.study import Study, fixed, refuse_unused


def simulate(
    study: Study | None = None,
    *,
    thickness_m: float,
    force_n: float | None = None,
    displacement_m: float | None = None,
    youngs_modulus_pa: float | None = None,
    iop_pa: float | None = None,
    gap_m: float | None = None,
    polar_angle_rad: float | None = None,
    mechanics: str | None = None,
    globe: str | None = None,
    rigidity_pa13_per_m3: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> SimulatedEye:
    r"""Bend one eye by one force.

    Args:
        study: the study; None: the paper's. Arguments below that are omitted take its
            values.
        thickness_m: of the wall.
        force_n: of the needle, along the inward normal; or give `displacement_m`.
        displacement_m: of the outer surface at the contact, inward from rest (`tip_m`);
            the force that causes it is found. In a sealed globe the dent is deeper
            (`dent_m`).
        youngs_modulus_pa: of the wall.
        iop_pa: intraocular pressure.
        gap_m: distance of the B-scan plane from the needle axis.
        polar_angle_rad: of the contact, from the pole; None: the middle of the study's
            range.
        mechanics: "linear" or "finite-strain".
        globe: "open" or "sealed" (finite strain only).
        rigidity_pa13_per_m3: of a sealed globe (`[globe]` of the study has it in
            mmHg^(1/3) per µl).
        progress: called with the completed share of the load path (finite strain).

    Returns:
        Mesh, displacements, `force_n`, the tip's displacement `tip_m`, the pressure
        under the needle, binary `slice`.

    Raises:
        InputError: neither or both of force and displacement are given.
        StudyError: a value is out of bounds, or the study has keys that this mechanics
            does not use.
        SolverError: no equilibrium was found, or the wall deforms too much to be cut.

    >>> import scleraforce as sf
    >>> coarse = sf.parse_study("[mesh]\ndivisions = 6")
    >>> eye = sf.simulate(coarse, thickness_m=600e-6, force_n=0.010)
    >>> print(f"the contact sinks in by {eye.tip_m * 1e3:.1f} mm")
    the contact sinks in by 0.5 mm
    >>> eye.slice.shape
    (40, 140)
    >>> dented = sf.simulate(coarse, thickness_m=600e-6, displacement_m=eye.tip_m)
    >>> print(f"{dented.force_n * 1e3:.1f} mN")
    10.0 mN
    """
    study = declared_study(study, mechanics, globe, rigidity_pa13_per_m3)
    refuse_unused(study, "simulate", study.mechanics.kind)
    if (force_n is None) is (displacement_m is None):
        raise InputError("simulate: give either force_n or displacement_m")

    for name, value in given_values(
        force_n=force_n, displacement_m=displacement_m
    ).items():
        check_quantity(name, value)

    polar = None if polar_angle_rad is None else fixed(polar_angle_rad)
    eye = replace(
        study.eye,
        thickness_m=fixed(thickness_m),
        **given_values(youngs_modulus_pa=youngs_modulus_pa, iop_pa=iop_pa),
    )
    needle = replace(study.needle, **given_values(polar_angle_rad=polar, gap_m=gap_m))
    contact = Contact(polar_rad=sum(needle.polar_angle_rad.bounds) / 2)
    study = replace(study, eye=eye, needle=needle)

    return simulate_eye(
        study, thickness_m, force_n or 0.0, contact, progress, displacement_m
    )


def phantom(
    out: str | PathLike[str],
    study: Study | None = None,
    *,
    forces_n: Sequence[float],
    thickness_m: float,
    eye: str = "eye-1",
    youngs_modulus_pa: float | None = None,
    iop_pa: float | None = None,
    gap_m: float | None = None,
    polar_angle_rad: float = radians(35.0),
    azimuth_rad: float = 0.0,
    direction_rad: float = 0.0,
    tilt_rad: float = 0.0,
    mechanics: str | None = None,
    globe: str | None = None,
    rigidity_pa13_per_m3: float | None = None,
    seed: int | None = None,
    rate_hz: float | None = None,
    ramp_n_per_s: float | None = None,
    hold_s: float | None = None,
    puncture_n: float | None = None,
    planes: Sequence[Plane] = (),
    progress: Callable[[int], object] | None = None,
    counting: Counting | None = None,
) -> Recording:
    r"""Make a virtual acquisition: a recording folder of raw B-scans and a force log,
    with its truth.

    Args:
        out: the folder to write; it must not exist.
        study: the study; None: the paper's. Its `[phantom]` has the ranges of light,
            noise and timing.
        forces_n: true force at each frame, one step-and-hold push each; with `rate_hz`
            the turning points of the force.
        thickness_m: of the wall.
        eye: its name.
        youngs_modulus_pa: of the wall; None: the study's, as for IOP and gap.
        iop_pa: intraocular pressure.
        gap_m: distance of the B-scan plane from the needle axis.
        polar_angle_rad: of the contact, from the pole.
        azimuth_rad: of the contact, about the pole.
        direction_rad: of the B-scan plane, about the needle axis.
        tilt_rad: of the B-scan plane, against the needle axis.
        mechanics: "linear" or "finite-strain"; None: the study's.
        globe: "open" or "sealed" (finite strain only); None: the study's.
        rigidity_pa13_per_m3: of a sealed globe; None: the study's.
        seed: of all random choices; None: the study's.
        rate_hz: frames a second of a needle that moves; None: it is held at each force.
        ramp_n_per_s: how fast the force of a moving needle changes; None: 0.02.
        hold_s: how long a moving needle stays at each force; None: 1.
        puncture_n: force at which a moving needle goes through the wall, after the
            others; its travel is recorded.
        planes: that the scanner takes at once, as a cross of two; its axis then misses
            the contact by the gap.
        progress: called with 1 after each frame.
        counting: for bars, in place of `progress`: a context manager of a title ("load
            path" in per cent, "frames") and its steps.

    Raises:
        InputError: `out` exists, a value is out of bounds, or the study has keys that
            this mechanics does not use.
        SolverError: no equilibrium was found.

    >>> import scleraforce as sf
    >>> coarse = sf.parse_study("[mesh]\ndivisions = 6")
    >>> forces_n = [0.004, 0.020]
    >>> recording = sf.phantom("eye-new", coarse, thickness_m=600e-6, forces_n=forces_n)
    >>> [frame.file for frame in recording.frames]
    ['0001.png', '0002.png']
    """
    study = declared_study(study, mechanics, globe, rigidity_pa13_per_m3)
    refuse_unused(study, "phantom", study.mechanics.kind)
    if Path(out).exists():
        raise InputError(f"{out}: exists already; remove it or choose another name")

    counting = counting or counting_for(progress, "frames")
    eyes = {
        "youngs_modulus_pa": study.eye.youngs_modulus_pa,
        "iop_pa": study.eye.iop_pa,
        "gap_m": study.needle.gap_m,
    }
    eyes |= given_values(
        youngs_modulus_pa=youngs_modulus_pa, iop_pa=iop_pa, gap_m=gap_m
    )
    directions = {
        "azimuth_rad": azimuth_rad,
        "direction_rad": direction_rad,
        "tilt_rad": tilt_rad,
    }
    pushed = PhantomEye(
        id=eye, thickness_m=thickness_m, polar_rad=polar_angle_rad, **eyes, **directions
    )
    seed = study.phantom.seed if seed is None else seed

    if rate_hz is None and puncture_n is not None:
        raise InputError("puncture_n: of a needle that moves; give rate_hz too")

    if rate_hz is None:
        plan = plan_phantom(pushed, tuple(forces_n), study, seed)
    else:
        moves = {"rate_hz": rate_hz, "ramp_n_per_s": 20e-3, "hold_s": 1.0}
        moves |= given_values(
            ramp_n_per_s=ramp_n_per_s, hold_s=hold_s, puncture_n=puncture_n
        )
        plan = plan_moving_phantom(pushed, tuple(forces_n), study, seed, **moves)

    if planes:
        check_planes(tuple(planes))
        plan = in_planes(plan, planes, study)

    with counting("load path", 100) as advance:
        sections_at = study_sections(pushed, study, by_percent(advance))
        # a load path is computed here, once
        sections_at([max(*plan.forces_n, puncture_n or 0.0)])

    with counting("frames", len(plan.frames)) as advance:
        write_phantom(Path(out), plan, sections_at, study, advance)

    return read_recording(out)


def declared_study(
    study: Study | None,
    mechanics: str | None,
    globe: str | None,
    rigidity_pa13_per_m3: float | None,
) -> Study:
    """Return a study, by default the paper's, with the mechanics and the globe that are
    given.
    """
    study = study or Study()
    if mechanics is not None:
        study = replace(study, mechanics=replace(study.mechanics, kind=mechanics))
    check_rigidity(globe or study.globe.kind, rigidity_pa13_per_m3)
    return replace(study, globe=study.globe.with_known(globe, rigidity_pa13_per_m3))


def given_values(**values: Any) -> dict[str, Any]:
    """Return the values that are not None."""
    return {name: value for name, value in values.items() if value is not None}
