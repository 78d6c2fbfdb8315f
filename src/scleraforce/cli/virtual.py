"""`scleraforce simulate` and `phantom`: virtual eyes."""

from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from scleraforce.cli.options import PATH, PLANE, Quantity, in_si, new_file, options, parse_plane
from scleraforce.cli.output import Command, Report, count_bar, share_bar
from scleraforce.study import Study
from scleraforce.units import from_si, to_si

if TYPE_CHECKING:
    from scleraforce.laboratory.virtual_eye import SimulatedEye

STUDYS = "the study's"
GLOBE, RIGIDITY = f"{STUDYS} (open, if it sets none); sealed needs finite strain", f"{STUDYS} (0.03, if it sets none)"
MECHANICS = "Small displacements (linear) or large ones; default: the study's (linear, if it sets none)."
THICKNESS_M, POLAR_RAD = to_si(600.0, "um"), to_si(35.0, "deg")


@click.command(cls=Command)
@options("study", "thickness_m", required=("thickness_m",))
@click.option("--force-mn", "force_n", type=Quantity("force_mn"),
              help="Force of the needle, along the inward normal; this or --displacement-mm.")  # fmt: skip
@click.option("--displacement-mm", "displacement_m", type=Quantity("displacement_mm"),
              help="Find the force that moves the contact inward by this, from rest.")  # fmt: skip
@options("youngs_modulus_pa", "iop_pa", "polar_angle_rad", "gap_m", "globe", "rigidity_pa13_per_m3", "mechanics",
         default=STUDYS, polar_angle_rad="the middle of the study's range", globe=GLOBE,
         rigidity_pa13_per_m3=RIGIDITY, mechanics=MECHANICS)  # fmt: skip
@click.option("--vtu", type=PATH, callback=new_file, help="File to write: the mesh and its displacement (VTK).")
@options("plot", plot="Picture to write: the deformed mesh and the slice (PNG, SVG, PDF).")  # fmt: skip
def simulate(study: Study, vtu: Path | None, plot: Path | None, **given: Any) -> Report:
    """Bend one eye by one force: displacement, slice, picture.

    Example: scleraforce simulate --thickness-um 500 --force-mn 30 --plot eye.png

    The force that makes a dent: scleraforce simulate --thickness-um 500 --displacement-mm 1
    """
    if (given["force_n"] is None) is (given["displacement_m"] is None):
        raise click.UsageError("give either --force-mn or --displacement-mm")
    import scleraforce as sf
    from scleraforce.laboratory.virtual_eye import write_vtu
    from scleraforce.notebook.virtual import declared

    study = declared(study, *(given.pop(name) for name in ("mechanics", "globe", "rigidity_pa13_per_m3")))
    start = perf_counter()
    with share_bar("load path") as reach:
        eye = sf.simulate(study, progress=reach, **given)
    seconds = perf_counter() - start
    if vtu is not None:
        write_vtu(eye, vtu)
    if plot is not None:
        from scleraforce.report.files import write_figure
        from scleraforce.report.model_figures import draw_simulation

        write_figure(draw_simulation(eye), plot)
    result = {
        "force_mn": from_si(eye.force_n, "mn"),
        "tip_displacement_mm": from_si(eye.tip_m, "mm"),
        "dent_mm": from_si(eye.dent_m, "mm"),
        "pressure_mmhg": from_si(eye.pressure_pa, "mmhg"),
        "globe": study.globe.kind,
        "stiffening": study.tissue.stiffening,
        "elements": len(eye.mesh.cells_en),
        "dofs": eye.mesh.points_nc.size,
        "seconds": round(seconds, 3),
        "mechanics": study.mechanics.kind,
    }
    resting_pa = study.eye.iop_pa if given["iop_pa"] is None else given["iop_pa"]
    size = f"{result['elements']} elements, {result['dofs']} unknowns, {seconds:.1f} s"
    written = [f"wrote {path}" for path in (vtu, plot) if path is not None]
    return Report(result, [*_lines(eye, study, resting_pa), size, *written])


def _lines(eye: "SimulatedEye", study: Study, resting_pa: float) -> Iterator[str]:
    yield f"the contact sinks in by {from_si(eye.tip_m, 'mm'):.3f} mm under {from_si(eye.force_n, 'mn'):.4g} mN"
    if study.globe.kind == "sealed":
        resting, loaded = (from_si(pressure_pa, "mmhg") for pressure_pa in (resting_pa, eye.pressure_pa))
        yield (
            f"the pressure rises from {resting:.3g} to {loaded:.3g} mmHg; the dent is "
            f"{from_si(eye.dent_m, 'mm'):.3f} mm deep, from the undented wall at that pressure"
        )
    if study.mechanics.kind == "linear" and eye.tip_m > eye.mesh.thickness_m:
        ratio = eye.tip_m / eye.mesh.thickness_m
        yield f"that is {ratio:.1f} times the wall's thickness: more than linear mechanics describes"


class _Forces(click.ParamType[tuple[float, ...]]):
    name = "MN,MN,..."

    def convert(
        self, value: str | tuple[float, ...], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        if isinstance(value, tuple):
            return value
        try:
            return tuple(Quantity("force_mn").convert(each, param, ctx) for each in map(float, value.split(",")))
        except ValueError:
            self.fail(f"{value!r} is not a list of forces in mN; give for example 2,10,40", param, ctx)


@click.command(cls=Command)
@click.option("--out", type=PATH, required=True, help="Recording folder to write; must not exist.")
@options("study")
@click.option("--eye", "name", default="eye-1", show_default=True, help="Name of the eye.")
@click.option("--forces-mn", "forces_n", type=_Forces(), default="2,8,14,20,26,34,40,48,56", show_default=True,
              help="True force at each frame, in mN: one step-and-hold push each.")  # fmt: skip
@click.option("--rate-hz", type=click.FloatRange(0.1, 1000), help="Frames per second of a moving needle: --forces-mn "
              "are then the turning points of its force on an elastic wall, which begins at 0.")  # fmt: skip
@click.option("--ramp-mn-per-s", "ramp_n_per_s", type=click.FloatRange(0.01, 1e5), callback=in_si("mn_per_s"),
              help="Rate of change of a moving needle's force; default: 20.")  # fmt: skip
@click.option("--hold-s", type=click.FloatRange(0, 3600), help="Time at each turning point; default: 1.")
@click.option("--puncture-mn", "puncture_n", type=Quantity("force_mn"), help="Force at which a moving needle goes "
              "through the wall, after --forces-mn, none by default; frames.csv gets its travel.")  # fmt: skip
@options("thickness_m", "youngs_modulus_pa", "iop_pa", "gap_m", "polar_angle_rad", default=STUDYS,
         thickness_m="600", polar_angle_rad="35")  # fmt: skip
@click.option("--azimuth-deg", "azimuth_rad", type=float, callback=in_si("deg"),
              help="Azimuth of the contact about the pole; default: 0.")  # fmt: skip
@click.option("--direction-deg", "direction_rad", type=float, callback=in_si("deg"),
              help="Rotation of the B-scan plane about the needle axis; default: 0.")  # fmt: skip
@click.option("--tilt-deg", "tilt_rad", type=float, callback=in_si("deg"),
              help="Tilt of the B-scan plane against the needle axis; default: 0.")  # fmt: skip
@click.option("--plane", "planes", metavar=PLANE, multiple=True,
              help="One of several planes of each moment, as a cross of two (finite strain only); the gap is then that "
              "of the scanner's axis.")  # fmt: skip
@options("globe", "rigidity_pa13_per_m3", "mechanics", globe=GLOBE, rigidity_pa13_per_m3=RIGIDITY, mechanics=MECHANICS)
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Seed of all random choices; default: the study's.")
def phantom(
    out: Path, study: Study, name: str, forces_n: tuple[float, ...], planes: tuple[str, ...], seed: int | None,
    **values: Any,
) -> Report:  # fmt: skip
    """Make a virtual acquisition: raw B-scans, a force log, truth.json.

    [phantom] of the study has the ranges from which light, noise, shadows,
    timing and sensor are drawn; [form] shapes eyes that are not spheres
    (finite strain only).

    Example: scleraforce phantom --out eye-1 --thickness-um 800 --forces-mn 2,10,40

    A needle that a robot moves, at 100 frames a second:
    scleraforce phantom --out moving --rate-hz 100 --forces-mn 20,5,35 --ramp-mn-per-s 15
    """
    import scleraforce as sf
    from scleraforce.notebook.virtual import declared, given

    study = declared(study, *(values.pop(key) for key in ("mechanics", "globe", "rigidity_pa13_per_m3")))
    moves = given(**{key: values.pop(key) for key in ("rate_hz", "ramp_n_per_s", "hold_s", "puncture_n")})
    if moves and "rate_hz" not in moves:
        raise click.UsageError(
            "--ramp-mn-per-s, --hold-s, --puncture-mn are of a needle that moves; give --rate-hz too"
        )
    if (
        "puncture_n" in moves
        and click.get_current_context().get_parameter_source("forces_n") is ParameterSource.DEFAULT
    ):
        forces_n = ()
    eye, seed = given(**values), study.phantom.seed if seed is None else seed
    eye = {"thickness_m": THICKNESS_M, "polar_angle_rad": POLAR_RAD} | eye
    eye |= {"planes": [parse_plane(words) for words in planes]}
    made = sf.phantom(out, study, forces_n=forces_n, eye=name, seed=seed, counting=count_bar, **eye, **moves)
    wrote = {"recording": str(out), "frames": len(made.frames), "seed": seed}
    more = {"mechanics": study.mechanics.kind, "globe": study.globe.kind, "stiffening": study.tissue.stiffening}
    return Report({**wrote, **more}, [f"wrote {out}: {len(made.frames)} frames, seed {seed}"])
