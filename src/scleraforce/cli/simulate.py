"""`scleraforce simulate`: one eye, one force."""

from datetime import UTC, datetime
from math import radians
from pathlib import Path
from time import perf_counter

import click

from scleraforce.cli.globe import globe_options, with_globe
from scleraforce.cli.output import print_json, say, share_bar
from scleraforce.cli.quantities import Possible
from scleraforce.errors import InputError
from scleraforce.study import Study, read_study
from scleraforce.study.fields import NEEDLE_FORCE
from scleraforce.study.unused import refuse_unused
from scleraforce.units import from_si, to_si


@click.command()
@click.option("--study", "study_path", type=click.Path(path_type=Path), help="Study file; the paper's by default.")
@click.option("--thickness-um", type=Possible("thickness_um"), required=True, help="Thickness of the wall.")
@click.option(
    "--force-mn", type=Possible("force_mn"), required=True, help="Force of the needle, along the inward normal."
)
@click.option(
    "--youngs-modulus-mpa",
    type=Possible("youngs_modulus_mpa"),
    help="Young's modulus of the wall; the study's by default.",
)
@click.option("--iop-mmhg", type=Possible("iop_mmhg"), help="Intraocular pressure; the study's by default.")
@click.option(
    "--polar-angle-deg",
    type=Possible("polar_angle_deg"),
    help="Contact, from the pole; the middle of the study's by default.",
)
@click.option("--gap-mm", type=Possible("gap_mm"), help="B-scan plane to needle axis; the study's by default.")
@globe_options
@click.option("--mechanics", type=click.Choice(["linear", "finite-strain"]), help="Small displacements, or any; the "
              "study's by default (linear, if it does not say).")  # fmt: skip
@click.option("--vtu", type=click.Path(path_type=Path), help="Write the mesh and its displacement (VTK) here.")
@click.option("--xdmf", type=click.Path(path_type=Path), help="Write it at rest and under the force here (XDMF).")
@click.option("--html", type=click.Path(path_type=Path), help="Write a page here, with the wall to be turned in 3-D.")
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    help="Write a picture of the deformed mesh and the slice here (PNG, SVG, PDF).",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def simulate(
    study_path: Path | None,
    thickness_um: float,
    force_mn: float,
    youngs_modulus_mpa: float | None,
    iop_mmhg: float | None,
    polar_angle_deg: float | None,
    gap_mm: float | None,
    globe: str | None,
    rigidity: float | None,
    mechanics: str | None,
    vtu: Path | None,
    xdmf: Path | None,
    html: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
    """Bend one eye by one force: displacement, slice, picture.

    Example: scleraforce simulate --thickness-um 500 --force-mn 30 --plot eye.png
    """
    # Imported here: mechanics and figures take longer to import than the help to print.
    from scleraforce.laboratory.simulation import simulate_eye, write_vtu, write_xdmf
    from scleraforce.notebook.virtual import middle_contact, with_mechanics, with_one_eye

    study = with_one_eye(
        with_mechanics(Study() if study_path is None else read_study(study_path), mechanics),
        thickness_m=to_si(thickness_um, "um"),
        youngs_modulus_pa=to_si(youngs_modulus_mpa, "mpa"),
        iop_pa=to_si(iop_mmhg, "mmhg"),
        gap_m=to_si(gap_mm, "mm"),
        polar_angle_rad=None if polar_angle_deg is None else radians(polar_angle_deg),
    )
    study = with_globe(study, globe, rigidity)
    refuse_unused(study, "simulate", study.mechanics.kind, study_path)
    for path in filter(None, (vtu, xdmf, plot, html)):
        if path.exists():
            raise InputError(f"{path}: exists already; remove it or choose another name")
    if plot is not None:
        from scleraforce.report.files import check_figure_path

        check_figure_path(plot)

    start = perf_counter()
    with share_bar("load path") as reach:
        thickness_m, force_n = study.eye.thickness_m.bounds[0], NEEDLE_FORCE.to_si(force_mn)
        eye = simulate_eye(study, thickness_m, force_n, middle_contact(study), reach)
    seconds = perf_counter() - start
    if vtu is not None:
        write_vtu(eye, vtu)
    if xdmf is not None:
        write_xdmf(eye, xdmf)
    if plot is not None:
        from scleraforce.report.files import write_figure
        from scleraforce.report.model_figures import draw_simulation

        write_figure(draw_simulation(eye), plot)
    if html is not None:
        from scleraforce.report.eye_view import write_simulation_html

        write_simulation_html(eye, html, datetime.now(UTC))
    result = {
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
    if as_json:
        print_json(result)
        return
    say(f"the contact sinks in by {from_si(eye.tip_m, 'mm'):.3f} mm under {from_si(eye.force_n, 'mn'):g} mN")
    if study.globe.kind == "sealed":
        resting, loaded = (from_si(pressure_pa, "mmhg") for pressure_pa in (study.eye.iop_pa, eye.pressure_pa))
        say(f"the pressure rises from {resting:.3g} to {loaded:.3g} mmHg; the dent is "
                   f"{from_si(eye.dent_m, 'mm'):.3f} mm deep, from the undented wall at that pressure")  # fmt: skip
    if study.mechanics.kind == "linear" and eye.tip_m > eye.mesh.thickness_m:
        say(f"that is {eye.tip_m / eye.mesh.thickness_m:.1f} times the wall's thickness: more than linear "
                   "mechanics describes")  # fmt: skip
    say(f"{result['elements']} elements, {result['dofs']} unknowns, {seconds:.1f} s")
    for path in filter(None, (vtu, xdmf, plot, html)):
        say(f"wrote {path}")
