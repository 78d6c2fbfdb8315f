"""Virtual eyes: one under one force, or a whole recording of one."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import Field, fields, replace
from math import radians
from os import PathLike
from pathlib import Path
from typing import Any, Unpack

from scleraforce.base.errors import InputError
from scleraforce.front.api.progress import (
    Progress,
    by_percent,
    check_rigidity,
    counting_for,
)
from scleraforce.front.api.shorthand import EyeShorthand, declared_setup
from scleraforce.lab.virtual_eye import (
    SimulatedEye,
    check_eye_name,
    checked_virtual_eye,
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
from scleraforce.records.eye import Eye
from scleraforce.records.fields import check_kind, check_quantity, declared
from scleraforce.records.globe import Globe
from scleraforce.records.motion import Motion
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup, completed_by_study
from scleraforce.records.study import Study, fixed, refuse_unused
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

EYE_NAME = "eye-1"
POLAR_RAD = radians(35.0)
# what a virtual eye is made of; the study has the rest
OF_EYE = ("name", "modulus", "iop_pa", "thickness_m", "globe")
OF_NEEDLE = ("gap_m", "polar_rad", "azimuth_rad")
OF_SCAN = ("direction_rad", "tilt_rad", "planes")


class PhantomShorthand(EyeShorthand, total=False):
    """Fields of a virtual eye; `mechanics`: "linear" or "finite-strain" (None: the
    study's); `seed`: of all random choices (None: the study's).
    """

    mechanics: str | None
    seed: int | None


def simulate(
    study: Study | None = None,
    *,
    force_n: float | None = None,
    displacement_m: float | None = None,
    eye: Eye | str | None = None,
    needle: Needle | None = None,
    mechanics: str | None = None,
    progress: Callable[[float], object] | None = None,
    **short: Unpack[EyeShorthand],
) -> SimulatedEye:
    r"""Bend one eye by one force.

    Args:
        study: the study; None: the paper's. It has the values that `eye` and `needle`
            do not declare, but for the thickness.
        force_n: of the needle, along the inward normal; or give `displacement_m`.
        displacement_m: of the outer surface at the contact, inward from rest (`tip_m`);
            the force that causes it is found. In a sealed globe the dent is deeper
            (`dent_m`).
        eye: thickness, modulus, IOP, and the globe (sealed: finite strain only); of a
            modulus the mean.
        needle: gap and contact; without a polar angle it pushes in the middle of the
            study's range.
        mechanics: "linear" or "finite-strain"; None: the study's.
        progress: called with the completed share of the load path (finite strain).
        short: fields of the eye and the needle (`EyeShorthand`), like
            `thickness_m=600e-6`.

    Returns:
        Mesh, displacements, `force_n`, the tip's displacement `tip_m`, the pressure
        under the needle, binary `slice`.

    Raises:
        InputError: neither or both of force and displacement are given, no thickness is
            declared, or a record declares what is the study's.
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
    setup = declared_setup(eye, needle, None, short)
    refuse_unused_fields("simulate", setup)
    study = study_with_globe(declared_study(study, mechanics), setup.eye.globe)
    refuse_unused(study, "simulate", study.mechanics.kind)
    if (force_n is None) is (displacement_m is None):
        raise InputError("simulate: give either force_n or displacement_m")

    for name, value in given_values(
        force_n=force_n, displacement_m=displacement_m
    ).items():
        check_quantity(name, value)

    declared_polar_rad = setup.needle.polar_rad
    setup = completed_by_study(setup, study)
    thickness_m = declared(setup.eye.thickness_m, "thickness_m")
    polar_rad = declared(setup.needle.polar_rad, "polar_rad")
    contact = Contact(polar_rad=polar_rad, azimuth_rad=setup.needle.azimuth_rad or 0.0)
    of_eye = replace(
        study.eye,
        thickness_m=fixed(thickness_m),
        youngs_modulus_pa=setup.eye.modulus_pa,
        iop_pa=declared(setup.eye.iop_pa, "iop_pa"),
    )
    of_needle = replace(study.needle, gap_m=declared(setup.needle.gap_m, "gap_m"))
    if declared_polar_rad is not None:
        of_needle = replace(of_needle, polar_angle_rad=fixed(declared_polar_rad))

    return simulate_eye(
        replace(study, eye=of_eye, needle=of_needle),
        thickness_m,
        force_n or 0.0,
        contact,
        progress,
        displacement_m,
    )


def phantom(
    out: str | PathLike[str],
    study: Study | None = None,
    *,
    forces_n: Sequence[float],
    eye: Eye | str | None = None,
    needle: Needle | None = None,
    scan: Scan | None = None,
    motion: Motion | None = None,
    progress: Progress | None = None,
    **short: Unpack[PhantomShorthand],
) -> Recording:
    r"""Make a virtual acquisition: a recording folder of raw B-scans and a force log,
    with its truth.

    Args:
        out: the folder to write; it must not exist.
        study: the study; None: the paper's. It has the values that the records do not
            declare, but for the thickness; its `[phantom]` has the ranges of light,
            noise and timing.
        forces_n: true force at each frame, one step-and-hold push each; with `motion`
            the turning points of the force.
        eye: name (None: "eye-1"), thickness, modulus, IOP, and the globe (sealed:
            finite strain only); of a modulus the mean.
        needle: gap of the B-scan plane, and contact; without a polar angle it is 35
            degrees from the pole.
        scan: direction and tilt of the B-scan plane, and `planes` that the scanner
            takes at once, as a cross of two; its axis then misses the contact by the
            gap.
        motion: of a needle that moves; None: it is held at each force.
        progress: called with 1 after each frame; or `Bars` of the titles "load path"
            (in per cent) and "frames".
        short: fields of the eye and the needle, `mechanics` and `seed`
            (`PhantomShorthand`).

    Raises:
        InputError: `out` exists, a value is out of bounds, no thickness is declared, a
            record declares what is the study's, or the study has keys that this
            mechanics does not use.
        SolverError: no equilibrium was found.

    >>> import scleraforce as sf
    >>> coarse = sf.parse_study("[mesh]\ndivisions = 6")
    >>> forces_n = [0.004, 0.020]
    >>> recording = sf.phantom("eye-new", coarse, thickness_m=600e-6, forces_n=forces_n)
    >>> [frame.file for frame in recording.frames]
    ['0001.png', '0002.png']
    """
    mechanics = short.pop("mechanics", None)
    seed = short.pop("seed", None)
    if isinstance(eye, str):
        check_eye_name(eye)
    declared_values = declared_setup(eye, needle, scan, short)
    refuse_unused_fields("phantom", declared_values)

    study = declared_study(study, mechanics)
    study = study_with_globe(study, declared_values.eye.globe)
    refuse_unused(study, "phantom", study.mechanics.kind)
    if Path(out).exists():
        raise InputError(f"{out}: exists already; remove it or choose another name")

    defaults = Setup(eye=Eye(EYE_NAME), needle=Needle(polar_rad=POLAR_RAD))
    setup = completed_by_study(declared_values.completed_by(defaults), study)
    checked_virtual_eye(setup)
    seed = study.phantom.seed if seed is None else seed

    if motion is None:
        plan = plan_phantom(setup, tuple(forces_n), study, seed)
        largest_n = max(plan.forces_n)
    else:
        plan = plan_moving_phantom(setup, tuple(forces_n), study, seed, motion)
        largest_n = max(*plan.forces_n, motion.puncture_n or 0.0)

    if setup.scan.planes:
        plan = in_planes(plan, setup.scan.planes, study)

    counting = counting_for(progress, "frames")
    with counting("load path", 100) as advance:
        sections_at = study_sections(setup, study, by_percent(advance))
        # a load path is computed here, once
        sections_at([largest_n])

    with counting("frames", len(plan.frames)) as advance:
        write_phantom(Path(out), plan, sections_at, study, advance)

    return read_recording(out)


def declared_study(
    study: Study | None,
    mechanics: str | None,
    globe: str | None = None,
    rigidity_pa13_per_m3: float | None = None,
) -> Study:
    """Return a study, by default the paper's, with the mechanics and the globe that are
    given.
    """
    study = study or Study()
    check_kind("study", study, Study, 'read_study("study.toml")')
    if mechanics not in (None, "linear", "finite-strain"):
        raise InputError(f"mechanics: {mechanics!r}; give 'linear' or 'finite-strain'")
    if mechanics is not None:
        study = replace(study, mechanics=replace(study.mechanics, kind=mechanics))
    check_rigidity(globe or study.globe.kind, rigidity_pa13_per_m3)
    return replace(study, globe=study.globe.with_known(globe, rigidity_pa13_per_m3))


def study_with_globe(study: Study, globe: Globe | None) -> Study:
    """Return a study with a declared globe: its kind, and of a sealed one the rigidity,
    a law other than the cube root, and the leak, as far as they are declared.

    Raises:
        InputError: the globe is unknown.
    """
    if globe is None:
        return study
    if globe.kind == "unknown":
        raise InputError(
            "eye.globe: unknown; a virtual eye is open or sealed, or leave it out for"
            " the study's"
        )

    has_rigidity = globe.rigidity_told or globe.calibrated
    known = study.globe.with_known(globe.kind, globe.mean if has_rigidity else None)
    if globe.law != RIGIDITY_LAWS[0]:
        known = replace(known, rigidity_law=globe.law)
    if globe.leak_time_s is not None:
        known = replace(known, leak_time_s=globe.leak_time_s)
    return replace(study, globe=known)


def refuse_unused_fields(function: str, setup: Setup) -> None:
    """Raise an `InputError` that names a declared field that no virtual eye is made
    of.
    """
    parts = (
        ("eye", setup.eye, OF_EYE),
        ("needle", setup.needle, OF_NEEDLE),
        ("scan", setup.scan, OF_SCAN),
    )
    for part, record, used in parts:
        items: Iterable[Field[Any]] = fields(record)
        for item in items:
            if item.name not in used and getattr(record, item.name) != item.default:
                raise InputError(
                    f"{part}.{item.name}: not used by `{function}`; leave it out, the"
                    " study has what a virtual eye needs beside"
                    f" {', '.join((*OF_EYE, *OF_NEEDLE, *OF_SCAN))}"
                )


def given_values(**values: Any) -> dict[str, Any]:
    """Return the values that are not None."""
    return {name: value for name, value in values.items() if value is not None}
