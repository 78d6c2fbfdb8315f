"""The mesh that a study asks for."""

from scleraforce.errors import InputError
from scleraforce.eye.contact import Contact
from scleraforce.eye.graded import graded_mesh
from scleraforce.eye.mesh import HexMesh, build_mesh
from scleraforce.study import Study

__all__ = ["study_mesh"]


def study_mesh(study: Study, thickness_m: float, contact: Contact | None = None) -> HexMesh:
    """Return a study's mesh with one of its wall thicknesses; a graded one needs the contact.

    Raises:
        InputError: a graded mesh for work that shares one mesh among several contacts.
    """
    mesh, radius_m = study.mesh, study.eye.radius_m
    if mesh.kind == "hexahedra":
        return build_mesh(radius_m, thickness_m, mesh.divisions, mesh.level, mesh.layers, mesh.order)
    if contact is None:
        raise InputError('mesh: kind: "graded" serves one contact, and this has several; "hexahedra" would do')
    return graded_mesh(radius_m, thickness_m, contact, mesh.core, mesh.rings, mesh.layers, mesh.order)
