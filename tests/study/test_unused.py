"""Keys of a study that a command does not use are refused with the reason and the remedy (each: tests/cli)."""

import pytest

from scleraforce.errors import StudyError
from scleraforce.study import parse_study
from scleraforce.study.unused import refuse_unused


def test_a_key_is_refused_with_the_reason_and_the_remedy() -> None:
    why = "(linear mechanics knows no tissue that stiffens, and a library has a range of it, [library])"
    stiff, formed = "[tissue]\nstiffening = 10.0", "[needle]\ntilt_deg = 5.0\n[[form.wave]]\ndegree = 2"
    for text, work, said in (
        (stiff, ("simulate", "linear"), f"linear mechanics {why}; leave it out, or give --mechanics finite-strain"),
        (stiff, ("generate", "finite-strain"), f"`generate` with finite-strain mechanics {why}; leave it out"),
        (stiff, ("train --kind reader", None), f"not used by `train --kind reader` {why}; leave it out"),
        (formed, ("simulate", "linear"), "study: form.wave, needle.tilt_deg: not used by `simulate` with linear "
         "mechanics; leave them out, or give --mechanics finite-strain"),
        ("[[form.wave]]\ndegree = 2", ("generate", "linear"), "with linear mechanics; leave it out"),
        ("[eye]\ndensity_kg_m3 = 1000.0", ("generate", "finite-strain"), "leave it out, or give --mechanics linear"),
    ):  # fmt: skip
        with pytest.raises(StudyError) as found:
            refuse_unused(parse_study(text), *work)
        assert str(found.value).endswith(said)


def test_a_key_that_another_one_switches_off_is_refused() -> None:
    for text, message in (
        ("[supports]\nbed_stiffness_kpa_per_mm = 1.0", r"bed_stiffness_kpa_per_mm: has no effect"),
        ('[supports]\nkind = "straps"\nbed_shear_stiffness_kpa_per_mm = 0.1', r'"straps"; .* give "bed" or'),
        ('[supports]\nkind = "bed"\nstrap_stiffness_n_per_m = 9.0', r'strap_stiffness_n.*kind = "bed"'),
        ("[supports]\nmedial_azimuth_deg = 60.0", r'medial_azimuth_deg: has no .*kind = "clamped"'),
        ("[needle]\ntilt_direction_deg = 60.0", r"tilt_direction_deg: has no effect with needle\.tilt"),
    ):
        with pytest.raises(StudyError, match=message):
            refuse_unused(parse_study(text), "simulate", "finite-strain")
