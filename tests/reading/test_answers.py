"""Answers of a force reader to raw frames: walls of known force, other surfaces, frames
with a needle.
"""

from dataclasses import replace
from functools import cache
from math import nan
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import (
    CLEAN,
    IOP_PA,
    KNOWN,
    LIBRARY,
    MODULUS_PA,
    SCALE,
    STEEL,
    STUDY,
    THICKNESS_M,
    frame_under,
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
from scleraforce.reading import frame_checks, interval_widths
from scleraforce.reading.answer import Answer, Reading
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import SHIFTS, ForceReader
from scleraforce.records.eye import Modulus
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.two_methods import surface_alone
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import assumed_inner_row, boundary_slice
from virtual_eyes import changed


def answer(
    frame: np.ndarray,
    setup: Setup = KNOWN,
    reading: Reading = FIVE_MN,
    default: str = "fit",
) -> Answer:
    return force_reader(reading, default).read(frame, SCALE, setup)


def withdrawn(found: Answer) -> str:
    """The reason of an answer that is not usable and withdraws."""
    assert (found.usable, found.predicted) == (False, 2)
    assert (found.probabilities, found.force_n) == (None, None)
    return found.reason


def reading(force_n: float, low_n: float, high_n: float) -> Reading:
    """A network's reading that is unsure of the class."""
    return Reading(
        probabilities=(0.2, 0.4, 0.4),
        force_n=force_n,
        interval_n=(low_n, high_n),
        contact_m=0.3e-3,
    )


@pytest.mark.parametrize("force_n", [0.003, 0.007, 0.015, 0.035])
def test_a_frame_of_known_force_is_read_with_force_interval_and_contact(force_n):
    found = answer(frame_under(force_n), KNOWN, reading(force_n, 0.0, 0.06))
    assert found.usable
    assert not found.warnings
    assert found.predicted == STUDY.classes.classify(force_n)
    assert found.interval_n[0] < force_n < found.interval_n[1]
    assert found.force_n == pytest.approx(force_n, abs=1.2e-3)
    assert found.contact_m == pytest.approx(0.3e-3, abs=0.1e-3)
    assert found.can_calibrate
    assert sum(found.probabilities) == pytest.approx(1.0)


def test_the_default_method_answers_and_the_other_one_checks_it():
    frame = frame_under(0.015)
    by_fit, by_network = (answer(frame, default=name) for name in ("fit", "network"))
    assert (by_network.force_n, by_network.predicted) == (0.005, 1)
    assert by_fit.force_n == pytest.approx(0.015, abs=1e-3)
    of_fit = dict(by_fit.readings)["fit"].interval_n
    assert of_fit[0] > 0.006
    # one is wrong, and nobody says which
    assert by_fit.interval_n == by_network.interval_n == (0.004, of_fit[1])

    for found in (by_fit, by_network):
        assert found.usable
        assert dict(found.readings)["network"] == FIVE_MN
        assert [one.code for one in found.remarks] == ["methods-disagree"]

    agreed = answer(frame, KNOWN, reading(0.0152, 0.014, 0.0165))
    assert agreed.warnings == ()
    assert agreed.interval_n == dict(agreed.readings)["fit"].interval_n


@pytest.mark.parametrize("lateral_m", [-2.5e-3, 1.6e-3])
def test_a_contact_outside_the_training_is_withdrawn_from_whichever_method_sees_it_there(
    lateral_m,
):
    moved = answer(image(wall_section(tip_of(0.015), lateral_m=lateral_m)))
    words = f"contact {lateral_m * 1e3:.1f} mm from the frame's middle"
    assert withdrawn(moved).startswith(words)

    # the network is as unsure as 0.25 mm
    far, near = (replace(FIVE_MN, contact_m=m) for m in (1.3e-3, 1.2e-3))
    for default in ("fit", "network"):
        found = answer(frame_under(0.015), KNOWN, far, default)
        assert "contact 1.3 mm from the frame's middle" in withdrawn(found)
        assert answer(frame_under(0.015), KNOWN, near, default).usable


def test_the_network_is_shown_shifted_slices_and_what_is_known():
    model = force_reader()
    frame = frame_under(0.02)
    model.read(frame, SCALE, KNOWN)
    ((cuts, known),) = model.network.shown
    assert known == KNOWN
    seen = find_wall(frame, SCALE)
    # the inner boundary of a slice lies at the stated thickness
    inner_row = assumed_inner_row(seen, SCALE, THICKNESS_M)
    assert np.nanmedian(np.abs(inner_row - seen.inner_row)) < 2.0
    seen = replace(seen, inner_row=inner_row)
    np.testing.assert_array_equal(cuts[0], boundary_slice(seen, SCALE, STUDY.slice))

    for cut, shift in zip(cuts, SHIFTS, strict=True):
        # a window that starts lower shows the wall higher
        up = shift * STUDY.slice.pixel_m / SCALE.depth_m
        rows = {"outer_row": seen.outer_row - up, "inner_row": seen.inner_row - up}
        moved = boundary_slice(replace(seen, **rows), SCALE, STUDY.slice)
        np.testing.assert_array_equal(cut, moved)

    assert len({cut.tobytes() for cut in cuts}) == len(SHIFTS)


@pytest.mark.parametrize(
    "eye",
    [
        {"modulus": Modulus(mean_pa=0.9e6, sd_pa=1e3, source="own")},
        {"iop_pa": 3000.0},
        {"thickness_m": 1.1e-3},
        {"gap_m": 1.5e-3},
    ],
)
def test_an_eye_outside_the_training_is_withdrawn_from_although_one_could_calibrate_on_it(
    eye,
):
    found = answer(frame_under(0.002), changed(KNOWN, **eye))
    assert "the model was trained on" in withdrawn(found)
    assert found.can_calibrate


def plate(depth_m, thickness_m=0.6e-3, slope=0.0):
    lateral_m = np.linspace(-9e-3, 9e-3, 300)
    outer = np.stack([lateral_m, depth_m + slope * lateral_m], axis=1)
    return WallSection(outer, outer + np.array([0.0, thickness_m]))


def ball(radius_m):
    """A shell of another radius than an eye's."""
    angle = np.linspace(-1, 1, 400) * min(1.5, 9e-3 / radius_m)
    around = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    centre = np.array([0.0, 0.4e-3 + radius_m])
    return WallSection(*(centre + r * around for r in (radius_m, radius_m - 0.6e-3)))


RNG = np.random.default_rng(0)
GRADIENT = np.linspace(0.0, 4000.0, 512)[:, None] + RNG.normal(0.0, 100.0, (512, 512))
LAYERS = image(plate(0.9e-3, 0.3e-3), 2), image(plate(1.8e-3, 0.5e-3), 3)
NO_EYES = {
    "blank": np.full((512, 512), 700, dtype=np.uint16),
    "black": np.zeros((512, 512), dtype=np.uint16),
    "noise": RNG.integers(0, 4096, (512, 512)).astype(np.uint16),
    "gradient": GRADIENT.clip(0, 4095).astype(np.uint16),
    "plate": image(plate(1.2e-3)),
    "tilted plate": image(plate(1.2e-3, 0.8e-3, slope=0.08)),
    "coverslip": image(plate(0.8e-3, 0.15e-3)),
    "double layer": np.maximum(*LAYERS),
    "large ball": image(ball(40e-3)),
    "upside down": frame_under(0.002)[::-1].copy(),
}


@pytest.mark.parametrize("name", NO_EYES)
@pytest.mark.parametrize(
    "setup",
    [KNOWN, pytest.param(Setup(), marks=pytest.mark.slow)],
    ids=["known", "unknown"],
)
def test_another_surface_is_never_read_as_harmless(name, setup):
    found = answer(NO_EYES[name], setup)
    assert withdrawn(found)
    assert not found.can_calibrate or "not look like the wall" not in found.reason


@pytest.mark.parametrize("radius_m", [4e-3, 5e-3, 7e-3, 20e-3])
def test_a_shell_of_another_radius_is_never_read_as_harmless(radius_m):
    assert answer(image(ball(radius_m))).predicted == 2


@pytest.mark.parametrize("default", ["fit", "network"])
def test_a_limbus_at_a_false_scale_is_not_read_as_a_dent(default):
    """Sclera and cornea meet 1 mm beside the middle."""
    lateral_m = np.linspace(-9e-3, 9e-3, 600)
    depths_m = []
    for radius_m, lean_rad in ((12e-3, -0.3), (7.8e-3, 0.03)):
        beside_m = (lateral_m + 1e-3) / 1.8 - radius_m * np.sin(lean_rad)
        height_m = np.sqrt(np.maximum(radius_m**2 - beside_m**2, 0.0))
        depths_m.append(0.8 * (radius_m * np.cos(lean_rad) - height_m))

    depth_m = np.minimum(*depths_m)
    outer = np.stack([lateral_m, depth_m - depth_m.min() + 0.6e-3], axis=1)
    outer = outer[outer[:, 1] < 4.5e-3]
    down_m = 0.65e-3 * np.hypot(1.0, np.gradient(outer[:, 1], outer[:, 0]))
    section = WallSection(outer, outer + np.stack([0.0 * down_m, down_m], axis=1))
    found = answer(image(section), Setup(), reading(0.034, 0.02, 0.05), default)
    assert "without a dent" in withdrawn(found)
    assert dict(found.readings)["fit"].force_n > 0.02


@pytest.mark.parametrize("stated_m", [0.85e-3, 0.34e-3])
def test_a_wall_that_is_not_as_thick_as_stated_or_hardly_in_view_is_withdrawn_from(
    stated_m,
):
    thin = Range(min=0.3e-3, max=0.9e-3)
    model = force_reader()
    model.study = replace(STUDY, reader=replace(STUDY.reader, thickness_m=thin))
    found = model.read(frame_under(0.01), SCALE, changed(KNOWN, thickness_m=stated_m))
    reason = withdrawn(found)
    assert "thick" in reason or "does not look like the wall of an eye" in reason

    close = PixelScale(lateral_m=5e-3 / 512, depth_m=SCALE.depth_m)
    frame = image(wall_section(tip_of(0.01)), scanner=replace(STUDY.oct, width_m=5e-3))
    found = force_reader().read_live(frame, close, KNOWN)
    assert "mm are needed by the network" in withdrawn(found)
    for modulus in (None, Modulus.stated(MODULUS_PA)):
        found = force_reader().read(frame, close, changed(KNOWN, modulus=modulus))
        assert withdrawn(found).endswith("mm are needed without a calibration")
        assert found.can_calibrate


def without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every wall be found without its inner boundary."""

    def found(*of_frame: object) -> Segmentation:
        return surface_alone(find_wall(*of_frame), "nobody sees its end", SCALE)

    monkeypatch.setattr(frame_checks, "find_wall", found)


@pytest.mark.parametrize("force_n", [0.003, 0.015, 0.035])
def test_a_surface_alone_is_read_with_the_stated_thickness(force_n, monkeypatch):
    frame = frame_under(force_n)
    both = answer(frame, KNOWN, reading(force_n, 0.0, 0.06))
    without_end(monkeypatch)
    found = answer(frame, KNOWN, reading(force_n, 0.0, 0.06))
    assert (both.boundaries, found.boundaries) == ("both", "surface")
    assert found.to_dict()["boundaries"] == "surface"
    (remark,) = found.remarks
    assert remark.code == "surface-alone"
    assert str(remark).endswith("nobody sees its end")
    assert found.force_n == pytest.approx(force_n, abs=1.2e-3)
    assert found.interval_n[0] < force_n < found.interval_n[1]
    assert not found.can_calibrate
    # the mask that is shown ends at the stated thickness
    rows = found.segmentation.inner_row - both.segmentation.inner_row
    assert np.nanmedian(np.abs(rows)) < 6.0  # of 100


def test_a_surface_alone_of_unknown_thickness_is_read_by_the_fit_alone(
    monkeypatch, write_model, tmp_path
):
    frame = frame_under(0.015)
    unknown = changed(KNOWN, thickness_m=None)
    without_end(monkeypatch)
    found = answer(frame, unknown, reading(0.015, 0.0, 0.06))
    codes = {remark.code for remark in found.remarks}
    assert codes == {"fit-unchecked", "surface-alone"}
    known = answer(frame, KNOWN, reading(0.015, 0.0, 0.06))
    assert np.ptp(found.interval_n) > np.ptp(known.interval_n)

    in_loop = force_reader().read_live(frame, SCALE, unknown)
    assert "its thickness is not stated" in withdrawn(in_loop)
    assert force_reader().read_live(frame, SCALE, KNOWN).usable
    write_model(tmp_path / "classifier", STUDY)
    classifier = load_reader(tmp_path / "classifier")
    assert "its thickness is not stated" in withdrawn(classifier.read(frame, SCALE))


def test_narrow_frames_are_read_by_the_fit_alone_with_wider_intervals():
    force_n = 0.015
    widths_n = []
    for width_m in (15e-3, 10e-3, 5e-3, 4.5e-3):
        scanner = replace(STUDY.oct, width_m=width_m)
        frame = image(wall_section(tip_of(force_n), lateral_m=0.0), scanner=scanner)
        found = force_reader().read(frame, PixelScale.of(scanner), KNOWN)
        if width_m < 5e-3:
            assert withdrawn(found).endswith("at least 3.5 mm are needed")
            continue

        assert found.interval_n[0] < force_n < found.interval_n[1]
        assert found.force_n == pytest.approx(force_n, abs=1.2e-3)
        unread = "needed by the network" in "".join(found.warnings)
        assert unread == (width_m < 15e-3)
        widths_n.append(dict(found.readings)["fit"].width_n)

    assert widths_n == sorted(widths_n)


@pytest.mark.parametrize(
    "broken",
    [{"force_n": nan}, {"probabilities": (nan,) * 3}, {"interval_n": (nan, 0.006)}],
)
def test_a_reading_that_is_not_a_number_never_passes_and_as_a_check_is_a_warning(
    broken,
):
    told = replace(FIVE_MN, **broken)
    found = answer(frame_under(0.015), KNOWN, told, "network")
    assert "not a number" in withdrawn(found)
    checked = answer(frame_under(0.015), KNOWN, told)
    assert checked.usable
    assert "not a number" in checked.warnings[0]


def test_two_methods_so_far_apart_that_no_class_is_left_give_no_answer():
    """The network reads 5 mN, from 4 on; the fit 20 and 35 mN. Alone neither interval
    reaches into every class.
    """
    below = answer(frame_under(0.020))
    assert below.usable
    assert below.interval_n[0] == 0.004
    reason = withdrawn(answer(frame_under(0.035)))
    assert reason.startswith("the fit reads 3")
    assert reason.endswith(" mN, every class is possible")

    # if both agree, a wide interval is an answer
    unsure = reading(0.02, 0.0, 0.06)
    agreed = answer(frame_under(0.020), KNOWN, unsure, "network")
    assert agreed.usable
    assert agreed.interval_n == (0.0, 0.06)


def force_of(tip_m: float, library=LIBRARY) -> float:
    wall = np.array([[THICKNESS_M], [IOP_PA / MODULUS_PA], [tip_m]])
    return float(library.forces(*wall)[0]) * MODULUS_PA


def test_a_dent_that_leaves_the_window_is_read_where_its_flanks_show_enough():
    """Of an eye half as stiff, under half the IOP: the same shape at half the force."""
    frame = image(wall_section(4.2e-3, surface_m=0.4e-3))
    force_n = force_of(4.2e-3) / 2
    half_pa = MODULUS_PA / 2
    modulus = Modulus(mean_pa=half_pa, sd_pa=0.01 * half_pa, source="own")
    soft = changed(KNOWN, modulus=modulus, iop_pa=IOP_PA / 2)
    agreeing = reading(force_n, 0.9 * force_n, 1.1 * force_n)
    read = answer(frame, soft, agreeing)
    assert read.usable
    assert np.ptp(read.interval_n) < 6e-3
    assert read.interval_n[0] < force_n < read.interval_n[1]
    assert not read.can_calibrate

    # If E is unknown, or the network reads 5 mN, the interval is wider.
    for told in ((changed(soft, modulus=None), agreeing), (soft, FIVE_MN)):
        assert "leaves the window" in withdrawn(answer(frame, *told))

    within = answer(frame_under(0.02), changed(KNOWN, modulus=None), agreeing)
    assert within.usable
    assert within.interval_n[1] > 0.03


def test_a_dent_of_which_the_flanks_alone_are_in_view_is_read_unless_the_network_doubts_its_class():
    frame = image(wall_section(6.5e-3, surface_m=1.2e-3))
    assert np.isfinite(find_wall(frame, SCALE).outer_row).mean() < 0.4
    force_n = force_of(6.5e-3)
    higher = reading(1.4 * force_n, 1.3 * force_n, 1.5 * force_n)
    read = answer(frame, KNOWN, higher)
    assert (read.usable, read.predicted, read.interval_n[1]) == (True, 2, 1.5 * force_n)
    assert read.force_n == pytest.approx(force_n, rel=0.06)
    assert "leaves the window" in withdrawn(answer(frame))


def test_a_dent_farther_from_the_pole_needs_a_larger_force():
    middle = answer(frame_under(0.02))
    tip_m = middle.fit.tip_m
    for polar_rad in (0.0, 0.8):
        found = answer(frame_under(0.02), changed(KNOWN, polar_rad=polar_rad))
        expected = force_of(tip_m, LIBRARY.for_contact(polar_rad)) / force_of(tip_m)
        assert found.force_n / middle.force_n == pytest.approx(expected, rel=2e-3)


FORCE_N = 0.02
NEAR = changed(KNOWN, gap_m=0.1e-3)


@cache
def crossed() -> np.ndarray:
    """A frame 0.1 mm beside the axis of a needle that crosses it, at 20 mN."""
    section = wall_section(tip_of(FORCE_N), gap_m=NEAR.needle.gap_m)
    middle = int(np.abs(section.outer[:, 0] - 0.3e-3).argmin())
    leaning = replace(STEEL, angle_rad=0.3, above_m=0.5e-3)
    shaft = draw_shaft(leaning, section.outer[middle], 0.0, STUDY.oct)
    rng = np.random.default_rng(1)
    optics = sample_optics(CLEAN, STUDY.oct, rng)
    return render_bscan(section, STUDY.oct, optics, rng, shaft).frame


@pytest.mark.parametrize("default", ["fit", "network"])
def test_the_fit_reads_the_wall_beside_a_needle_alone(default):
    reader = force_reader(default=default)
    found = reader.read(crossed(), SCALE, NEAR)
    assert found.usable, found.reason
    assert found.needle.angle_rad == pytest.approx(0.3, abs=0.05)
    lean = found.places.lean_rad
    assert lean.value == pytest.approx(0.3, abs=0.05)
    assert lean.low < 0.3 < lean.high
    assert found.force_n == pytest.approx(FORCE_N, rel=0.05)
    assert [name for name, _ in found.readings] == ["fit"]
    assert [one.code for one in found.remarks] == ["fit-unchecked"]
    assert not reader.network.shown


def test_a_needle_in_the_picture_says_that_the_gap_is_small():
    unknown = answer(crossed(), changed(NEAR, gap_m=None))
    assert unknown.usable, unknown.reason
    assert unknown.interval_n[0] < FORCE_N < unknown.interval_n[1]
    # the needle's radius; trained was 0.3 to 1 mm
    assert unknown.fit.unknown[GAP] < 0.35e-3

    without = answer(frame_under(FORCE_N))
    assert without.needle is None
    assert [name for name, _ in without.readings] == ["network", "fit"]


def test_a_frame_with_a_needle_is_withdrawn_from_in_the_loop_and_far_from_the_stated_plane():
    # the network was trained on such gaps
    known = changed(NEAR, gap_m=0.32e-3)
    live = force_reader(FIVE_MN).read_live(crossed(), SCALE, known)
    assert "a needle hides a part of the wall" in withdrawn(live)
    assert np.isnan(live.segmentation.outer_row[slice(*live.needle.hidden)]).all()
    near = force_reader(FIVE_MN).read_live(crossed(), SCALE, NEAR)
    assert "gap between B-scan and needle axis 0.1 mm" in withdrawn(near)
    far = answer(crossed(), changed(NEAR, gap_m=0.8e-3))
    words = "a needle is seen, although the B-scan is said to pass 0.8 mm from its axis"
    assert withdrawn(far).startswith(words)
    assert far.needle is not None


def test_a_classifier_withdraws_from_a_needle_in_the_picture(write_model, tmp_path):
    model = load_reader(write_model(tmp_path / "model", STUDY).path)
    for read in (model.read, model.read_live):
        found = read(crossed(), SCALE, NEAR)
        assert "a needle hides a part of the wall" in withdrawn(found)
        assert found.needle is not None
    assert model.read(frame_under(FORCE_N), SCALE, KNOWN).usable


@pytest.fixture
def stretch(monkeypatch):
    """Return by how much one factor of 1.5 stretches the fit's interval."""

    def stretched(
        name: str, frame: np.ndarray, setup: Setup, wall: Segmentation | None = None
    ) -> float:
        widths_n = []
        for factor in (1.0, 1.5):
            monkeypatch.setattr(interval_widths, f"{name}_STRETCH", factor)
            found = force_reader().read(frame, SCALE, setup, wall)
            widths_n.append(dict(found.readings)["fit"].width_n)
        return widths_n[1] / widths_n[0]

    return stretched


def test_the_fit_s_interval_is_wider_beside_a_needle_and_under_a_conjunctiva(stretch):
    assert stretch("NEEDLE", crossed(), NEAR) == pytest.approx(1.5)
    frame = frame_under(FORCE_N)
    wall = find_wall(frame, SCALE)
    covered = replace(wall, conjunctiva_m=1e-4)
    assert stretch("CONJUNCTIVA", frame, KNOWN, covered) == pytest.approx(1.5)
    assert stretch("CONJUNCTIVA", frame, KNOWN, wall) == 1.0
    # so near it is there, seen or not
    gaps = [
        stretch("NEEDLE", frame, changed(KNOWN, gap_m=m)) for m in (1e-4, 4e-4, None)
    ]
    assert gaps == pytest.approx([1.5, 1.0, 1.0])


STIFFENED = made_up_library()


def test_an_eye_is_read_with_walls_of_its_tissue_at_its_contact():
    reader = ForceReader(Path("model"), STUDY, FixedNetwork(FIVE_MN), STIFFENED, "fit")
    eye = changed(Setup(), stiffening=5.0, polar_rad=0.4)
    found = reader.library_for(eye)
    assert (found.contact_polar_rad, found.stiffening) == (0.4, 5.0)
    assert reader.library_for(changed(eye, iop_pa=300.0)) is found
    middle = reader.library_for(changed(eye, polar_rad=None))
    assert middle.contact_polar_rad == STIFFENED.contact_polar_rad
    farthest = reader.library_for(changed(eye, polar_rad=0.5 * np.pi))
    assert farthest.contact_polar_rad == STIFFENED.polar_rad[-1]

    stiff = changed(eye, stiffening=40.0)
    with pytest.raises(InputError, match="stiffening: 40 is outside the library's"):
        reader.library_for(stiff)
    reason = "stiffening 40 of the tissue, the model was trained on 0 to 30"
    assert reader.refusal(stiff) == reason
    assert reader.refusal(changed(Setup(), stiffening=30.0)) is None
