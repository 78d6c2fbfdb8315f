from dataclasses import replace
from math import radians

import cv2
import meshio
import numpy as np
import pytest

from scleraforce.base.errors import InputError
from scleraforce.front.report.figure_files import write_figure
from scleraforce.front.report.model_figures import draw_simulation
from scleraforce.lab.virtual_eye import SimulatedEye, simulate_eye, write_vtu
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.records.study import MeshStudy, Study

THICKNESS = 0.8e-3
CONTACT = Contact(polar_rad=radians(35.0), azimuth_rad=0.3)


@pytest.fixture(scope="module", params=[1, 2])
def eye(request: pytest.FixtureRequest) -> SimulatedEye:
    study = replace(
        Study(), mesh=MeshStudy(divisions=8, level=0, layers=2, order=request.param)
    )
    return simulate_eye(study, THICKNESS, 0.02, CONTACT)


@pytest.mark.slow
def test_the_graded_default_agrees_with_the_even_mesh():
    even = replace(Study(), mesh=MeshStudy(kind="hexahedra"))
    graded, other = (
        simulate_eye(study, 0.5e-3, 0.02, CONTACT) for study in (Study(), even)
    )
    assert len(graded.mesh.cells_en) == 372
    # of which the even mesh has up to 1.9 %
    assert graded.tip_m == pytest.approx(other.tip_m, rel=0.02)
    assert np.mean(graded.slice != other.slice) < 2e-3


def test_vtk_file_and_grid_hold_the_wall_and_its_displacement(eye, tmp_path):
    """VTK measures the elements; test_mesh has their nodes in VTK's order."""
    with pytest.raises(InputError, match="no-such-folder"):
        write_vtu(eye, tmp_path / "no-such-folder" / "eye.vtu")

    write_vtu(eye, tmp_path / "eye.vtu")
    read = meshio.read(tmp_path / "eye.vtu")
    (block,) = read.cells
    assert block.type == {1: "hexahedron", 2: "hexahedron27"}[eye.mesh.order]
    np.testing.assert_array_equal(read.points, eye.mesh.points_nc)
    np.testing.assert_array_equal(read.point_data["displacement"], eye.displacement_nc)
    np.testing.assert_array_equal(read.point_data["needle_displacement"], eye.needle_nc)
    grid = eye.to_pyvista()
    np.testing.assert_array_equal(grid.points, eye.mesh.points_nc)
    np.testing.assert_array_equal(grid.point_data["displacement"], eye.displacement_nc)
    volumes = grid.compute_cell_sizes()["Volume"]
    assert volumes.min() > 0.0
    shell = 2.0 / 3.0 * np.pi * (12e-3**3 - (12e-3 - THICKNESS) ** 3)
    assert volumes.sum() == pytest.approx(shell, rel=0.03)
    assert [path.name for path in tmp_path.iterdir()] == ["eye.vtu"]
    np.testing.assert_array_equal(block.data, eye.mesh.cells_en)


def test_the_figure_shows_mesh_needle_and_slice(eye, tmp_path):
    write_figure(draw_simulation(eye), tmp_path / "eye.png")
    image = cv2.imread(str(tmp_path / "eye.png"), cv2.IMREAD_COLOR).astype(int)
    left = image[:, : image.shape[1] // 2]
    right = image[:, image.shape[1] // 2 :]
    blue, green, red = np.moveaxis(left, -1, 0)
    # the needle, vermilion
    assert np.count_nonzero((red > 190) & (green < 110) & (blue < 60)) > 200
    # viridis' dark end: the wall at rest
    assert np.count_nonzero((blue > 70) & (red < 90)) > 10_000
    # the slice's black background
    assert np.count_nonzero(right.max(axis=-1) < 10) > 10_000
