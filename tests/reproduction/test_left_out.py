"""Each eye left out of the mean modulus: labels at another modulus, and the file between two stages."""

from pathlib import Path

import numpy as np
import pytest

from scleraforce.eye.contact import Contact
from scleraforce.eye.mesh import build_mesh
from scleraforce.learning.classifier.samples import classes_at_modulus
from scleraforce.mechanics.linear import LinearWall
from scleraforce.reader.metrics import Proportion
from scleraforce.reproduction.readings import LeftOut, read_left_out_file, write_left_out
from scleraforce.section.cut import cut_sections
from scleraforce.section.plane import ScanPlane
from scleraforce.study import ClassesStudy


def test_a_stiffer_wall_puts_the_same_slice_into_a_higher_class() -> None:
    force_n = np.array([0.0, 0.0047, 0.0053, 0.028, 0.033])
    assert classes_at_modulus(force_n, 1.0, ClassesStudy()).tolist() == [0, 0, 1, 1, 2]
    assert classes_at_modulus(force_n, 1.1, ClassesStudy()).tolist() == [0, 1, 1, 2, 2]
    assert classes_at_modulus(force_n, 0.9, ClassesStudy()).tolist() == [0, 0, 0, 1, 1]


def test_a_section_at_another_modulus_is_that_of_the_scaled_force_to_a_tenth_of_a_pixel() -> None:
    # Pressure and weight do not scale with the force; what they add is what the relabelling neglects.
    mesh = build_mesh(12e-3, 0.6e-3, 8, 0, 1, 2)
    wall = LinearWall(mesh, 0.45)
    plane = ScanPlane(Contact(polar_rad=np.radians(35.0)), gap_m=0.5e-3)
    modes_knc = np.stack([266.0 * wall.pressure_nc, wall.needle_cnc([plane.contact], 0.35e-3)[0]])
    here, there = 0.25e6, 0.28e6
    weights_fk = np.array([[1.0 / here, 0.03 / here], [1.0 / there, 0.03 / here]])
    one, other = cut_sections(mesh, [plane], modes_knc, weights_fk[None])[0]
    assert np.abs(one.outer - other.outer).max() < 1e-5
    assert np.abs(one.inner - other.inner).max() < 1e-5


def test_results_survive_their_file(tmp_path: Path) -> None:
    results = (LeftOut("eye-1", 0.25e6, Proportion(23, 25)), LeftOut("eye-2", 0.26e6, Proportion(0, 0)))
    write_left_out(results, tmp_path / "left_out.json")
    assert read_left_out_file(tmp_path / "left_out.json") == results


@pytest.mark.parametrize("ratio", [0.5, 0.95, 1.0, 1.3])
def test_labels_never_fall_where_the_wall_is_stiffer(ratio: float) -> None:
    force_n = np.linspace(0.0, 0.06, 500)
    here, there = (classes_at_modulus(force_n, r, ClassesStudy()) for r in (ratio, ratio * 1.1))
    assert np.all(there >= here)
