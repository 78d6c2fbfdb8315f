"""Meshes graded towards the contact: small elements under the needle, large ones far
away; and the mesh of a study.

The unit disc is an O-grid: a rounded square of quads in the middle, rings of quads
around it that turn into circles and grow outward. Seen as the stereographic image of
the half-sphere (projected from the lower pole, so that the unit circle is the base), a
Moebius transform of the disc moves its middle to the contact. Both maps are conformal:
quads keep their angles, and the base stays the base.
"""

from math import cos, radians, tan

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats, Integers
from scleraforce.base.errors import InputError
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.mechanics.hexahedral_mesh import (
    HexMesh,
    QuadSurface,
    build_mesh,
    extrude_surface,
)
from scleraforce.records.study import Study

CORE_M = 1.0e-3  # half the side of the square in the middle
# share of the disc's radius up to which the rings are alike; beyond it they grow in
# proportion
GRADING = 0.35
ROUNDING = 0.3  # how far the square's corners are drawn in; 0.5 makes a circle of it
# the farthest elements grow with it: 9 mm wide at 50 deg, 11 mm at 60 deg
LARGEST_POLAR_RAD = radians(60.0)
FAR_RINGS = 0.5  # rings of a globe's lower half, as a share of the upper half's


def graded_mesh(
    radius_m: float,
    thickness_m: float,
    contact: Contact,
    core: int = 6,
    rings: int = 14,
    layers: int = 1,
    order: int = 2,
    *,
    whole: bool = False,
) -> HexMesh:
    """Return a half-spherical wall, z >= 0, whose elements are smallest at the contact,
    or a whole sphere.

    There are `core` quads along a side of the square under the needle, 4 `core` around
    every ring, and `rings` from there to the base; `layers` and `order` as in
    `build_mesh`. A whole sphere has fewer rings below z = 0, where it is the mirror
    image of a half-sphere, and no base to clamp; other supports must hold it.
    """
    surface = graded_surface(contact, core, rings, CORE_M / radius_m)
    if whole:
        below = graded_surface(
            contact, core, max(int(FAR_RINGS * rings), 1), 2.0 * CORE_M / radius_m
        )
        # The mirror image of `below` joins on z = 0, where both have the same vertices,
        # as their last ones.
        shared = int(np.sum(below.points_vc[:, 2] == 0.0))
        above = len(surface.points_vc)
        own = len(below.points_vc) - shared
        number = np.concatenate(
            [above + np.arange(own), above - shared + np.arange(shared)]
        )
        points = np.concatenate(
            [surface.points_vc, below.points_vc[:own] * (1.0, 1.0, -1.0)]
        )
        surface = QuadSurface(
            points, np.concatenate([surface.quads_qv, number[below.quads_qv[:, ::-1]]])
        )

    return extrude_surface(surface, radius_m, thickness_m, layers, order)


def graded_surface(
    contact: Contact, core: int, rings: int, core_ratio: float
) -> QuadSurface:
    """Return the upper half of the unit sphere as quads graded towards the contact; its
    edge has z = 0 exactly.

    `core_ratio`: half the side of the square under the needle over the sphere's radius.
    """
    if not 0.0 <= contact.polar_rad <= LARGEST_POLAR_RAD:
        raise InputError(
            f"polar angle: {np.degrees(contact.polar_rad):g} deg; a graded mesh reaches"
            f" to {np.degrees(LARGEST_POLAR_RAD):g} deg"
        )
    if core < 2 or core % 2 or rings < 1:
        raise InputError(
            f"mesh: core {core}, rings {rings}; must be an even core of at least 2 and"
            " at least 1 ring"
        )

    # A length at the contact is 2 cos(polar angle) times its image in the disc
    # (derivatives of both maps there).
    half = core_ratio / (2.0 * cos(contact.polar_rad))
    disc, quads = _o_grid(core, rings, half)
    middle = tan(0.5 * contact.polar_rad)
    image = np.exp(1j * contact.azimuth_rad) * (disc + middle) / (1.0 + middle * disc)
    # Points of the unit sphere with these stereographic images; the last ring is the
    # base, z = 0 exactly.
    height = 1.0 - np.abs(image) ** 2
    height[-4 * core :] = 0.0
    points = np.stack([2.0 * image.real, 2.0 * image.imag, height], axis=1)

    return QuadSurface(points / np.linalg.norm(points, axis=1, keepdims=True), quads)


def _o_grid(
    core: int, rings: int, half: float
) -> tuple[NDArray[np.complex128], Integers]:
    """Points of the unit disc as complex numbers, ring after ring, and its quads; the
    last ring is the circle.
    """
    # The square's grid points in [-1, 1]^2, with the corners drawn in, and their
    # numbers (column, row).
    x, y = np.meshgrid(*[np.linspace(-1.0, 1.0, core + 1)] * 2, indexing="ij")
    square = (
        x * np.sqrt(1.0 - ROUNDING * y**2) + 1j * y * np.sqrt(1.0 - ROUNDING * x**2)
    ).ravel()
    number = np.arange((core + 1) ** 2).reshape(core + 1, core + 1)
    # Grid points on the square's edge, counter-clockwise, each once.
    around = np.concatenate(
        [number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]]
    )
    corner = half * square[around]
    angle = np.arctan2(corner.imag, corner.real)
    # Radii of the rings, from behind the square to 1: even steps near it, growing in
    # proportion far from it.
    nearest = np.arcsinh(half / GRADING)
    farthest = np.arcsinh(1.0 / GRADING)
    places: Floats = GRADING * np.sinh(np.linspace(nearest, farthest, rings + 1)[1:])
    places[-1] = 1.0
    # From the rounded square to circles: its shape, scaled, counts as the square of the
    # radius falls.
    roundness = (1.0 - (half / places) ** 2) / (1.0 - half**2)
    circles = places[:, None] * np.exp(1j * angle)
    scaled = corner * (places / half)[:, None]
    shells = (1.0 - roundness[:, None]) * scaled + roundness[:, None] * circles
    shells[-1] /= np.abs(shells[-1])
    disc = np.concatenate([half * square, shells.ravel()])
    first = np.concatenate(
        [around[None], len(square) + np.arange(rings * 4 * core).reshape(rings, -1)]
    )
    inner = first[:-1]
    outer = first[1:]
    ring_quads = np.stack(
        [inner, outer, np.roll(outer, -1, axis=1), np.roll(inner, -1, axis=1)], axis=-1
    )
    core_quads = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    )

    return disc, np.concatenate([core_quads.reshape(-1, 4), ring_quads.reshape(-1, 4)])


def study_mesh(
    study: Study, thickness_m: float, contact: Contact | None = None
) -> HexMesh:
    """Return a study's mesh with one of its wall thicknesses, for many contacts; a
    graded one needs the contact.
    """
    mesh = study.mesh
    if mesh.kind != "graded":
        return build_mesh(
            study.eye.radius_m,
            thickness_m,
            mesh.divisions,
            mesh.level,
            mesh.layers,
            mesh.order,
        )
    if contact is None:
        raise InputError(
            'mesh: kind: "graded" serves one contact, and this has several; use'
            ' "hexahedra"'
        )

    return graded_mesh(
        study.eye.radius_m,
        thickness_m,
        contact,
        mesh.core,
        mesh.rings,
        mesh.layers,
        mesh.order,
    )


def graded_eye(study: Study, thickness_m: float, contact: Contact) -> HexMesh:
    """Return a graded mesh of a study's size: a whole globe for a bed, else a
    half-sphere.
    """
    size = study.mesh
    return graded_mesh(
        study.eye.radius_m,
        thickness_m,
        contact,
        size.core,
        size.rings,
        size.layers,
        size.order,
        whole=study.supports.has_bed,
    )


def supported_mesh(
    study: Study, thickness_m: float, contact: Contact, *, alone: bool = False
) -> HexMesh:
    """Return the mesh of an eye on the study's supports: a bed carries a whole globe,
    anything else a half-sphere.

    `alone`: the wall serves this contact only, and its answer is not compared with
    walls of other contacts.
    """
    if study.supports.has_bed:
        if not study.mesh.grades_alone:
            raise InputError(
                f'supports: kind: "{study.supports.kind}" carries a whole globe; use'
                ' mesh kind "graded"'
            )
    elif not (
        alone and study.mesh.grades_alone and contact.polar_rad <= LARGEST_POLAR_RAD
    ):
        return study_mesh(study, thickness_m, contact)

    return graded_eye(study, thickness_m, contact)
