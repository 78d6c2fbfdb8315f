"""`scleraforce phantom`: make a virtual acquisition."""

from dataclasses import replace
from math import radians
from pathlib import Path

import click

from scleraforce.cli.output import print_json, progress_bar, share_bar
from scleraforce.errors import InputError
from scleraforce.study import Study, read_study
from scleraforce.units import mmhg_to_pa

__all__ = ["phantom"]


class Forces(click.ParamType[tuple[float, ...]]):
    """Forces in mN, separated by commas, as N."""

    name = "MN,MN,..."

    def convert(
        self, value: str | tuple[float, ...], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the forces in N."""
        if isinstance(value, tuple):
            return value
        try:
            return tuple(float(entry) / 1e3 for entry in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of forces in mN; give for example 2,10,40", param, ctx)


@click.command()
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Recording folder to write; must not exist."
)
@click.option("--study", "study_path", type=click.Path(path_type=Path), help="Study file; the paper's by default.")
@click.option("--eye", "name", default="eye-1", show_default=True, help="Name of the eye.")
@click.option("--forces-mn", type=Forces(), default="2,8,14,20,26,34,40,48,56", show_default=True,
              help="True force at each frame, in mN: one step-and-hold push each.")  # fmt: skip
@click.option("--thickness-um", type=float, default=600.0, show_default=True, help="Thickness of the wall.")
@click.option("--youngs-modulus-mpa", type=float, help="Young's modulus of the wall; the study's by default.")
@click.option("--iop-mmhg", type=float, help="Intraocular pressure; the study's by default.")
@click.option("--gap-mm", type=float, help="B-scan plane to needle axis; the study's by default.")
@click.option("--polar-angle-deg", type=float, default=35.0, show_default=True, help="Contact, from the pole.")
@click.option("--azimuth-deg", type=float, default=0.0, show_default=True, help="Contact, about the pole.")
@click.option("--direction-deg", type=float, default=0.0, show_default=True, help="B-scan plane about the needle axis.")
@click.option("--tilt-deg", type=float, default=0.0, show_default=True, help="B-scan plane against the needle axis.")
@click.option("--mechanics", type=click.Choice(["linear", "finite-strain"]), help="How the wall bends; the study's by "
              "default (linear, if it does not say).")  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Of all that is drawn; the study's by default.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def phantom(
    out: Path,
    study_path: Path | None,
    name: str,
    forces_mn: tuple[float, ...],
    thickness_um: float,
    youngs_modulus_mpa: float | None,
    iop_mmhg: float | None,
    gap_mm: float | None,
    polar_angle_deg: float,
    azimuth_deg: float,
    direction_deg: float,
    tilt_deg: float,
    mechanics: str | None,
    seed: int | None,
    as_json: bool,
) -> None:
    """Make a virtual acquisition: raw B-scans, a force log, truth.json.

    [phantom] of the study has the ranges from which light, noise, shadows,
    timing and sensor are drawn; [form] shapes eyes that are not spheres
    (finite strain only).

    Example: scleraforce phantom --out eye-1 --thickness-um 800 --forces-mn 2,10,40
    """
    # Imported here: mechanics takes longer to import than the help to print.
    from scleraforce.recording.phantom import plan_phantom, write_phantom
    from scleraforce.recording.virtual_eye import PhantomEye, study_sections

    study = Study() if study_path is None else read_study(study_path)
    if mechanics is not None:
        study = replace(study, mechanics=replace(study.mechanics, kind=mechanics))
    if out.exists():
        raise InputError(f"{out}: exists already; remove it or choose another folder")
    eye = PhantomEye(
        id=name,
        thickness_m=thickness_um / 1e6,
        youngs_modulus_pa=study.eye.youngs_modulus_pa if youngs_modulus_mpa is None else youngs_modulus_mpa * 1e6,
        iop_pa=study.eye.iop_pa if iop_mmhg is None else mmhg_to_pa(iop_mmhg),
        gap_m=study.needle.gap_m if gap_mm is None else gap_mm / 1e3,
        polar_rad=radians(polar_angle_deg),
        azimuth_rad=radians(azimuth_deg),
        direction_rad=radians(direction_deg),
        tilt_rad=radians(tilt_deg),
    )
    plan = plan_phantom(eye, forces_mn, study, study.phantom.seed if seed is None else seed)
    with share_bar("load path") as reach:
        sections_at = study_sections(eye, study, reach)
        sections_at([max(plan.forces_n)])  # a load path is computed here, once: frames then come fast
    with progress_bar(plan.frames, "frames") as bar:
        write_phantom(out, plan, sections_at, study, bar.update)
    result = {
        "recording": str(out),
        "frames": len(plan.frames),
        "seed": plan.seed,
        "mechanics": study.mechanics.kind,
    }
    if as_json:
        print_json(result)
    else:
        click.echo(f"wrote {out}: {len(plan.frames)} frames, seed {plan.seed}")
