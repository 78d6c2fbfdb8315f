"""`scleraforce simulate`: one eye, one force."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.options import PATH, Quantity, eye_options, options
from scleraforce.cli.output import Command, Report, refuse_existing, share_bar
from scleraforce.study import Study
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.laboratory.simulation import SimulatedEye

STUDYS = "the study's by default"


@click.command(cls=Command)
@options("study")
@eye_options("thickness_m", default="", required=("thickness_m",))
@click.option("--force-mn", "force_n", type=Quantity("force_mn"), required=True,
              help="Force of the needle, along the inward normal.")  # fmt: skip
@eye_options("youngs_modulus_pa", "iop_pa", "polar_angle_rad", "gap_m", "globe", "rigidity_pa13_per_m3",
             default=STUDYS, polar_angle_rad="the middle of the study's by default",
             globe=f"finite strain only; {STUDYS} (open, if it does not say)",
             rigidity_pa13_per_m3=f"{STUDYS} (0.03, if it does not say)")  # fmt: skip
@options("mechanics", mechanics="Small displacements, or any; the study's by default (linear, if it does not say).")
@click.option("--vtu", type=PATH, help="Write the mesh and its displacement (VTK) here.")
@click.option("--xdmf", type=PATH, help="Write it at rest and under the force here (XDMF).")
@options("html", "plot", html="Write a page here, with the wall to be turned in 3-D.",
         plot="Write a picture of the deformed mesh and the slice here (PNG, SVG, PDF).")  # fmt: skip
def simulate(
    study: Study,
    force_n: float,
    globe: str | None,
    rigidity_pa13_per_m3: float | None,
    mechanics: str | None,
    vtu: Path | None,
    xdmf: Path | None,
    html: Path | None,
    plot: Path | None,
    **given: Any,
) -> Report:
    """Bend one eye by one force: displacement, slice, picture.

    Example: scleraforce simulate --thickness-um 500 --force-mn 30 --plot eye.png
    """
    # Imported here: mechanics and figures take longer to import than the help to print.
    import scleraforce as sf
    from scleraforce.laboratory.simulation import write_vtu, write_xdmf
    from scleraforce.notebook.virtual import declared

    study = declared(study, mechanics, globe, rigidity_pa13_per_m3)
    paths = [path for path in (vtu, xdmf, plot, html) if path is not None]
    refuse_existing(*paths)
    if plot is not None:
        from scleraforce.report.files import check_figure_path

        check_figure_path(plot)
    start = perf_counter()
    with share_bar("load path") as reach:
        eye = sf.simulate(study, force_n=force_n, progress=reach, **given)
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
    resting_pa = study.eye.iop_pa if given["iop_pa"] is None else given["iop_pa"]
    size = f"{result['elements']} elements, {result['dofs']} unknowns, {seconds:.1f} s"
    return Report(result, [*_lines(eye, study, resting_pa), size, *(f"wrote {path}" for path in paths)])


def _lines(eye: "SimulatedEye", study: Study, resting_pa: float) -> Iterator[str]:
    yield f"the contact sinks in by {from_si(eye.tip_m, 'mm'):.3f} mm under {from_si(eye.force_n, 'mn'):g} mN"
    if study.globe.kind == "sealed":
        resting, loaded = (from_si(pressure_pa, "mmhg") for pressure_pa in (resting_pa, eye.pressure_pa))
        yield (
            f"the pressure rises from {resting:.3g} to {loaded:.3g} mmHg; the dent is "
            f"{from_si(eye.dent_m, 'mm'):.3f} mm deep, from the undented wall at that pressure"
        )
    if study.mechanics.kind == "linear" and eye.tip_m > eye.mesh.thickness_m:
        ratio = eye.tip_m / eye.mesh.thickness_m
        yield f"that is {ratio:.1f} times the wall's thickness: more than linear mechanics describes"
