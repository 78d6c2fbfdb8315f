"""Answers of a force reader to raw frames: walls of known force, other surfaces, frames with a needle."""

import json
from dataclasses import replace
from math import nan
from pathlib import Path

import cv2
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
)  # fmt: skip
from analytic_library import made_up_library
from small_models import FIVE_MN, FixedNetwork, force_reader
from tifffile import TiffFile

from scleraforce.errors import InputError
from scleraforce.known import Known, Modulus
from scleraforce.laboratory.bscan import draw_shaft, render_bscan
from scleraforce.laboratory.light import sample_optics
from scleraforce.library.unknowns import GAP
from scleraforce.mechanics.contact import Section
from scleraforce.reader import intervals, load_model
from scleraforce.reader.answer import Answer, Reading
from scleraforce.reader.kinds import SHIFTS, ForceReader, TrainedModel
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.slice import boundary_slice
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import Range


def answer(frame: np.ndarray, known: Known | None = KNOWN, model: ForceReader | None = None) -> Answer:
    return (model or force_reader()).read(frame, SCALE, known or Known())


def plate(depth_m: float, thickness_m: float = 0.6e-3, slope: float = 0.0) -> Section:
    lateral = np.linspace(-9e-3, 9e-3, 300)
    outer = np.stack([lateral, depth_m + slope * lateral], axis=1)
    return Section(outer, outer + np.array([0.0, thickness_m]))


def ball(radius_m: float) -> Section:
    """A shell that is no eye's: of another radius."""
    angle = np.linspace(-1, 1, 400) * min(1.5, 9e-3 / radius_m)
    centre = np.array([0.0, 0.4e-3 + radius_m])
    around = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    return Section(centre + radius_m * around, centre + (radius_m - 0.6e-3) * around)


@pytest.mark.parametrize("force_n", [0.003, 0.015, 0.035])
def test_a_frame_of_known_force_is_read_with_force_interval_and_contact(force_n: float) -> None:
    agreeing = Reading(probabilities=(0.3, 0.3, 0.4), force_n=force_n, interval_n=(0.0, 0.06), contact_m=0.3e-3)
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
    by_fit, by_network = (answer(frame, model=force_reader(default=name)) for name in ("fit", "network"))
    assert (by_network.force_n, by_network.predicted) == (0.005, 1)
    assert by_fit.force_n == pytest.approx(0.015, abs=1e-3)
    of_fit = dict(by_fit.readings)["fit"].interval_n
    assert of_fit[0] > 0.006
    assert by_fit.interval_n == by_network.interval_n == (0.004, of_fit[1])  # one is wrong, and nobody says which
    for found in (by_fit, by_network):
        assert dict(found.readings)["network"] == FIVE_MN
        assert len(found.warnings) == 1
        assert "more apart than their intervals allow" in found.warnings[0]
        assert found.usable

    agreeing = Reading(probabilities=(0.0, 1.0, 0.0), force_n=0.0152, interval_n=(0.014, 0.0165), contact_m=0.0)
    agreed = answer(frame, model=force_reader(agreeing))
    assert agreed.warnings == ()
    assert agreed.interval_n == dict(agreed.readings)["fit"].interval_n


@pytest.mark.parametrize("lateral_m", [-2.5e-3, 1.6e-3])
def test_a_contact_outside_the_training_is_withdrawn_from(lateral_m: float) -> None:
    found = answer(image(wall_section(tip_of(0.015), lateral_m=lateral_m)))
    assert (found.usable, found.predicted, found.force_n) == (False, 2, None)
    place = f"contact {lateral_m * 1e3:.1f} mm from the frame's middle"
    assert found.reason == f"{place}, the model was trained on -1 to 1 mm"


@pytest.mark.parametrize("default", ["fit", "network"])
def test_a_contact_counts_as_outside_whichever_method_sees_it_there(default: str) -> None:
    frame = image(wall_section(tip_of(0.015)))
    far = force_reader(replace(FIVE_MN, contact_m=1.3e-3), default)
    assert answer(frame, model=far).reason.startswith("contact 1.3 mm from the frame's middle")
    near = force_reader(replace(FIVE_MN, contact_m=1.2e-3), default)  # the network is as unsure as that
    assert answer(frame, model=near).usable


@pytest.mark.parametrize("lateral_m", [-1e-3, 1e-3])
@pytest.mark.parametrize("force_n", [0.0005, 0.003, 0.02])
def test_a_contact_at_the_edge_of_the_training_is_read(lateral_m: float, force_n: float) -> None:
    assert answer(image(wall_section(tip_of(force_n), lateral_m=lateral_m))).usable


def test_the_network_is_shown_shifted_slices_and_what_is_known() -> None:
    model = force_reader()
    frame = image(wall_section(tip_of(0.02)))
    answer(frame, KNOWN, model)
    ((cuts, known),) = model._network.shown
    assert known == KNOWN
    seen = find_wall(frame, SCALE)
    np.testing.assert_array_equal(cuts[0], boundary_slice(seen, SCALE, STUDY.slice))
    for cut, shift in zip(cuts, SHIFTS, strict=True):
        up = -shift * STUDY.slice.pixel_m / SCALE.depth_m  # a window that starts lower shows the wall higher
        moved = replace(seen, outer_row=seen.outer_row + up, inner_row=seen.inner_row + up)
        np.testing.assert_array_equal(cut, boundary_slice(moved, SCALE, STUDY.slice))
    assert len({cut.tobytes() for cut in cuts}) == len(SHIFTS)


@pytest.mark.parametrize(
    "changed",
    [
        {"modulus": Modulus(mean_pa=0.9e6, sd_pa=1e3, source="own")},
        {"iop_pa": 3000.0},
        {"thickness_m": 1.1e-3},
        {"gap_m": 1.5e-3},
        {"iop_pa": nan},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_an_eye_outside_the_training_is_withdrawn_from_although_one_could_calibrate_on_it(changed) -> None:
    found = answer(image(wall_section(tip_of(0.002))), replace(KNOWN, **changed))
    assert (found.usable, found.predicted, found.probabilities, found.force_n) == (False, 2, None, None)
    assert "the model was trained on" in found.reason
    assert found.can_calibrate


def noise(rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 4096, (512, 512)).astype(np.uint16)


def gradient(rng: np.random.Generator) -> np.ndarray:
    rows = np.linspace(0.0, 4000.0, 512)[:, None] + rng.normal(0.0, 100.0, (512, 512))
    return rows.clip(0, 4095).astype(np.uint16)


NO_EYES = {
    "blank": np.full((512, 512), 700, dtype=np.uint16),
    "black": np.zeros((512, 512), dtype=np.uint16),
    "noise": noise(np.random.default_rng(0)),
    "gradient": gradient(np.random.default_rng(0)),
    "plate": image(plate(1.2e-3)),
    "tilted plate": image(plate(1.2e-3, 0.8e-3, slope=0.08)),
    "coverslip": image(plate(0.8e-3, 0.15e-3)),
    "double layer": np.maximum(image(plate(0.9e-3, 0.3e-3), 2), image(plate(1.8e-3, 0.5e-3), 3)),
    "large ball": image(ball(40e-3)),
    "upside down": image(wall_section(tip_of(0.002)))[::-1].copy(),
}


@pytest.mark.parametrize("name", NO_EYES)
@pytest.mark.parametrize("known", [KNOWN, pytest.param(None, marks=pytest.mark.slow)], ids=["known", "unknown"])
def test_what_is_no_sclera_is_never_read_as_harmless(name: str, known: Known | None) -> None:
    found = answer(NO_EYES[name], known)
    assert (found.usable, found.predicted) == (False, 2)
    assert found.reason
    assert not found.can_calibrate or "not the wall" not in found.reason


@pytest.mark.parametrize("radius_m", [4e-3, 5e-3, 7e-3, 20e-3])
def test_a_shell_of_another_radius_is_never_read_as_harmless(radius_m: float) -> None:
    assert answer(image(ball(radius_m))).predicted == 2


@pytest.mark.parametrize("stated_m", [0.85e-3, 0.4e-3 - 60e-6])
def test_a_wall_that_is_not_as_thick_as_stated_is_withdrawn_from(stated_m: float) -> None:
    model = force_reader()
    model.study = replace(STUDY, reader=replace(STUDY.reader, thickness_m=Range(min=0.3e-3, max=0.9e-3)))
    found = answer(image(wall_section(tip_of(0.01))), replace(KNOWN, thickness_m=stated_m), model)
    assert (found.usable, found.predicted) == (False, 2)
    assert "thick" in found.reason or "not the wall of an eye" in found.reason


def test_a_frame_that_shows_a_few_millimetres_of_wall_is_withdrawn_from() -> None:
    section = wall_section(tip_of(0.01))
    close = PixelScale(lateral_m=5e-3 / 512, depth_m=SCALE.depth_m)
    frame = image(section, scanner=replace(STUDY.oct, width_m=5e-3))
    found = force_reader().read(frame, close, KNOWN)
    assert (found.usable, found.predicted) == (False, 2)
    assert "of the wall" in found.reason


REAL = Path(__file__).parents[3] / "shared" / "real-oct"


OUTSIDE = {"DIVF_endo_metric_20_Slice28.tif", "DSLong4_Slice29.tif", "DSWSlipLongNaN_Slice195.tif",
           "DS_Coverslip_Slice44.tif", "035.jpeg"}  # fmt: skip


def reasons_of(name: str, known: Known | None) -> tuple[str, ...]:
    if name in OUTSIDE:
        return ("the wall lies outside the window",)
    if name == "107.jpg" and known is None:  # a wall with a limbus lies near enough, but no frame has its dent there
        return ("contact -3",)
    if name == "011.jpeg" and known is None:  # of two fits that are nearly as good, the processor's rounding chooses
        return "not the wall of an eye", "the fit reads 148.8 mN, the network 5.0 mN"
    return ("not the wall of an eye",)


def real_scans() -> list[Path]:
    """Of tissue and of eyes, without the masks beside them."""
    if not REAL.exists():
        return []
    files = [path for folder in ("tissue-surface", "anterior-segment") for path in sorted((REAL / folder).iterdir())]
    return [path for path in files if "mask" not in path.name]


def grey(path: Path) -> np.ndarray:
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.ndim == 3 else pixels


def true_scale(path: Path) -> PixelScale:
    """Of a TIFF what its tag says; of a JPEG the 5 um of the folder's README."""
    if path.suffix != ".tif":
        return PixelScale(lateral_m=5e-6, depth_m=5e-6)
    with TiffFile(path) as file:
        axes = json.loads(file.pages[0].tags["Software"].value)["metadata"]
    steps_mm = [np.ptp(axes[name]["values"]) / (len(axes[name]["values"]) - 1) for name in ("x", "z")]
    assert {axes[name]["units"] for name in ("x", "z")} == {"mm"}
    lateral_m, depth_m = (1e-3 * step for step in steps_mm)
    return PixelScale(lateral_m=lateral_m, depth_m=depth_m)


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no real images here")
def test_the_real_scans_are_there() -> None:
    assert len(real_scans()) == 25


@pytest.mark.real
@pytest.mark.parametrize("path", real_scans(), ids=lambda path: path.name)
@pytest.mark.parametrize("known", [KNOWN, None], ids=["known", "unknown"])
def test_a_real_scan_at_its_true_scale_shows_too_little_of_a_wall(path: Path, known: Known | None) -> None:
    found = force_reader().read(grey(path), true_scale(path), known or Known())
    assert (found.usable, found.predicted, found.force_n) == (False, 2, None)
    assert "mm of the wall are seen, not 9.8 mm" in found.reason


def told_or_not() -> list[object]:
    """Of every fifth scan what is known of the eye, by default; the others, and scans of unknown eyes, are slow."""
    return [
        pytest.param(path, known, id=f"{'known' if known else 'unknown'}-{path.name}", marks=[pytest.mark.slow] * slow)
        for known in (KNOWN, None)
        for number, path in enumerate(real_scans())
        for slow in [known is None or number % 5 > 0]
    ]


@pytest.mark.real
@pytest.mark.parametrize(("path", "known"), told_or_not())
def test_a_real_scan_taken_for_one_as_wide_as_the_product_s_is_no_wall_of_an_eye(
    path: Path, known: Known | None
) -> None:
    pixels = grey(path)
    pixel_m = STUDY.oct.width_m / pixels.shape[1]  # wide enough, so that the other rules have to refuse it
    found = force_reader().read(pixels, PixelScale(lateral_m=pixel_m, depth_m=pixel_m), known or Known())
    assert (found.usable, found.predicted, found.force_n) == (False, 2, None)
    assert found.reason.startswith(reasons_of(path.name, known))


@pytest.mark.parametrize("field", ["force_n", "probabilities", "interval_n"])
def test_a_reading_that_is_no_number_never_passes(field: str) -> None:
    broken = {"force_n": nan, "probabilities": (nan, nan, nan), "interval_n": (nan, 0.006)}
    model = force_reader(replace(FIVE_MN, **{field: broken[field]}), "network")
    found = answer(image(wall_section(tip_of(0.015))), model=model)
    assert (found.usable, found.predicted, found.probabilities, found.force_n) == (False, 2, None, None)
    assert "not a number" in found.reason


def test_two_methods_so_far_apart_that_no_class_is_left_are_no_answer() -> None:
    """The network reads 5 mN, from 4 on; the fit 20 and 35 mN. Alone neither interval reaches into every class."""
    below, above = (answer(image(wall_section(tip_of(force_n)))) for force_n in (0.020, 0.035))
    assert below.usable
    assert below.interval_n[0] == 0.004
    assert (above.usable, above.predicted, above.interval_n) == (False, 2, None)
    assert above.reason.startswith("the fit reads 3")
    assert "the network 5.0 mN: more apart than their intervals allow; from 4 to 3" in above.reason
    assert above.reason.endswith(" mN, every class is possible")
    unsure = Reading(probabilities=(0.2, 0.5, 0.3), force_n=0.02, interval_n=(0.0, 0.06), contact_m=0.3e-3)
    agreed = answer(image(wall_section(tip_of(0.020))), model=force_reader(unsure, default="network"))
    assert agreed.usable  # both agree: then a wide interval is an answer
    assert agreed.interval_n == (0.0, 0.06)


def test_a_check_that_is_no_number_is_a_warning() -> None:
    found = answer(image(wall_section(tip_of(0.015))), model=force_reader(replace(FIVE_MN, force_n=nan)))
    assert found.usable
    assert "not a number" in found.warnings[0]


def test_a_dent_that_leaves_the_window_is_read_where_its_flanks_tell_enough() -> None:
    tip_m, softness = 4.2e-3, 2.0  # of an eye half as stiff, under half the IOP: the same shape at half the force
    frame = image(wall_section(tip_m, surface_m=0.4e-3))
    wall = (np.array([THICKNESS_M]), np.array([IOP_PA / MODULUS_PA]), np.array([tip_m]))
    force_n = float(LIBRARY.forces(*wall)[0]) * MODULUS_PA / softness
    modulus_pa = MODULUS_PA / softness
    soft = replace(
        KNOWN, modulus=Modulus(mean_pa=modulus_pa, sd_pa=0.01 * modulus_pa, source="own"), iop_pa=IOP_PA / softness
    )
    agreeing = Reading(
        probabilities=(0.0, 0.5, 0.5), force_n=force_n, interval_n=(0.9 * force_n, 1.1 * force_n), contact_m=0.3e-3
    )
    read = answer(frame, soft, force_reader(agreeing))
    assert read.usable
    assert read.interval_n[1] - read.interval_n[0] < 6e-3
    assert read.interval_n[0] < force_n < read.interval_n[1]
    assert not read.can_calibrate
    # Where E is not known, or the network reads 5 mN, nothing is as sure as that.
    for open_ended in (answer(frame, replace(soft, modulus=None), force_reader(agreeing)), answer(frame, soft)):
        assert (open_ended.usable, open_ended.predicted) == (False, 2)
        assert "leaves the window" in open_ended.reason
    # Within the window nothing keeps a wide interval from being told.
    wide = answer(image(wall_section(tip_of(0.02))), replace(KNOWN, modulus=None), force_reader(agreeing))
    assert wide.usable
    assert wide.interval_n[1] > 0.03


def test_more_is_known_where_more_is_told() -> None:
    frame = image(wall_section(tip_of(0.02)))
    widths = []
    for known in (KNOWN, replace(KNOWN, modulus=replace(KNOWN.modulus, sd_pa=0.12 * MODULUS_PA)), None):
        low, high = dict(answer(frame, known).readings)["fit"].interval_n
        widths.append(high - low)
    assert widths == sorted(widths)
    assert widths[1] > 2 * widths[0]


def test_a_dent_farther_from_the_pole_is_that_of_a_larger_force() -> None:
    frame = image(wall_section(tip_of(0.02)))
    middle = answer(frame)
    wall = (np.array([THICKNESS_M]), np.array([IOP_PA / MODULUS_PA]), np.array([middle.fit.tip_m]))
    for polar_rad in (0.0, 0.8):
        expected = LIBRARY.for_contact(polar_rad).forces(*wall)[0] / LIBRARY.forces(*wall)[0]
        found = answer(frame, replace(KNOWN, polar_rad=polar_rad))
        assert found.force_n / middle.force_n == pytest.approx(expected, rel=2e-3)
    assert answer(frame, replace(KNOWN, polar_rad=1.5)).force_n == answer(frame, replace(KNOWN, polar_rad=99.0)).force_n


FORCE_N = 0.02
SHAFT = replace(STEEL, angle_rad=0.3, above_m=0.5e-3)
NEAR = replace(KNOWN, gap_m=0.1e-3)


@pytest.fixture(scope="module")
def crossed(monkeypatch_module: pytest.MonkeyPatch) -> np.ndarray:
    """A frame 0.1 mm beside the axis of a needle that crosses it, at 20 mN."""
    monkeypatch_module.setattr("analytic_frames.GAP_M", NEAR.gap_m)
    section = wall_section(tip_of(FORCE_N))
    middle = int(np.abs(section.outer[:, 0] - 0.3e-3).argmin())
    shaft = draw_shaft(SHAFT, section.outer[middle], 0.0, STUDY.oct)
    rng = np.random.default_rng(1)
    return render_bscan(section, STUDY.oct, sample_optics(CLEAN, STUDY.oct, rng), rng, shaft).frame


@pytest.fixture(scope="module")
def monkeypatch_module() -> "pytest.MonkeyPatch":
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.mark.parametrize("default", ["fit", "network"])
def test_the_fit_reads_the_wall_beside_a_needle_alone(crossed: np.ndarray, default: str) -> None:
    reader = force_reader(default=default)
    answer = reader.read(crossed, SCALE, NEAR)
    assert answer.usable, answer.reason
    assert answer.needle is not None
    assert answer.needle.angle_rad == pytest.approx(0.3, abs=0.05)
    assert answer.force_n == pytest.approx(FORCE_N, rel=0.05)
    assert [name for name, _ in answer.readings] == ["fit"]
    assert "the fit alone reads it" in answer.warnings[0]
    assert not reader._network.shown


def test_in_the_loop_a_frame_with_a_needle_is_not_usable_and_says_why(crossed: np.ndarray) -> None:
    known = replace(NEAR, gap_m=0.32e-3)  # the network was trained on such gaps
    live = force_reader(FIVE_MN).read_live(crossed, SCALE, known)
    assert not live.usable
    assert "a needle hides a part of the wall" in live.reason
    assert live.needle is not None
    assert np.isnan(live.segmentation.outer_row[slice(*live.needle.hidden)]).all()
    near = force_reader(FIVE_MN).read_live(crossed, SCALE, NEAR)
    assert near.reason == "gap between B-scan and needle axis 0.1 mm, the model was trained on 0.3 to 1 mm"


def test_a_needle_far_from_where_the_plane_is_said_to_be_is_not_read(crossed: np.ndarray) -> None:
    answer = force_reader().read(crossed, SCALE, replace(NEAR, gap_m=0.8e-3))
    assert not answer.usable
    assert answer.reason.startswith("a needle is seen, although the B-scan is said to pass 0.8 mm from its axis")
    assert answer.needle is not None


def test_a_classifier_withdraws_from_a_needle_in_the_picture(crossed: np.ndarray, write_model, tmp_path: Path) -> None:
    model = load_model(write_model(tmp_path / "model", STUDY).path)
    for answer in (model.read(crossed, SCALE, NEAR), model.read_live(crossed, SCALE, NEAR)):
        assert (answer.usable, answer.predicted) == (False, 2)
        assert "a needle hides a part of the wall" in answer.reason
        assert answer.needle is not None
    assert model.read(image(wall_section(tip_of(FORCE_N))), SCALE, KNOWN).usable


def test_a_gap_that_is_not_told_is_taken_from_the_needle_that_is_seen(crossed: np.ndarray) -> None:
    answer = force_reader().read(crossed, SCALE, replace(NEAR, gap_m=None))
    assert answer.usable, answer.reason
    low_n, high_n = answer.interval_n
    assert low_n < FORCE_N < high_n
    assert answer.fit.unknown[GAP] < 0.35e-3  # the needle's radius; trained was 0.3 to 1 mm


def test_a_frame_without_a_needle_is_read_by_both_methods_as_before() -> None:
    answer = force_reader().read(image(wall_section(tip_of(FORCE_N))), SCALE, replace(KNOWN, gap_m=GAP_M))
    assert answer.needle is None
    assert [name for name, _ in answer.readings] == ["network", "fit"]


def test_the_fits_interval_is_as_much_wider_as_was_measured_beside_a_needle_or_under_a_conjunctiva(
    crossed: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    widths = []
    for stretch in (1.0, 1.5):
        monkeypatch.setattr(intervals, "NEEDLE_STRETCH", stretch)
        widths.append(dict(force_reader().read(crossed, SCALE, NEAR).readings)["fit"].width_n)
    assert widths[1] == pytest.approx(1.5 * widths[0])
    wall = find_wall(crossed, SCALE)
    trained = STUDY.reader
    both = intervals.frame_stretch(replace(wall, conjunctiva_m=1e-4), NEAR, trained)
    assert both == pytest.approx(1.5 * intervals.CONJUNCTIVA_STRETCH)
    unseen = replace(wall, needle=None)
    assert intervals.frame_stretch(unseen, NEAR, trained) == 1.5  # as near, it is there all the same
    for far in (replace(NEAR, gap_m=0.4e-3), replace(NEAR, gap_m=None)):
        assert intervals.frame_stretch(unseen, far, trained) == 1.0


STIFFENED = made_up_library()


@pytest.fixture
def reader() -> ForceReader:
    return ForceReader(TrainedModel(Path("model"), STUDY), FixedNetwork(FIVE_MN), STIFFENED, "fit")


def test_an_eye_is_read_with_walls_of_its_tissue_at_its_contact(reader: ForceReader) -> None:
    found = reader.library_for(Known(polar_rad=0.4, stiffening=5.0))
    assert (found.contact_polar_rad, found.stiffening) == (0.4, 5.0)
    assert (found.force_ratio_tpd == STIFFENED.for_stiffening(5.0).force_ratio_tpd).all()
    assert reader.library_for(Known(polar_rad=0.4, stiffening=5.0, iop_pa=300.0)) is found
    assert reader.library_for(Known(polar_rad=0.4)).stiffening == 0.0
    assert reader.library_for(Known(stiffening=5.0)).contact_polar_rad == STIFFENED.contact_polar_rad
    assert reader.library_for(Known(polar_rad=2.0, stiffening=5.0)).contact_polar_rad == STIFFENED.polar_rad[-1]


def test_an_eye_of_other_tissue_than_the_library_s_is_refused_and_the_refusal_says_so(reader: ForceReader) -> None:
    stiff = Known(stiffening=40.0)
    with pytest.raises(InputError, match="stiffening: 40 is outside the library's range, 0 to 30"):
        reader.library_for(stiff)
    assert reader.refusal(stiff) == "stiffening 40 of the tissue, the model was trained on 0 to 30"
    assert reader.refusal(Known(stiffening=30.0)) is None
