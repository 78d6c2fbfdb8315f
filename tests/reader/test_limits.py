"""What is known of an eye and lies outside a model's training."""

from dataclasses import replace
from math import nan

import pytest

from scleraforce.known import Known, Modulus
from scleraforce.reader.limits import outside_training
from scleraforce.study import LibraryStudy, Range, ReaderStudy

TRAINED = ReaderStudy(
    youngs_modulus_pa=Range(min=0.18e6, max=0.55e6),
    iop_pa=Range(min=120.0, max=560.0),
    thickness_m=Range(min=0.45e-3, max=0.85e-3),
    gap_m=Range(min=0.35e-3, max=1e-3),
)
HELD = LibraryStudy(stiffening=Range(min=0.0, max=20.0))
INSIDE = Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"), iop_pa=270.0, thickness_m=0.6e-3, gap_m=0.5e-3)


def test_an_eye_inside_the_training_is_inside_also_on_its_bounds() -> None:
    assert outside_training(Known(), TRAINED, HELD) is None
    assert outside_training(INSIDE, TRAINED, HELD) is None
    for end in (0, 1):
        modulus = Modulus(mean_pa=TRAINED.youngs_modulus_pa.bounds[end], sd_pa=1e3, source="own")
        known = Known(
            modulus=modulus,
            iop_pa=TRAINED.iop_pa.bounds[end],
            thickness_m=TRAINED.thickness_m.bounds[end],
            gap_m=TRAINED.gap_m.bounds[end],
        )
        assert outside_training(known, TRAINED, HELD) is None


def test_an_eye_is_inside_where_the_library_of_the_training_holds_its_tissue() -> None:
    for stiffening in (None, 0.0, 7.0, 20.0):
        assert outside_training(Known(stiffening=stiffening), TRAINED, HELD) is None
    stiff, alone = replace(HELD, stiffening=Range(min=2.0, max=20.0)), replace(HELD, stiffenings=1)
    assert str(outside_training(Known(), TRAINED, stiff)).startswith("stiffening 0 of the tissue")
    assert outside_training(Known(), TRAINED, alone) is None
    assert str(outside_training(Known(stiffening=7.0), TRAINED, alone)).endswith("the model was trained on 0 to 0")


@pytest.mark.parametrize(
    ("known", "words"),
    [
        (Known(modulus=Modulus(mean_pa=0.6e6, sd_pa=1e3, source="own")), "Young's modulus 0.6 MPa"),
        (Known(modulus=Modulus(mean_pa=0.16e6, sd_pa=1e3, source="own")), "Young's modulus 0.16 MPa"),
        (Known(modulus=Modulus(mean_pa=nan, sd_pa=1e3, source="own")), "Young's modulus nan"),
        (Known(iop_pa=1333.0), "IOP 9.998 mmHg"),
        (Known(thickness_m=1e-3), "wall thickness 1000 µm"),
        (Known(gap_m=0.1e-3), "gap between B-scan and needle axis 0.1 mm"),
        (Known(thickness_m=nan), "wall thickness nan"),
        (Known(stiffening=20.5), "stiffening 20.5 of the tissue, the model was trained on 0 to 20"),
        (Known(stiffening=-0.1), "stiffening -0.1 of the tissue"),
        (Known(stiffening=nan), "stiffening nan of the tissue"),
    ],
)
def test_what_is_outside_is_named(known: Known, words: str) -> None:
    reason = outside_training(known, TRAINED, HELD)
    assert reason is not None
    assert reason.startswith(words)


@pytest.mark.parametrize(("mean_pa", "sd_pa"), [(0.172e6, 2e3), (0.58e6, 5e3), (0.155e6, 25e3)])
def test_an_eyes_own_modulus_is_outside_only_by_more_than_it_is_uncertain(mean_pa: float, sd_pa: float) -> None:
    own = Modulus(mean_pa=mean_pa, sd_pa=sd_pa, source="own")
    assert outside_training(Known(modulus=own), TRAINED, HELD) is None
    for source in ("stated", "population"):
        assert outside_training(Known(modulus=replace(own, source=source)), TRAINED, HELD) is not None
    exact = replace(TRAINED, thickness_noise_fraction=0.0, iop_noise_fraction=0.0)
    assert (outside_training(Known(modulus=own), exact, HELD) is None) == (sd_pa == 25e3)


@pytest.mark.parametrize(
    ("thickness", "iop", "sd", "reach"),
    [(0.03, 0.0, 0.01, 0.0608), (0.0, 0.15, 0.01, 0.0510), (0.0, 0.0, 0.04, 0.04), (0.02, 0.09, 0.12, 0.13)],
)
def test_an_own_modulus_may_be_off_by_its_sd_twice_the_thicknesss_error_and_a_third_of_the_pressures(
    thickness: float, iop: float, sd: float, reach: float
) -> None:
    trained = replace(TRAINED, thickness_noise_fraction=thickness, iop_noise_fraction=iop)
    low, high = TRAINED.youngs_modulus_pa.bounds
    for bound, outwards in ((low, -1.0), (high, 1.0)):
        for share, inside in ((0.97, True), (1.03, False)):
            mean_pa = bound * (1.0 + outwards * share * reach)
            own = Modulus(mean_pa=mean_pa, sd_pa=sd * mean_pa, source="own")
            assert (outside_training(Known(modulus=own), trained, HELD) is None) == inside
