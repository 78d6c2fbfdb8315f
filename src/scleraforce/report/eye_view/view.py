"""The view as a section of a page, and the page of `simulate --html`."""

from datetime import datetime
from importlib.resources import files
from pathlib import Path

from scleraforce.laboratory.simulation import SimulatedEye
from scleraforce.report.eye_view.scene import eye_scene
from scleraforce.report.files import write_page
from scleraforce.report.html import Html, cards, embedded, figure, page, paragraph, section
from scleraforce.report.mesh_figure import draw_simulation
from scleraforce.report.provenance import made_line
from scleraforce.report.style import data_uri
from scleraforce.units import from_si

HERE = files("scleraforce.report.eye_view")
WORDS = (
    "Drag, or use the arrow keys, to turn it; turn the wheel, or press + and -, to come nearer. The slider exaggerates "
    "the displacement, or takes it away. Half of the wall is left out so that the needle's meridian is seen. Colours: "
    "how far each point has moved from the unloaded wall, under pressure and gravity as well."
)


def eye_view(eye: SimulatedEye) -> Html:
    """Return the view; a page that holds it needs `view_style` and `view_script`, and may hold one."""
    markup = HERE.joinpath("view.html").read_text(encoding="utf-8")
    return Html(markup + embedded("eye-scene", eye_scene(eye)) + paragraph(WORDS))


def view_style() -> str:
    """Return the rules of the view."""
    return HERE.joinpath("view.css").read_text(encoding="utf-8")


def view_script() -> str:
    """Return the script of the view."""
    return HERE.joinpath("view.js").read_text(encoding="utf-8")


def write_simulation_html(eye: SimulatedEye, path: Path, made_at: datetime) -> None:
    """Write one simulated eye as a page: its numbers, the wall to be turned, mesh and slice as a picture.

    Raises:
        InputError: the file exists already, or cannot be written.
    """
    numbers = cards(
        [
            (f"{from_si(eye.force_n, 'mn'):g} mN", "force of the needle", "along the inward normal"),
            (f"{from_si(eye.tip_m, 'mm'):.3f} mm", "the contact sinks in", "from the wall under IOP alone"),
            (f"{from_si(eye.pressure_pa, 'mmhg'):.3g} mmHg", "pressure under the needle", ""),
            (f"{from_si(eye.mesh.thickness_m, 'um'):.0f} µm", "wall", f"{len(eye.mesh.cells_en)} elements"),
        ]
    )
    drawn = figure(data_uri(draw_simulation(eye)), "deformed mesh and slice", "The mesh, cut open, and the slice.")
    content = page(
        "One eye under one force",
        "The deformed wall of a simulated eye.",
        made_line(made_at),
        section("Result", numbers),
        section("The deformed wall", eye_view(eye)),
        section("Mesh and slice", drawn),
        style=view_style(),
        script=view_script(),
    )
    write_page(content, path)
