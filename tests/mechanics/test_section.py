"""Sections against cuts of tetrahedra, and the slices that they fill."""

from itertools import permutations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from reference_walls import cut_section
from scleraforce.base.errors import InputError, SolverError
from scleraforce.mechanics.contact_and_section import (
    Contact,
    ScanPlane,
    SliceWindow,
    WallSection,
)
from scleraforce.mechanics.graded_mesh import supported_mesh
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.mesh_section import cut_sections, fill_section, slice_window
from scleraforce.mechanics.shape_functions import shape_values
from scleraforce.records.study import MeshStudy, SliceStudy, Study, SupportsStudy

RADIUS = 12e-3
THICKNESS = 6e-4
MICRON = 1e-6


@pytest.fixture(scope="module")
def mesh():
    return build_mesh(RADIUS, THICKNESS, divisions=4, level=1)


@pytest.fixture(scope="module")
def fine_mesh():
    return build_mesh(RADIUS, THICKNESS)


def planes(count):
    rng = np.random.default_rng(0)
    for _ in range(count):
        contact = Contact(
            polar_rad=rng.uniform(0.0, 1.1), azimuth_rad=rng.uniform(0.0, 2 * np.pi)
        )
        gap_m = rng.uniform(0.0, 1.5e-3)
        direction_rad = rng.uniform(-np.pi, np.pi)
        tilt_rad = rng.uniform(-0.5, 0.5)
        yield ScanPlane(
            contact, gap_m=gap_m, direction_rad=direction_rad, tilt_rad=tilt_rad
        )


def distance_to_circle(curve, plane, radius):
    """Return the distance of points of the plane from the circle that it cuts out of a
    sphere about the centre.
    """
    centre = -plane.origin(RADIUS)
    from_centre = curve - (centre @ plane.lateral, centre @ plane.depth)
    return np.abs(
        np.hypot(*from_centre.T) - np.sqrt(radius**2 - (centre @ plane.normal) ** 2)
    )


def in_space(curve, plane):
    return plane.origin(RADIUS) + curve @ np.stack([plane.lateral, plane.depth])


def distance_to_contour(points, contour):
    """Distance of each point to a closed polyline, by the definition."""
    start = contour
    edge = np.roll(contour, -1, axis=0) - contour
    square = np.maximum(np.sum(edge**2, axis=1), 1e-30)
    nearest = np.full(len(points), np.inf)

    for corner, along, length in zip(start, edge, square, strict=True):
        t = np.clip((points - corner) @ along / length, 0.0, 1.0)
        nearest = np.minimum(
            nearest, np.hypot(*(points - corner - t[:, None] * along).T)
        )

    return nearest


def area(contour):
    x, y = contour.T
    return 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def inside(points, contour):
    """Winding number not zero, by the sum of angles."""
    seen = (contour[:, 0] + 1j * contour[:, 1]) - (points[:, 0] + 1j * points[:, 1])[
        :, None
    ]
    return np.abs(np.angle(np.roll(seen, -1, axis=1) * seen.conj()).sum(axis=1)) > np.pi


GLOBE = Study(
    mesh=MeshStudy(kind="graded", rings=20), supports=SupportsStudy(kind="bed")
)
FACET_M = 3 * (1e-3) ** 2 / 8 / RADIUS  # sags along both of its sides
MESHES = {
    "27 nodes": (lambda: build_mesh(RADIUS, THICKNESS), 0.5 * MICRON),
    "8 nodes": (lambda: build_mesh(RADIUS, THICKNESS, order=1), FACET_M),
    "layers": (lambda: build_mesh(RADIUS, THICKNESS, order=1, layers=3), FACET_M),
    "globe": (
        lambda: supported_mesh(GLOBE, THICKNESS, Contact(polar_rad=0.5)),
        5 * MICRON,
    ),
}


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("plane", list(planes(4)), ids=str)
def test_the_undeformed_wall_is_cut_in_two_circles_that_end_on_the_base(name, plane):
    make, off_m = MESHES[name]
    mesh = make()
    section = cut_section(mesh, plane, np.zeros_like(mesh.points_nc))
    assert distance_to_circle(section.outer, plane, RADIUS).max() < off_m
    assert distance_to_circle(section.inner, plane, RADIUS - THICKNESS).max() < off_m

    for curve in (section.outer, section.inner):
        height = in_space(curve, plane)[:, 2]
        # else the plane misses the base: a full circle
        if np.hypot(*(curve[0] - curve[-1])) > MICRON:
            assert np.abs(height[[0, -1]]).max() < 5 * MICRON
            assert height.min() > -MICRON


@pytest.mark.parametrize("move_mm", [-1.6, 3.0])
def test_a_wall_moved_across_the_plane_is_cut_as_by_a_plane_moved_the_other_way(
    fine_mesh, move_mm
):
    plane = ScanPlane(
        Contact(polar_rad=0.6, azimuth_rad=0.2), gap_m=1e-3, direction_rad=0.4
    )
    move = move_mm * 1e-3
    section = cut_section(
        fine_mesh,
        plane,
        np.broadcast_to(move * plane.normal, fine_mesh.points_nc.shape),
    )
    moved = ScanPlane(
        plane.contact, gap_m=plane.gap_m - move, direction_rad=plane.direction_rad
    )
    assert distance_to_circle(section.outer, moved, RADIUS).max() < 2 * MICRON
    assert (
        distance_to_circle(section.inner, moved, RADIUS - THICKNESS).max() < 2 * MICRON
    )


def test_a_wall_that_has_left_the_plane_is_an_error_and_not_a_gap(mesh):
    plane = ScanPlane(Contact(polar_rad=0.6, azimuth_rad=0.2), gap_m=1e-3)
    with pytest.raises(SolverError, match="across the B-scan plane"):
        cut_section(
            mesh, plane, np.broadcast_to(30e-3 * plane.normal, mesh.points_nc.shape)
        )


@pytest.mark.parametrize(
    ("polar", "gap_m", "direction", "tilt"),
    [
        (0.6, 20e-3, 0.0, 0.0),
        (0.6, 5e-3, 0.0, 0.78),
        (1.4, -5e-3, 0.5 * np.pi, 0.0),
    ],
)
def test_a_plane_that_misses_the_wall_is_an_input_error(
    mesh, polar, gap_m, direction, tilt
):
    plane = ScanPlane(
        Contact(polar_rad=polar), gap_m=gap_m, direction_rad=direction, tilt_rad=tilt
    )
    with pytest.raises(InputError, match="B-scan plane"):
        cut_section(mesh, plane, np.zeros_like(mesh.points_nc))


def bumps(mesh, plane, *parts):
    """Smooth displacements about the contact: (direction, size, lateral centre, width),
    all in m.
    """
    from_origin = mesh.points_nc - plane.origin(RADIUS)
    lateral = from_origin @ plane.lateral
    offset = from_origin @ plane.offset
    total = np.zeros_like(mesh.points_nc)

    for direction, size, centre, width in parts:
        total += (
            size
            * np.exp(-((lateral - centre) ** 2 + offset**2) / width**2)[:, None]
            * direction
        )

    return total * (mesh.points_nc[:, 2:] > 4e-3)


def twisted_dent(mesh, plane):
    twists = (plane.normal, 0.9e-3, -1e-3, 2.5e-3), (plane.normal, -0.7e-3, 2e-3, 3e-3)
    return bumps(mesh, plane, (plane.depth, 3e-3, 0.0, 3e-3), *twists)


def fold(mesh, plane):
    """The wall bent to an S that hangs over; its thickness and its distance from the
    plane stay.
    """
    lateral, depth, height = (
        mesh.points_nc @ axis for axis in (plane.lateral, plane.depth, plane.normal)
    )
    u = np.arctan2(lateral, -depth) / 1.5
    tangent = np.stack([12 - 6.75 * np.pi * np.cos(np.pi * u), np.full_like(u, 8.0)])
    outward = np.stack([tangent[1], -tangent[0]]) / np.hypot(*tangent)
    middle = 1e-3 * np.stack([12 * u - 6.75 * np.sin(np.pi * u), 8 * u])
    place = middle + (np.hypot(lateral, depth) - RADIUS) * outward
    moved = (
        place.T @ np.stack([plane.lateral, plane.depth])
        + height[:, None] * plane.normal
    )

    return moved - mesh.points_nc


def w_dent(mesh, plane):
    return bumps(
        mesh,
        plane,
        (plane.depth, 2e-3, -2.5e-3, 1.6e-3),
        (plane.depth, 1.5e-3, 2e-3, 1.8e-3),
    )


def cut_tetrahedra(mesh, plane, displacement, pieces):
    """Second implementation: hexahedra split into small tetrahedra, each of them cut;
    list of polygons in the plane.
    """
    moved = mesh.points_nc + displacement - plane.origin(RADIUS)
    height = (moved @ plane.normal)[mesh.cells_en]
    near = (height.min(axis=1) < 1e-4) & (height.max(axis=1) > -1e-4)
    grid = np.stack(
        np.meshgrid(*(np.linspace(-1, 1, n + 1) for n in pieces), indexing="ij"),
        axis=-1,
    ).reshape(-1, 3)
    weights = shape_values(grid, mesh.cells_en.shape[1])
    number = np.arange(len(grid)).reshape([n + 1 for n in pieces])
    corner = {
        c: (
            number[
                tuple(slice(k, k + n) for k, n in zip(c, pieces, strict=True))
            ].ravel()
        )
        for c in np.ndindex(2, 2, 2)
    }
    tetrahedra = []

    for order in permutations(range(3)):
        # Kuhn: each order of the axes is a path from corner 000 to 111
        path = [np.zeros(3, int)]
        for axis in order:
            path.append(path[-1] + np.eye(3, dtype=int)[axis])

        tetrahedra.append(np.stack([corner[tuple(c)] for c in path], axis=1))

    axes = np.stack([plane.lateral, plane.depth, plane.normal], axis=1)
    polygons = []

    for cell in mesh.cells_en[near]:
        points = (weights @ moved[cell]) @ axes
        for tetrahedron in points[np.concatenate(tetrahedra)]:
            h = tetrahedron[:, 2]
            above = tetrahedron[h >= 0]

            below = tetrahedron[h < 0]
            if len(above) and len(below):
                polygon = [
                    a + (b - a) * a[2] / (a[2] - b[2]) for a in above for b in below
                ]
                if len(polygon) == 4:
                    polygon = [polygon[k] for k in (0, 1, 3, 2)]
                polygons.append(np.array(polygon)[:, :2])

    return polygons


@pytest.mark.parametrize(
    ("deform", "tilt"),
    [(fold, 0.0), pytest.param(twisted_dent, 0.3, marks=pytest.mark.slow)],
)
def test_the_section_is_what_all_the_small_tetrahedra_cut(fine_mesh, deform, tilt):
    plane = ScanPlane(
        Contact(polar_rad=0.5, azimuth_rad=0.7),
        gap_m=0.5e-3,
        direction_rad=0.6,
        tilt_rad=tilt,
    )
    displacement = deform(fine_mesh, plane)
    section = cut_section(fine_mesh, plane, displacement)
    polygons = cut_tetrahedra(fine_mesh, plane, displacement, (8, 8, 1))
    points = np.concatenate(polygons)
    outside = points[~inside(points, section.contour)]
    assert distance_to_contour(outside, section.contour).max(initial=0.0) < 10 * MICRON
    total = sum(area(polygon) for polygon in polygons)
    perimeter = np.hypot(*np.diff(section.contour, axis=0).T).sum()
    assert abs(total - area(section.contour)) < 0.5 * MICRON * perimeter


def test_many_planes_and_deformations_at_once_are_each_as_alone(mesh):
    contact = Contact(polar_rad=0.5, azimuth_rad=0.7)
    cuts = [
        ScanPlane(contact, gap_m=gap, direction_rad=direction, tilt_rad=tilt)
        for gap, direction, tilt in [(0.3e-3, 0, 0), (1e-3, 2, 0.2)]
    ]
    modes = np.stack([twisted_dent(mesh, cuts[0]), w_dent(mesh, cuts[1])])
    weights = np.array(
        [[[0.0, 0.0], [1.0, 0.3], [0.2, 0.9]], [[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]]]
    )
    together = cut_sections(mesh, cuts, modes, weights)

    for plane, of_plane, rows in zip(cuts, together, weights, strict=True):
        for section, row in zip(of_plane, rows, strict=True):
            alone = cut_section(mesh, plane, np.tensordot(row, modes, 1))
            assert (
                distance_to_contour(section.contour, alone.contour).max() < 10 * MICRON
            )


PIXEL = 1e-4
WINDOW = SliceWindow(left_m=-7e-3, top_m=-3e-4, columns=140, rows=40, pixel_m=PIXEL)


def from_pixels(contour, window=WINDOW):
    """Section whose closed contour is given in pixels, (0, 0) being the window's upper
    left corner.
    """
    points = np.asarray(contour, dtype=np.float64) * window.pixel_m + (
        window.left_m,
        window.top_m,
    )
    half = len(points) // 2
    return WallSection(points[:half], points[half:][::-1])


def test_a_rectangle_through_pixel_centres_holds_its_left_and_top_edge_only():
    image = fill_section(
        from_pixels([(10.5, 5.5), (20.5, 5.5), (20.5, 9.5), (10.5, 9.5)]), WINDOW
    )
    rows, columns = np.nonzero(image)
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (10, 19, 5, 8)
    assert np.count_nonzero(image) == 10 * 4


def test_walls_that_touch_neither_overlap_nor_leave_a_seam():
    rng = np.random.default_rng(3)
    seam = np.c_[np.linspace(-5, 145, 40), 20 + 6 * rng.standard_normal(40)]
    seam[::4] = np.floor(seam[::4]) + 0.5  # some corners on pixel centres
    seam[:, 0].sort()
    above = fill_section(from_pixels(np.r_[[(-5, -5), (145, -5)], seam[::-1]]), WINDOW)
    below = fill_section(from_pixels(np.r_[seam, [(145, 45), (-5, 45)]]), WINDOW)
    np.testing.assert_array_equal(above, 255 - below)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-5, 17), st.floats(-5, 15)), min_size=3, max_size=9)
)
def test_any_polygon_agrees_with_opencv_away_from_its_edge(points):
    window = SliceWindow(left_m=0.0, top_m=0.0, columns=12, rows=10, pixel_m=PIXEL)
    contour = np.asarray(points, dtype=np.float32)
    image = fill_section(from_pixels(contour, window), window)
    centres = np.stack(
        np.meshgrid(np.arange(12) + 0.5, np.arange(10) + 0.5), axis=-1
    ).reshape(-1, 2)
    clear = np.array(
        [
            abs(cv2.pointPolygonTest(contour, centre, measureDist=True)) > 1e-3
            for centre in centres
        ]
    )
    np.testing.assert_array_equal(
        image.ravel()[clear] > 0, inside(centres[clear], np.float64(contour))
    )


def test_the_window_puts_the_unloaded_top_below_the_margin_and_framing_moves_the_wall_right_and_down():
    study = SliceStudy()
    flat = WallSection(
        np.array([[-1e-3, 0.0], [1e-3, 0.0]]), np.array([[-1e-3, 5e-4], [1e-3, 5e-4]])
    )
    rows, columns = np.nonzero(fill_section(flat, slice_window(study, top_m=0.0)))
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (60, 79, 3, 7)
    window = slice_window(study, 0.0, framing_lateral_m=4e-4, framing_depth_m=2e-4)
    rows, columns = np.nonzero(fill_section(flat, window))
    assert (columns.min(), columns.max(), rows.min(), rows.max()) == (64, 83, 5, 9)
