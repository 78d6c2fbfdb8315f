"""The mesh that a study asks for, and that of an eye on the study's supports."""

from scleraforce.errors import InputError
from scleraforce.eye.contact import Contact
from scleraforce.eye.graded import graded_globe, graded_mesh
from scleraforce.eye.mesh import HexMesh, build_mesh
from scleraforce.study import Study


def study_mesh(study: Study, thickness_m: float, contact: Contact | None = None) -> HexMesh:
    """Return a study's mesh with one of its wall thicknesses; a graded one needs the contact.

    Raises:
        InputError: a graded mesh for work that shares one mesh among several contacts.
    """
    mesh, radius_m = study.mesh, study.eye.radius_m
    if mesh.kind == "hexahedra":
        return build_mesh(radius_m, thickness_m, mesh.divisions, mesh.level, mesh.layers, mesh.order)
    if contact is None:
        raise InputError('mesh: kind: "graded" serves one contact, and this has several; use "hexahedra"')
    return graded_mesh(radius_m, thickness_m, contact, mesh.core, mesh.rings, mesh.layers, mesh.order)


def supported_mesh(study: Study, thickness_m: float, contact: Contact) -> HexMesh:
    """Return the mesh of an eye on the study's supports: a bed carries a whole globe, anything else a half-sphere.

    Raises:
        InputError: a bed for a mesh that is not graded: there are no other whole globes.
    """
    mesh = study.mesh
    if not study.supports.has_bed:
        return study_mesh(study, thickness_m, contact)
    if mesh.kind != "graded":
        raise InputError(f'supports: kind: "{study.supports.kind}" carries a whole globe; use mesh kind "graded"')
    return graded_globe(study.eye.radius_m, thickness_m, contact, mesh.core, mesh.rings, mesh.layers, mesh.order)
