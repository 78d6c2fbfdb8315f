import numpy as np
import pytest

from scleraforce.errors import InputError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.graded import study_mesh, supported_mesh
from scleraforce.study import MeshStudy, Study, SupportsStudy

CONTACT = Contact(polar_rad=0.6)
GRADED = MeshStudy(kind="graded", core=2, rings=4)


@pytest.mark.parametrize("kind", ["bed", "bed-and-straps"])
def test_a_bed_carries_a_whole_globe(kind: str) -> None:
    mesh = supported_mesh(Study(mesh=GRADED, supports=SupportsStudy(kind=kind)), 0.5e-3, CONTACT)
    assert mesh.points_nc[:, 2].min() == pytest.approx(-12e-3, rel=1e-2)
    assert len(mesh.base_nodes) == 0


@pytest.mark.parametrize("kind", ["clamped", "straps"])
def test_any_other_support_leaves_the_studys_mesh(kind: str) -> None:
    study = Study(mesh=GRADED, supports=SupportsStudy(kind=kind))
    expected = study_mesh(study, 0.5e-3, CONTACT)
    np.testing.assert_array_equal(supported_mesh(study, 0.5e-3, CONTACT).points_nc, expected.points_nc)


def test_a_bed_needs_a_graded_mesh() -> None:
    with pytest.raises(InputError, match="whole globe"):
        supported_mesh(Study(supports=SupportsStudy(kind="bed")), 0.5e-3, CONTACT)
