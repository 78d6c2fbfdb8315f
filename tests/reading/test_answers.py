"""Answers of a force reader to raw frames: walls of known force, other surfaces, frames
with a needle.
"""

from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import (
    CLEAN,
    GAP_M,
    IOP_PA,
    KNOWN,
    LIBRARY,
    MODULUS_PA,
    SCALE,
    STEEL,
    STUDY,
    THICKNESS_M,
    image,
    tip_of,
    wall_section,
)
from analytic_library import made_up_library
from small_models import FIVE_MN, FixedNetwork, force_reader

from scleraforce.base.errors import InputError
from scleraforce.fit.unknowns import GAP
from scleraforce.lab.drawn_bscan import draw_shaft, render_bscan
from scleraforce.lab.tissue_light import sample_optics
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.reading import interval_widths
from scleraforce.reading.answer import Answer, Reading
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import SHIFTS, ForceReader
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import boundary_slice


def answer(
    frame: np.ndarray, setup: Setup | None = KNOWN, model: ForceReader | None = None
) -> Answer:
    return (model or force_reader()).read(frame, SCALE, setup or Setup())


def withdrawn(found: Answer) -> str:
    """The reason of an answer that is not usable and withdraws."""
    assert (found.usable, found.predicted, found.probabilities, found.force_n) == (
        False,
        2,
        None,
        None,
    )
    return found.reason


def plate(
    depth_m: float, thickness_m: float = 0.6e-3, slope: float = 0.0
) -> WallSection:
    lateral = np.linspace(-9e-3, 9e-3, 300)
    outer = np.stack([lateral, depth_m + slope * lateral], axis=1)
    return WallSection(outer, outer + np.array([0.0, thickness_m]))


def ball(radius_m: float) -> WallSection:
    """A shell of another radius than an eye's."""
    angle = np.linspace(-1, 1, 400) * min(1.5, 9e-3 / radius_m)
    centre = np.array([0.0, 0.4e-3 + radius_m])
    around = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    return WallSection(
        centre + radius_m * around, centre + (radius_m - 0.6e-3) * around
    )


@pytest.mark.parametrize("force_n", [0.003, 0.007, 0.015, 0.035])
def test_a_frame_of_known_force_is_read_with_force_interval_and_contact(
    force_n: float,
) -> None:
    agreeing = Reading(
        probabilities=(0.3, 0.3, 0.4),
        force_n=force_n,
        interval_n=(0.0, 0.06),
        contact_m=0.3e-3,
    )
    found = answer(image(wall_section(tip_of(force_n))), model=force_reader(agreeing))
    assert found.usable
    assert not found.warnings
    assert found.predicted == STUDY.classes.classify(force_n)
    assert found.interval_n[0] < force_n < found.interval_n[1]
    assert found.force_n == pytest.approx(force_n, abs=1.2e-3)
    assert found.contact_m == pytest.approx(0.3e-3, abs=0.1e-3)
    assert found.can_calibrate
    assert sum(found.probabilities) == pytest.approx(1.0)


def test_the_default_method_answers_and_the_other_one_checks_it() -> None:
    frame = image(wall_section(tip_of(0.015)))
    by_fit, by_network = (
        answer(frame, model=force_reader(default=name)) for name in ("fit", "network")
    )
    assert (by_network.force_n, by_network.predicted) == (0.005, 1)
    assert by_fit.force_n == pytest.approx(0.015, abs=1e-3)
    of_fit = dict(by_fit.readings)["fit"].interval_n
    assert of_fit[0] > 0.006
    # one is wrong, and nobody says which
    assert by_fit.interval_n == by_network.interval_n == (0.004, of_fit[1])

    for found in (by_fit, by_network):
        assert dict(found.readings)["network"] == FIVE_MN
        assert len(found.warnings) == 1
        assert "they differ by more than their intervals allow" in found.warnings[0]
        assert found.usable

    agreeing = Reading(
        probabilities=(0.0, 1.0, 0.0),
        force_n=0.0152,
        interval_n=(0.014, 0.0165),
        contact_m=0.0,
    )
    agreed = answer(frame, model=force_reader(agreeing))
    assert agreed.warnings == ()
    assert agreed.interval_n == dict(agreed.readings)["fit"].interval_n


def test_a_contact_outside_the_training_is_withdrawn_from_whichever_method_sees_it_there():
    for lateral_m in (-2.5e-3, 1.6e-3):
        found = answer(image(wall_section(tip_of(0.015), lateral_m=lateral_m)))
        assert withdrawn(found).startswith(
            f"contact {lateral_m * 1e3:.1f} mm from the frame's middle, the model was"
        )

    frame = image(wall_section(tip_of(0.015)))
    for default in ("fit", "network"):
        far = force_reader(replace(FIVE_MN, contact_m=1.3e-3), default)
        assert withdrawn(answer(frame, model=far)).startswith(
            "contact 1.3 mm from the frame's middle"
        )
        # the network is as unsure as that
        near = force_reader(replace(FIVE_MN, contact_m=1.2e-3), default)
        assert answer(frame, model=near).usable


def test_the_network_is_shown_shifted_slices_and_what_is_known() -> None:
    model = force_reader()
    frame = image(wall_section(tip_of(0.02)))
    answer(frame, KNOWN, model)
    ((cuts, known),) = model.network.shown
    assert known == KNOWN
    seen = find_wall(frame, SCALE)
    np.testing.assert_array_equal(cuts[0], boundary_slice(seen, SCALE, STUDY.slice))

    for cut, shift in zip(cuts, SHIFTS, strict=True):
        # a window that starts lower shows the wall higher
        up = -shift * STUDY.slice.pixel_m / SCALE.depth_m
        moved = replace(
            seen, outer_row=seen.outer_row + up, inner_row=seen.inner_row + up
        )
        np.testing.assert_array_equal(cut, boundary_slice(moved, SCALE, STUDY.slice))

    assert len({cut.tobytes() for cut in cuts}) == len(SHIFTS)


def test_an_eye_outside_the_training_is_withdrawn_from_although_one_could_calibrate_on_it():
    stiff = Modulus(mean_pa=0.9e6, sd_pa=1e3, source="own")
    frame = image(wall_section(tip_of(0.002)))

    for setup in (
        replace(KNOWN, eye=replace(KNOWN.eye, modulus=stiff)),
        replace(KNOWN, eye=replace(KNOWN.eye, iop_pa=3000.0)),
        replace(KNOWN, eye=replace(KNOWN.eye, thickness_m=1.1e-3)),
        replace(KNOWN, needle=replace(KNOWN.needle, gap_m=1.5e-3)),
    ):
        found = answer(frame, setup)
        assert "the model was trained on" in withdrawn(found)
        assert found.can_calibrate


GRADIENT = np.linspace(0.0, 4000.0, 512)[:, None] + np.random.default_rng(0).normal(
    0.0, 100.0, (512, 512)
)
NO_EYES = {
    "blank": np.full((512, 512), 700, dtype=np.uint16),
    "black": np.zeros((512, 512), dtype=np.uint16),
    "noise": np.random.default_rng(0).integers(0, 4096, (512, 512)).astype(np.uint16),
    "gradient": GRADIENT.clip(0, 4095).astype(np.uint16),
    "plate": image(plate(1.2e-3)),
    "tilted plate": image(plate(1.2e-3, 0.8e-3, slope=0.08)),
    "coverslip": image(plate(0.8e-3, 0.15e-3)),
    "double layer": np.maximum(
        image(plate(0.9e-3, 0.3e-3), 2), image(plate(1.8e-3, 0.5e-3), 3)
    ),
    "large ball": image(ball(40e-3)),
    "upside down": image(wall_section(tip_of(0.002)))[::-1].copy(),
}


@pytest.mark.parametrize("name", NO_EYES)
@pytest.mark.parametrize(
    "setup",
    [KNOWN, pytest.param(None, marks=pytest.mark.slow)],
    ids=["known", "unknown"],
)
def test_another_surface_is_never_read_as_harmless(
    name: str, setup: Setup | None
) -> None:
    found = answer(NO_EYES[name], setup)
    assert withdrawn(found)
    assert not found.can_calibrate or "not look like the wall" not in found.reason


def test_a_shell_of_another_radius_is_never_read_as_harmless() -> None:
    for radius_m in (4e-3, 5e-3, 7e-3, 20e-3):
        assert answer(image(ball(radius_m))).predicted == 2


def test_a_limbus_at_a_false_scale_is_not_read_as_a_dent() -> None:
    lateral = np.linspace(-9e-3, 9e-3, 600)
    depths = []

    for radius_m, lean_rad in (
        (12e-3, -0.3),
        (7.8e-3, 0.03),
    ):
        # sclera and cornea meet 1 mm beside the middle
        beside_m = (lateral + 1e-3) / 1.8 - radius_m * np.sin(lean_rad)
        depths.append(
            0.8
            * (
                radius_m * np.cos(lean_rad)
                - np.sqrt(np.maximum(radius_m**2 - beside_m**2, 0.0))
            )
        )

    outer = np.stack(
        [lateral, np.minimum(*depths) - np.minimum(*depths).min() + 0.6e-3], axis=1
    )
    outer = outer[outer[:, 1] < 4.5e-3]
    down_m = 0.65e-3 * np.hypot(1.0, np.gradient(outer[:, 1], outer[:, 0]))
    frame = image(WallSection(outer, outer + np.stack([0.0 * down_m, down_m], axis=1)))
    agreeing = Reading(
        probabilities=(0.0, 0.1, 0.9),
        force_n=0.034,
        interval_n=(0.02, 0.05),
        contact_m=0.0,
    )

    for default in ("fit", "network"):
        found = answer(frame, Setup(), force_reader(agreeing, default))
        assert "without a dent" in withdrawn(found)
        assert dict(found.readings)["fit"].force_n > 0.02


def test_a_wall_that_is_not_as_thick_as_stated_or_hardly_in_view_is_withdrawn_from():
    model = force_reader()
    model.study = replace(
        STUDY, reader=replace(STUDY.reader, thickness_m=Range(min=0.3e-3, max=0.9e-3))
    )

    for stated_m in (0.85e-3, 0.4e-3 - 60e-6):
        found = answer(
            image(wall_section(tip_of(0.01))),
            replace(KNOWN, eye=replace(KNOWN.eye, thickness_m=stated_m)),
            model,
        )
        assert (
            "thick" in withdrawn(found)
            or "does not look like the wall of an eye" in found.reason
        )

    close = PixelScale(lateral_m=5e-3 / 512, depth_m=SCALE.depth_m)
    frame = image(wall_section(tip_of(0.01)), scanner=replace(STUDY.oct, width_m=5e-3))
    model = force_reader()
    assert "mm are needed by the network" in withdrawn(
        model.read_live(frame, close, KNOWN)
    )

    for modulus in (None, Modulus.stated(MODULUS_PA)):
        found = model.read(
            frame, close, replace(KNOWN, eye=replace(KNOWN.eye, modulus=modulus))
        )
        assert withdrawn(found).endswith("mm are needed without a calibration")
        assert found.can_calibrate


def test_narrow_frames_are_read_by_the_fit_alone_with_wider_intervals() -> None:
    force_n = 0.015
    widths = []

    for width_m in (15e-3, 10e-3, 5e-3, 4.5e-3):
        scanner = replace(STUDY.oct, width_m=width_m)
        frame = image(wall_section(tip_of(force_n), lateral_m=0.0), scanner=scanner)
        found = force_reader().read(frame, PixelScale.of(scanner), KNOWN)
        if width_m < 5e-3:
            assert withdrawn(found).endswith("at least 3.5 mm are needed")
            break

        assert found.interval_n[0] < force_n < found.interval_n[1]
        assert found.force_n == pytest.approx(force_n, abs=1.2e-3)
        assert ("needed by the network" in "".join(found.warnings)) == (width_m < 15e-3)
        widths.append(dict(found.readings)["fit"].width_n)

    assert widths == sorted(widths)


def test_a_reading_that_is_not_a_number_never_passes_and_as_a_check_is_a_warning():
    frame = image(wall_section(tip_of(0.015)))
    for broken in (
        {"force_n": nan},
        {"probabilities": (nan, nan, nan)},
        {"interval_n": (nan, 0.006)},
    ):
        model = force_reader(replace(FIVE_MN, **broken), "network")
        assert "not a number" in withdrawn(answer(frame, model=model))

    found = answer(frame, model=force_reader(replace(FIVE_MN, force_n=nan)))
    assert found.usable
    assert "not a number" in found.warnings[0]


def test_two_methods_so_far_apart_that_no_class_is_left_give_no_answer() -> None:
    """The network reads 5 mN, from 4 on; the fit 20 and 35 mN. Alone neither interval
    reaches into every class.
    """
    below, above = (
        answer(image(wall_section(tip_of(force_n)))) for force_n in (0.020, 0.035)
    )
    assert below.usable
    assert below.interval_n[0] == 0.004
    reason = withdrawn(above)
    assert reason.startswith("the fit reads 3")
    assert (
        "the network 5.0 mN: they differ by more than their intervals allow; from 4"
        " to 3" in reason
    )
    assert reason.endswith(" mN, every class is possible")
    unsure = Reading(
        probabilities=(0.2, 0.5, 0.3),
        force_n=0.02,
        interval_n=(0.0, 0.06),
        contact_m=0.3e-3,
    )
    agreed = answer(
        image(wall_section(tip_of(0.020))),
        model=force_reader(unsure, default="network"),
    )
    assert agreed.usable  # both agree: then a wide interval is an answer
    assert agreed.interval_n == (0.0, 0.06)


def test_a_dent_that_leaves_the_window_is_read_where_its_flanks_show_enough() -> None:
    # of an eye half as stiff, under half the IOP: the same shape at half the force
    tip_m = 4.2e-3
    softness = 2.0
    frame = image(wall_section(tip_m, surface_m=0.4e-3))
    wall = (np.array([THICKNESS_M]), np.array([IOP_PA / MODULUS_PA]), np.array([tip_m]))
    force_n = float(LIBRARY.forces(*wall)[0]) * MODULUS_PA / softness
    modulus_pa = MODULUS_PA / softness
    modulus = Modulus(mean_pa=modulus_pa, sd_pa=0.01 * modulus_pa, source="own")
    soft = replace(
        KNOWN, eye=replace(KNOWN.eye, modulus=modulus, iop_pa=IOP_PA / softness)
    )
    ends_n = (0.9 * force_n, 1.1 * force_n)
    agreeing = Reading(
        probabilities=(0.0, 0.5, 0.5),
        force_n=force_n,
        interval_n=ends_n,
        contact_m=0.3e-3,
    )
    read = answer(frame, soft, force_reader(agreeing))
    assert read.usable
    assert read.interval_n[1] - read.interval_n[0] < 6e-3
    assert read.interval_n[0] < force_n < read.interval_n[1]
    assert not read.can_calibrate

    # If E is unknown, or the network reads 5 mN, the interval is wider.
    for open_ended in (
        answer(
            frame,
            replace(soft, eye=replace(soft.eye, modulus=None)),
            force_reader(agreeing),
        ),
        answer(frame, soft),
    ):
        assert "leaves the window" in withdrawn(open_ended)

    wide = answer(
        image(wall_section(tip_of(0.02))),
        replace(KNOWN, eye=replace(KNOWN.eye, modulus=None)),
        force_reader(agreeing),
    )
    assert wide.usable  # within the window
    assert wide.interval_n[1] > 0.03


def test_a_dent_of_which_the_flanks_alone_are_in_view_is_read_unless_the_network_doubts_its_class():
    tip_m = 6.5e-3
    frame = image(wall_section(tip_m, surface_m=1.2e-3))
    wall = np.array([[THICKNESS_M], [IOP_PA / MODULUS_PA], [tip_m]])
    assert np.isfinite(find_wall(frame, SCALE).outer_row).mean() < 0.4
    force_n = float(LIBRARY.forces(*wall)[0]) * MODULUS_PA
    higher = replace(
        FIVE_MN, force_n=1.4 * force_n, interval_n=(1.3 * force_n, 1.5 * force_n)
    )
    read = answer(frame, model=force_reader(higher))
    assert (read.usable, read.predicted, read.interval_n[1]) == (True, 2, 1.5 * force_n)
    assert read.force_n == pytest.approx(force_n, rel=0.06)
    assert "leaves the window" in withdrawn(answer(frame))


def test_a_dent_farther_from_the_pole_needs_a_larger_force() -> None:
    frame = image(wall_section(tip_of(0.02)))
    middle = answer(frame)
    wall = (
        np.array([THICKNESS_M]),
        np.array([IOP_PA / MODULUS_PA]),
        np.array([middle.fit.tip_m]),
    )

    for polar_rad in (0.0, 0.8):
        expected = (
            LIBRARY.for_contact(polar_rad).forces(*wall)[0] / LIBRARY.forces(*wall)[0]
        )
        found = answer(
            frame, replace(KNOWN, needle=replace(KNOWN.needle, polar_rad=polar_rad))
        )
        assert found.force_n / middle.force_n == pytest.approx(expected, rel=2e-3)

    assert (
        answer(
            frame, replace(KNOWN, needle=replace(KNOWN.needle, polar_rad=1.5))
        ).force_n
        == answer(
            frame, replace(KNOWN, needle=replace(KNOWN.needle, polar_rad=0.5 * np.pi))
        ).force_n
    )


FORCE_N = 0.02
SHAFT = replace(STEEL, angle_rad=0.3, above_m=0.5e-3)
NEAR = replace(KNOWN, needle=replace(KNOWN.needle, gap_m=0.1e-3))


@pytest.fixture(scope="module")
def crossed(monkeypatch_module: pytest.MonkeyPatch) -> np.ndarray:
    """A frame 0.1 mm beside the axis of a needle that crosses it, at 20 mN."""
    monkeypatch_module.setattr("analytic_frames.GAP_M", NEAR.needle.gap_m)
    section = wall_section(tip_of(FORCE_N))
    middle = int(np.abs(section.outer[:, 0] - 0.3e-3).argmin())
    shaft = draw_shaft(SHAFT, section.outer[middle], 0.0, STUDY.oct)
    rng = np.random.default_rng(1)

    return render_bscan(
        section, STUDY.oct, sample_optics(CLEAN, STUDY.oct, rng), rng, shaft
    ).frame


@pytest.fixture(scope="module")
def monkeypatch_module() -> "pytest.MonkeyPatch":
    with pytest.MonkeyPatch.context() as patch:
        yield patch


def test_the_fit_reads_the_wall_beside_a_needle_alone(crossed: np.ndarray) -> None:
    for default in ("fit", "network"):
        reader = force_reader(default=default)
        found = reader.read(crossed, SCALE, NEAR)
        assert found.usable, found.reason
        assert found.needle.angle_rad == pytest.approx(0.3, abs=0.05)
        assert found.force_n == pytest.approx(FORCE_N, rel=0.05)
        assert [name for name, _ in found.readings] == ["fit"]
        assert "the fit alone reads it" in found.warnings[0]
        assert not reader.network.shown

    without = answer(
        image(wall_section(tip_of(FORCE_N))),
        replace(KNOWN, needle=replace(KNOWN.needle, gap_m=GAP_M)),
    )
    assert without.needle is None
    assert [name for name, _ in without.readings] == ["network", "fit"]
    unknown = answer(crossed, replace(NEAR, needle=replace(NEAR.needle, gap_m=None)))
    assert unknown.usable, unknown.reason
    assert unknown.interval_n[0] < FORCE_N < unknown.interval_n[1]
    # the needle's radius; trained was 0.3 to 1 mm
    assert unknown.fit.unknown[GAP] < 0.35e-3


def test_a_frame_with_a_needle_is_withdrawn_from_in_the_loop_and_far_from_the_stated_plane(
    crossed,
) -> None:
    known = replace(
        NEAR, needle=replace(NEAR.needle, gap_m=0.32e-3)
    )  # the network was trained on such gaps
    live = force_reader(FIVE_MN).read_live(crossed, SCALE, known)
    assert "a needle hides a part of the wall" in withdrawn(live)
    assert np.isnan(live.segmentation.outer_row[slice(*live.needle.hidden)]).all()
    near = force_reader(FIVE_MN).read_live(crossed, SCALE, NEAR)
    assert (
        withdrawn(near)
        == "gap between B-scan and needle axis 0.1 mm, the model was trained on 0.3 to"
        " 1 mm"
    )
    far = answer(crossed, replace(NEAR, needle=replace(NEAR.needle, gap_m=0.8e-3)))
    assert withdrawn(far).startswith(
        "a needle is seen, although the B-scan is said to pass 0.8 mm from its axis"
    )
    assert far.needle is not None


def test_a_classifier_withdraws_from_a_needle_in_the_picture(
    crossed: np.ndarray, write_model, tmp_path: Path
) -> None:
    model = load_reader(write_model(tmp_path / "model", STUDY).path)
    for found in (
        model.read(crossed, SCALE, NEAR),
        model.read_live(crossed, SCALE, NEAR),
    ):
        assert "a needle hides a part of the wall" in withdrawn(found)
        assert found.needle is not None

    assert model.read(image(wall_section(tip_of(FORCE_N))), SCALE, KNOWN).usable


def test_the_fit_s_interval_is_wider_beside_a_needle_and_under_a_conjunctiva(
    crossed: np.ndarray, monkeypatch
) -> None:
    widths = []
    for stretch in (1.0, 1.5):
        monkeypatch.setattr(interval_widths, "NEEDLE_STRETCH", stretch)
        widths.append(dict(answer(crossed, NEAR).readings)["fit"].width_n)

    assert widths[1] == pytest.approx(1.5 * widths[0])
    wall = find_wall(crossed, SCALE)
    both = interval_widths.frame_stretch(
        replace(wall, conjunctiva_m=1e-4), NEAR, STUDY.reader
    )
    assert both == pytest.approx(1.5 * interval_widths.CONJUNCTIVA_STRETCH)
    unseen = replace(wall, needle=None)  # as near, it is there all the same
    stretches = [
        interval_widths.frame_stretch(
            unseen, replace(NEAR, needle=replace(NEAR.needle, gap_m=gap)), STUDY.reader
        )
        for gap in (1e-4, 4e-4, None)
    ]
    assert stretches == [1.5, 1.0, 1.0]


STIFFENED = made_up_library()


@pytest.fixture
def reader() -> ForceReader:
    return ForceReader(Path("model"), STUDY, FixedNetwork(FIVE_MN), STIFFENED, "fit")


def test_an_eye_is_read_with_walls_of_its_tissue_at_its_contact(
    reader: ForceReader,
) -> None:
    found = reader.library_for(
        Setup(eye=Eye(stiffening=5.0), needle=Needle(polar_rad=0.4))
    )
    assert (found.contact_polar_rad, found.stiffening) == (0.4, 5.0)
    assert (
        found.force_ratio_tpd == STIFFENED.for_stiffening(5.0).force_ratio_tpd
    ).all()
    assert (
        reader.library_for(
            Setup(eye=Eye(stiffening=5.0, iop_pa=300.0), needle=Needle(polar_rad=0.4))
        )
        is found
    )
    assert reader.library_for(Setup(needle=Needle(polar_rad=0.4))).stiffening == 0.0
    assert (
        reader.library_for(Setup(eye=Eye(stiffening=5.0))).contact_polar_rad
        == STIFFENED.contact_polar_rad
    )
    assert (
        reader.library_for(
            Setup(eye=Eye(stiffening=5.0), needle=Needle(polar_rad=0.5 * np.pi))
        ).contact_polar_rad
        == STIFFENED.polar_rad[-1]
    )


def test_an_eye_of_other_tissue_than_the_library_s_is_refused(
    reader: ForceReader,
) -> None:
    stiff = Setup(eye=Eye(stiffening=40.0))
    with pytest.raises(
        InputError, match="stiffening: 40 is outside the library's range, 0 to 30"
    ):
        reader.library_for(stiff)

    assert (
        reader.refusal(stiff)
        == "stiffening 40 of the tissue, the model was trained on 0 to 30"
    )
    assert reader.refusal(Setup(eye=Eye(stiffening=30.0))) is None
