"""The section, where the B-scan plane cuts the deformed wall, and the binary slice
drawn from it (paper sec. 2.3).

The two surfaces of the wall are followed along material lines. Give the undeformed
sphere latitude and longitude about the normal of the plane: the plane is then a circle
of latitude, and the needle moves material only a little across it. So every meridian (a
*station*) is sampled on a few parallels around that circle, and the place where its
deformed image passes through the plane is found between two of them. Positions are of
the finite elements, from the surface quads' own shape functions. The points come in the
order of the material, so a wall that folds over in the plane is right, and all
stations, deformations and planes of a contact are computed at once.

A pixel of the slice is wall exactly where its centre lies in the wall. OpenCV's
`fillPoly` also paints every pixel that the outline touches, which fattens a 0.5 mm wall
by about one pixel on each side (a disc of 20 pixels radius gains 6 % of its area), and
supersampling only shrinks that error while it multiplies the time. So the winding
number of the contour is counted at the pixel centres, column by column.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from scleraforce.base.arrays import Bytes, Floats, Integers, Places
from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.units import from_si
from scleraforce.mechanics.contact_and_section import (
    ScanPlane,
    SliceWindow,
    WallSection,
)
from scleraforce.mechanics.hexahedral_mesh import HexMesh, locate
from scleraforce.records.study import SliceStudy

# between stations at the contact: a chord is 2 um off where the wall bends with a
# radius of 1 mm
STATION_M = 0.12e-3
# from about there on they spread out: chords are 9 um off at the far side of the eye
GRADING_M = 3.2e-3
# the first and last station lie below the base: there the section ends on the base's
# rim
BEYOND_BASE_M = 0.1e-3


@dataclass(frozen=True)
class PlaneFrames:
    """The axes of several planes, lateral, depth, normal (plane, axis, 3), and their
    origins (plane, 3).

    On the undeformed sphere latitude and longitude are counted about the normal of each
    plane; longitude 0 is where the depth is smallest, and it grows towards the lateral
    axis.
    """

    axes_pac: Floats
    origins_pc: Floats

    def latitudes(self, radius_m: float) -> Floats:
        """Latitude of the circle that each plane cuts out of an undeformed sphere,
        shape (plane,).
        """
        sine = np.sum(self.axes_pac[:, 2] * self.origins_pc, axis=1) / radius_m
        if np.any(np.abs(sine) > 0.98):
            raise InputError(
                "B-scan plane: it passes"
                f" {from_si(np.abs(sine).max() * radius_m, 'mm'):.2f} mm from the eye's"
                f" centre and misses the sphere of {from_si(radius_m, 'mm'):.2f} mm, or"
                " only grazes it; use a smaller gap or tilt"
            )

        return np.arcsin(sine)

    def directions(self, longitudes: Floats, latitudes: Floats) -> Floats:
        """Directions from the centre, (plane, ...) to (plane, ..., 3); below the base
        plane: to the base's rim.
        """
        lateral, depth, normal = (
            self._spread(self.axes_pac[:, axis], longitudes.ndim) for axis in range(3)
        )
        along = (
            np.sin(longitudes)[..., None] * lateral
            - np.cos(longitudes)[..., None] * depth
        )
        directions: Floats = (
            np.cos(latitudes)[..., None] * along + np.sin(latitudes)[..., None] * normal
        )
        directions[..., 2] = np.maximum(directions[..., 2], 0.0)

        return directions

    def project(self, fields: Floats) -> Floats:
        """Turn fields (plane, ..., 1 + mode, 3), a position and displacements, to the
        planes' axes.
        """
        moved = fields.copy()
        moved[..., 0, :] -= self._spread(self.origins_pc, fields.ndim - 2)
        axes = self.axes_pac.reshape(len(fields), *(1,) * (fields.ndim - 3), 3, 3)
        return moved @ np.swapaxes(axes, -1, -2)

    @staticmethod
    def _spread(vectors_pc: Floats, dimensions: int) -> Floats:
        return vectors_pc.reshape(len(vectors_pc), *(1,) * (dimensions - 1), 3)


def place_stations(frames: PlaneFrames, circles_xp: Floats, radius_m: float) -> Floats:
    """Return the longitudes of the material lines, dense at the contact, from base to
    base, shape (plane, station).

    `circles_xp`: latitudes of the undeformed circles (surface, plane).
    """
    ends = np.array(
        [
            _ends_at_base(frames, circle, BEYOND_BASE_M / radius_m)
            for circle in circles_xp
        ]
    )
    low = ends[:, 0].min(axis=0)
    high = ends[:, 1].max(axis=0)
    # Distance s = b sinh(x h / b), x = 0, 1, 2 ...: spacing h at the contact, growing
    # as sqrt(1 + (s/b)^2).
    first = np.arcsinh(low * radius_m / GRADING_M)
    last = np.arcsinh(high * radius_m / GRADING_M)
    count = 2 + int((last - first).max() * GRADING_M / STATION_M)

    return np.sinh(np.linspace(first, last, count, axis=1)) * GRADING_M / radius_m


def _ends_at_base(frames: PlaneFrames, latitude_p: Floats, beyond: float) -> Floats:
    """Longitudes a little `beyond` z = 0 on a circle of latitude, (2, plane); -pi and
    pi if it does not meet z = 0.
    """
    lateral_z, depth_z, normal_z = frames.axes_pac[:, :, 2].T
    # z = amplitude cos(longitude - middle) + offset
    amplitude = np.cos(latitude_p) * np.hypot(lateral_z, depth_z)

    offset = np.sin(latitude_p) * normal_z
    if np.any(offset < -0.999 * amplitude):
        raise InputError(
            "B-scan plane: it does not meet the wall above its base; use a smaller gap"
            " or tilt"
        )

    closed = offset >= amplitude
    middle = np.where(closed, 0.0, np.arctan2(lateral_z, -depth_z))
    half = (
        np.arccos(np.clip(-offset / np.maximum(amplitude, 1e-12), -1.0, 1.0)) + beyond
    )
    half = np.where(closed, np.pi, np.minimum(half, np.pi))

    return np.stack([middle - half, middle + half])


PARALLEL_M = 0.4e-3  # between the parallels: curves are 1 um off at 0.5 mm
# how far across the plane the material may have moved; doubled where that is not enough
BRACKET_M = 0.7e-3
WIDEST_BRACKET_M = 8e-3


def cut_sections(
    mesh: HexMesh, planes: Sequence[ScanPlane], modes_knc: Floats, weights_pfk: Floats
) -> list[list[WallSection]]:
    """Cut deformations of a wall, sums of displacement modes (mode, node, 3), by each
    of several planes.

    `weights_pfk`: for each plane the deformations as weights of the modes (plane,
    deformation, mode). Return for each plane its sections, one for each deformation,
    from base to base; a plane that misses the base gives two closed curves.
    """
    axes_pac = np.array(
        [[plane.lateral, plane.depth, plane.normal] for plane in planes]
    )
    frames = PlaneFrames(
        axes_pac, np.array([plane.origin(mesh.radius_m) for plane in planes])
    )
    circles_xp = np.stack(
        [frames.latitudes(mesh.radius_m - inward) for inward in (0.0, mesh.thickness_m)]
    )
    stations_ps = place_stations(frames, circles_xp, mesh.radius_m)
    fields = np.stack([mesh.points_nc, *modes_knc], axis=1)
    surfaces = mesh.outer_qn, mesh.inner_qn
    bracket_m = BRACKET_M

    while bracket_m <= WIDEST_BRACKET_M:
        margin = bracket_m / mesh.radius_m  # on either side of both undeformed circles
        low = circles_xp.min(axis=0) - margin
        high = circles_xp.max(axis=0) + margin
        count = 2 + int((high - low).max() * mesh.radius_m / PARALLEL_M)
        latitudes_pt = np.clip(np.linspace(low, high, count, axis=1), -1.5, 1.5)
        directions = frames.directions(
            *np.broadcast_arrays(stations_ps[:, None], latitudes_pt[..., None])
        )
        grid = _Grid(
            latitudes_pt, stations_ps, *locate(mesh, directions.reshape(-1, 3))
        )

        outer, inner = (
            _follow(mesh, fields, surface_qn, frames, grid, weights_pfk)
            for surface_qn in surfaces
        )
        if outer is not None and inner is not None:
            return [
                [WallSection(*both) for both in zip(*pair, strict=True)]
                for pair in zip(outer, inner, strict=True)
            ]

        bracket_m *= 2.0

    raise SolverError(
        f"section: the wall has moved by more than {from_si(WIDEST_BRACKET_M, 'mm'):g}"
        " mm across the B-scan plane"
    )


class _Grid(NamedTuple):
    """The parallels (plane, parallel) and stations (plane, station), and their
    crossings located in the mesh.
    """

    latitudes_pt: Floats
    stations_ps: Floats
    quads: Integers
    weights_dn: Floats


def _follow(
    mesh: HexMesh,
    fields: Floats,
    surface_qn: Integers,
    frames: PlaneFrames,
    grid: _Grid,
    weights_pfk: Floats,
) -> Floats | None:
    """Return the curve where a surface meets the planes (plane, deformation, station,
    2); None if it leaves the grid.

    `fields` are position and displacement modes of the nodes (node, 1 + mode, 3),
    `surface_qn` nodes of quads. Between two parallels the crossing is found by linear
    interpolation, the elements are evaluated there, and the micrometres that are
    missing are taken along the meridian's chord.
    """

    def fields_at(
        quads: Integers, weights_dn: Floats, shape: tuple[int, ...]
    ) -> Floats:
        nodal = fields.reshape(len(fields), -1)[surface_qn[quads]]
        return frames.project((weights_dn[:, None] @ nodal).reshape(*shape, -1, 3))

    planes, parallels = grid.latitudes_pt.shape
    stations = grid.stations_ps.shape[1]
    lines = fields_at(grid.quads, grid.weights_dn, (planes, parallels, stations))

    below = _parallel_below(
        lines[..., 2], weights_pfk, grid, frames.latitudes(mesh.radius_m)
    )
    if below is None:
        return None

    plane = np.arange(planes)[:, None, None]
    station = np.arange(stations)
    start, end = (
        _deform(lines[plane, below + k, station], weights_pfk[:, :, None])
        for k in (0, 1)
    )
    chord = end - start
    step = (grid.latitudes_pt[:, 1] - grid.latitudes_pt[:, 0])[:, None, None]
    latitude = (
        grid.latitudes_pt[:, :1, None] + (below - start[..., 2] / chord[..., 2]) * step
    )
    directions = frames.directions(
        np.broadcast_to(grid.stations_ps[:, None], latitude.shape), latitude
    )
    found = fields_at(*locate(mesh, directions.reshape(-1, 3)), latitude.shape)
    points = _deform(found, weights_pfk[:, :, None])

    return (
        points[..., :2] - chord[..., :2] * (points[..., 2] / chord[..., 2])[..., None]
    )


def _deform(fields: Floats, weights: Floats) -> Floats:
    """Add the weighted modes to the position: (..., 1 + mode, 3) and (..., mode) to
    (..., 3).
    """
    return fields[..., 0, :] + (weights[..., None, :] @ fields[..., 1:, :])[..., 0, :]


def _parallel_below(
    fields_ptsm: Floats, weights_pfk: Floats, grid: _Grid, circle_p: Floats
) -> Integers | None:
    """Return the parallel after which the surface rises through the plane (plane,
    deformation, station).

    `fields_ptsm` are the height over the plane and its modes. Where the surface rises
    through the plane more than once (linear mechanics beyond all its bounds turns it
    inside out), the crossing nearest to the undeformed circle counts. None where it
    does not rise through the plane at all.
    """
    height_pfts = fields_ptsm[:, None, ..., 0] + np.einsum(
        "pfk,ptsk->pfts", weights_pfk, fields_ptsm[..., 1:]
    )
    under = height_pfts < 0.0

    rises = under[:, :, :-1] & ~under[:, :, 1:]
    if not rises.any(axis=2).all():
        return None

    middles_pt = 0.5 * (grid.latitudes_pt[:, 1:] + grid.latitudes_pt[:, :-1])
    distance = np.abs(middles_pt - circle_p[:, None])[:, None, :, None]
    return np.argmin(np.where(rises, distance, np.inf), axis=2)


WALL = 255  # the value of a pixel of the wall; 0 elsewhere
# parts of a pixel: an edge meant to run through pixel centres is not moved off them by
# the last bit
SNAP = 2.0**20


def slice_window(
    study: SliceStudy,
    top_m: float,
    framing_lateral_m: float = 0.0,
    framing_depth_m: float = 0.0,
) -> SliceWindow:
    """Place the window of a slice in the plane's frame: laterally centred, row 0
    `margin_m` above the unloaded wall.

    `top_m` is the smallest depth of the unloaded wall's section (with IOP and gravity,
    without the needle). The framing moves the wall right and down in the slice.

    >>> slice_window(SliceStudy(), top_m=0.0).left_m
    -0.007
    """
    left_m = -0.5 * study.columns * study.pixel_m - framing_lateral_m
    top_m = top_m - study.margin_m - framing_depth_m
    return SliceWindow(
        left_m=left_m,
        top_m=top_m,
        columns=study.columns,
        rows=study.rows,
        pixel_m=study.pixel_m,
    )


def fill_section(section: WallSection, window: SliceWindow) -> Bytes:
    """Draw a section, (rows, columns): `WALL` (255) in each pixel whose centre lies in
    the wall, else 0.

    Where a section overlaps itself it is still wall (winding number not 0); parts of it
    that leave the window are cut off. A centre on the contour belongs to the side to
    its right, or below it, so that walls that touch neither overlap nor leave a seam.

    >>> square = np.array([[0.0, 0.0], [3.0, 0.0]])
    >>> window = SliceWindow(left_m=-1.0, top_m=0.0, columns=5, rows=3, pixel_m=1.0)
    >>> fill_section(WallSection(square, square + [0.0, 2.0]), window)
    array([[  0, 255, 255, 255,   0],
           [  0, 255, 255, 255,   0],
           [  0,   0,   0,   0,   0]], dtype=uint8)
    """
    # In pixels: the centre of column c, row r is at (c, r).
    contour = np.concatenate([section.outer, section.inner[::-1], section.outer[:1]]).T
    origin = np.array([[window.left_m], [window.top_m]])
    across, down = np.rint((contour - origin) * (SNAP / window.pixel_m)) / SNAP - 0.5
    # The winding number of a centre: the signed edges that the ray from there upwards
    # meets.
    edge, column, sense = columns_crossed(across, window.columns)
    row = down[edge] + (column - across[edge]) * (
        np.diff(down)[edge] / np.diff(across)[edge]
    )
    first_below = np.clip(np.ceil(row - 0.5 / SNAP), 0, window.rows).astype(np.intp)
    entered = np.bincount(
        first_below * window.columns + column, sense, (window.rows + 1) * window.columns
    )
    winding = np.cumsum(entered.reshape(-1, window.columns)[:-1], axis=0, dtype=np.int8)

    return np.asarray(
        cv2.threshold(winding.view(np.uint8), 0, WALL, cv2.THRESH_BINARY)[1],
        dtype=np.uint8,
    )


def columns_crossed(place: Floats, columns: int) -> tuple[Places, Places, Places]:
    """Return edge, column, and sense (1: to growing columns, else -1) of a line's
    crossings with columns 0, 1, 2 ...

    `place`, in columns: of the line's points. An edge crosses from ceil(start) to
    ceil(end) - 1, or the other way.
    """
    ends = np.clip(np.ceil(place), 0, columns).astype(np.intp)
    steps = np.diff(ends)
    crossed = np.abs(steps)
    edge = np.repeat(np.arange(len(steps)), crossed)
    nth = np.arange(len(edge)) - (np.cumsum(crossed) - crossed)[edge]
    return edge, np.minimum(ends[:-1], ends[1:])[edge] + nth, np.sign(steps)[edge]
