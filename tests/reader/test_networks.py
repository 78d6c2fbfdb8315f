"""Networks that read a force: their histograms, their known inputs, and their folders."""

import json
from dataclasses import replace
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np
import pytest
from analytic_library import analytic_library
from small_models import write_fixed_reader

from scleraforce.errors import ModelError
from scleraforce.known import OPEN, UNKNOWN, ForceDiscrepancy, Known, Modulus, known_globe
from scleraforce.library.base import pole_direction
from scleraforce.models import sha256
from scleraforce.reader import load_classifier, load_model
from scleraforce.reader.networks import (
    GIVEN,
    ForceDistribution,
    GivenEyes,
    force_distribution,
    given_eye,
    given_inputs,
    given_modulus,
    histogram_reading,
    quantile,
    ratio_edges,
    unknown_modulus,
)
from scleraforce.study import ReaderStudy
from scleraforce.units import to_si

EDGES_M2 = ratio_edges(20, 0.4e-6)
MODULUS_PA = np.array([0.2e6, 0.31e6, 0.5e6])
BOUNDS_N = (5e-3, 30e-3)


@pytest.fixture
def histograms() -> np.ndarray:
    return np.random.default_rng(5).dirichlet(np.full(20, 0.3), size=3)


def drawn_forces(histogram: np.ndarray, modulus_pa: float, count: int) -> np.ndarray:
    rng = np.random.default_rng(6)
    bins = rng.choice(len(histogram), size=count, p=histogram)
    return modulus_pa * rng.uniform(EDGES_M2[bins], EDGES_M2[bins + 1])


def class_probabilities(distribution: ForceDistribution, bounds_n: tuple[float, ...]) -> np.ndarray:
    """The probability of each class (sample, class), with arrays: the oracle of `histogram_reading`."""
    below = np.empty((len(distribution.share_sk), len(bounds_n) + 2))
    below[:, 0], below[:, -1] = 0.0, 1.0
    for row, edges, shares in zip(below, distribution.edge_n_sk, distribution.share_sk, strict=True):
        row[1:-1] = np.interp(bounds_n, edges, shares)
    probabilities: np.ndarray = below[:, 1:] - below[:, :-1]
    return probabilities


def test_quantiles_and_classes_are_those_of_forces_drawn_from_the_histogram(histograms) -> None:
    found = force_distribution(histograms, EDGES_M2, MODULUS_PA)
    classes = class_probabilities(found, BOUNDS_N)
    for sample, modulus_pa in enumerate(MODULUS_PA):
        forces_n = drawn_forces(histograms[sample], modulus_pa, 200_000)
        for share in (0.05, 0.3, 0.5, 0.95):
            assert abs((forces_n < quantile(found, share)[sample]).mean() - share) < 0.005
        counted = np.histogram(forces_n, [0.0, *BOUNDS_N, np.inf])[0] / len(forces_n)
        np.testing.assert_allclose(classes[sample], counted, atol=0.005)


def test_the_median_lies_in_the_class_that_has_more_than_half() -> None:
    many = np.random.default_rng(7).dirichlet(np.full(20, 0.2), size=500)
    found = force_distribution(many, EDGES_M2, np.full(500, 0.3e6))
    classes = class_probabilities(found, BOUNDS_N)
    np.testing.assert_allclose(classes.sum(axis=1), 1.0, atol=1e-12)
    clear = classes.max(axis=1) > 0.5 + 1e-9
    assert clear.sum() > 300
    np.testing.assert_array_equal(np.searchsorted(BOUNDS_N, found.median_n)[clear], classes.argmax(axis=1)[clear])


def test_the_interval_of_an_even_distribution_leaves_a_twentieth_on_either_side() -> None:
    even = force_distribution(np.diff(EDGES_M2)[None], EDGES_M2, np.array([0.25e6]))
    np.testing.assert_allclose(even.interval_n, [[5e-3, 95e-3]], rtol=1e-12)
    np.testing.assert_allclose(even.median_n, [50e-3], rtol=1e-12)
    np.testing.assert_allclose(class_probabilities(even, BOUNDS_N), [[0.05, 0.25, 0.7]], atol=1e-12)


@pytest.mark.parametrize("place", [0, 7, 19])
def test_a_sure_answer_stays_within_its_bin(place: int) -> None:
    sure = np.zeros((1, 20), dtype=np.float32)
    sure[0, place] = 1.0
    found = force_distribution(sure, EDGES_M2, np.array([0.25e6]))
    low, high = 0.25e6 * EDGES_M2[place : place + 2]
    np.testing.assert_allclose(found.interval_n, [[low + 0.05 * (high - low), low + 0.95 * (high - low)]], rtol=1e-9)


def test_a_bound_beyond_the_largest_force_leaves_its_class_empty() -> None:
    found = ForceDistribution(np.array([[0.0, 10e-3]]), np.array([[0.0, 1.0]]))
    np.testing.assert_allclose(class_probabilities(found, (5e-3, 30e-3)), [[0.5, 0.5, 0.0]], atol=1e-12)


@pytest.mark.parametrize("concentration", [0.02, 0.3, 5.0])
def test_a_single_frame_is_judged_as_many_are(concentration: float) -> None:
    rng = np.random.default_rng(8)
    histograms = rng.dirichlet(np.full(20, concentration), size=200) * rng.uniform(0.1, 3.0, (200, 1))
    moduli_pa = rng.uniform(0.2e6, 0.5e6, 200)
    many = force_distribution(histograms, EDGES_M2, moduli_pa)
    classes = class_probabilities(many, BOUNDS_N)
    for number, (histogram, modulus_pa) in enumerate(zip(histograms, moduli_pa, strict=True)):
        single = histogram_reading(histogram.tolist(), EDGES_M2.tolist(), modulus_pa, BOUNDS_N)
        np.testing.assert_allclose(single.force_n, many.median_n[number], rtol=1e-9)
        np.testing.assert_allclose(single.interval_n, many.interval_n[number], rtol=1e-9)
        np.testing.assert_allclose(single.probabilities, classes[number], atol=1e-12)


def test_a_single_frame_without_force_above_the_bounds_leaves_their_class_empty() -> None:
    single = histogram_reading([1.0], [0.0, 1e-8], 1e6, (5e-3, 30e-3))
    np.testing.assert_allclose(single.probabilities, [0.5, 0.5, 0.0], atol=1e-12)


@pytest.mark.parametrize("wrong", [nan, inf])
@pytest.mark.parametrize("place", [0, 7, 19])
def test_a_histogram_that_is_no_number_gives_no_number(wrong: float, place: int) -> None:
    histogram = [0.05] * 20
    histogram[place] = wrong
    single = histogram_reading(histogram, EDGES_M2.tolist(), 0.3e6, BOUNDS_N)
    assert not isfinite(single.force_n)
    assert not all(map(isfinite, single.probabilities))


def test_an_empty_histogram_gives_no_number() -> None:
    single = histogram_reading([0.0] * 20, EDGES_M2.tolist(), 0.3e6, BOUNDS_N)
    assert not any(map(isfinite, (single.force_n, *single.interval_n, single.probabilities[1])))


RANGES = ReaderStudy()
NOTHING, ZERO = np.array([np.nan]), np.array([0.0])
OPEN_GLOBE, NO_POLE, SOFT = (ZERO, ZERO), (NOTHING, NOTHING), ZERO
KNOWN = ("modulus", "iop", "thickness", "gap", "polar angle", "direction")


def column(values: np.ndarray, name: str) -> float:
    return float(values[0, GIVEN.index(name)])


def test_the_ends_of_a_range_are_minus_one_and_one() -> None:
    for end, wanted in ((0, -1.0), (1, 1.0)):
        e, p = RANGES.youngs_modulus_pa.bounds[end], RANGES.iop_pa.bounds[end]
        ranges = (
            RANGES.modulus_sd_fraction,
            RANGES.thickness_m,
            RANGES.gap_m,
            RANGES.polar_angle_rad,
        )
        sd, t, g, a = (values.bounds[end] for values in ranges)
        found = given_inputs(
            GivenEyes(*(np.array([value]) for value in (e, sd, p, t, g, 0.0, 0.0, a, 0.0, 0.0))), RANGES
        )
        for name in ("modulus", "log modulus sd", "log iop", "thickness", "gap", "polar angle"):
            assert abs(column(found, name) - wanted) < 1e-6, name
        assert all(column(found, f"{name} known") == 1.0 for name in KNOWN)


def test_the_iop_ratio_spans_its_range_at_opposite_ends_of_modulus_and_iop() -> None:
    (low_e, high_e), (low_p, high_p) = RANGES.youngs_modulus_pa.bounds, RANGES.iop_pa.bounds
    for e, p, wanted in ((high_e, low_p, -1.0), (low_e, high_p, 1.0)):
        told = GivenEyes(np.array([e]), np.array([0.02]), np.array([p]), NOTHING, NOTHING, *OPEN_GLOBE, *NO_POLE, SOFT)
        assert abs(column(given_inputs(told, RANGES), "log iop ratio") - wanted) < 1e-6


def test_of_what_is_unknown_flag_and_value_are_zero() -> None:
    found = given_inputs(GivenEyes(NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, *OPEN_GLOBE, *NO_POLE, SOFT), RANGES)
    assert found.dtype == np.float32
    for name in KNOWN:
        assert column(found, f"{name} known") == 0.0
    for name in ("modulus", "log iop", "log iop ratio", "thickness", "gap", "polar angle", "pole along", "pole across"):
        assert abs(column(found, name)) < 1e-6, name


def test_an_unknown_modulus_is_as_uncertain_as_the_range_is_wide() -> None:
    mean, sd = given_modulus(
        GivenEyes(NOTHING, NOTHING, NOTHING, NOTHING, NOTHING, *OPEN_GLOBE, *NO_POLE, SOFT), RANGES
    )
    drawn = RANGES.youngs_modulus_pa.sample(np.random.default_rng(0), 200_000)
    assert abs(drawn.mean() / mean[0] - 1.0) < 0.005
    assert abs(drawn.std() / drawn.mean() / sd[0] - 1.0) < 0.01


def test_the_rigidity_counts_from_an_open_globe_to_the_stiffest() -> None:
    for globe, (low, high) in (
        (OPEN, (-1.0, -1.0)),
        (UNKNOWN, (-0.949, 0.949)),
        (known_globe("sealed", to_si(0.03, "mmhg13_per_ul")), (-0.132, 0.132)),
    ):
        told = GivenEyes(*[NOTHING] * 5, *(np.array([end]) for end in globe.band), *NO_POLE, SOFT)
        found = given_inputs(told, RANGES)
        assert column(found, "rigidity low") == pytest.approx(low, abs=1e-3)
        assert column(found, "rigidity high") == pytest.approx(high, abs=1e-3)


def test_where_the_pole_lies_is_told_along_the_section_and_across_it() -> None:
    farthest = np.sin(RANGES.polar_angle_rad.bounds[1])
    nothing = [NOTHING] * 5
    for polar_rad, direction_rad in ((0.5, 0.0), (0.7, 1.1), (0.4, -2.5), (1.4, 0.3)):
        told = GivenEyes(*nothing, *OPEN_GLOBE, np.array([polar_rad]), np.array([direction_rad]), SOFT)
        found = given_inputs(told, RANGES)
        along, across = pole_direction(min(polar_rad, np.radians(55.0)), direction_rad)  # the library's farthest
        assert column(found, "pole along") == pytest.approx(along / farthest, abs=1e-6)
        assert column(found, "pole across") == pytest.approx(across / farthest, abs=1e-6)


def test_a_direction_without_a_polar_angle_is_that_of_a_contact_in_the_middle_of_the_range() -> None:
    nothing, direction = [NOTHING] * 5, np.array([0.8])
    middle = np.array([0.5 * sum(RANGES.polar_angle_rad.bounds)])
    alone, both = (
        given_inputs(GivenEyes(*nothing, *OPEN_GLOBE, polar, direction, SOFT), RANGES) for polar in (NOTHING, middle)
    )
    for name in ("pole along", "pole across", "polar angle"):
        assert column(alone, name) == pytest.approx(column(both, name), abs=1e-6)
    assert (column(alone, "polar angle known"), column(both, "polar angle known")) == (0.0, 1.0)
    turned = given_inputs(GivenEyes(*nothing, *OPEN_GLOBE, middle, NOTHING, SOFT), RANGES)
    assert (column(turned, "pole along"), column(turned, "pole across")) == (0.0, 0.0)


@pytest.mark.parametrize(("stiffening", "wanted"), [(0.0, 0.0), (30.0, 1.0), (np.sqrt(31.0) - 1.0, 0.5)])
def test_tissue_that_does_not_stiffen_is_0_and_that_of_30_is_1_even_in_the_logarithm(stiffening, wanted) -> None:
    found = given_inputs(GivenEyes(*[NOTHING] * 5, *OPEN_GLOBE, *NO_POLE, np.array([stiffening])), RANGES)
    assert column(found, "stiffening") == pytest.approx(wanted, abs=1e-6)


pytest.importorskip("torch")

SHARES = (0.0, 0.0, 0.25, 0.5, 0.25, 0.0, 0.0, 0.0)
CUTS = np.zeros((4, 40, 140), dtype=np.uint8)
LIBRARY = analytic_library(thicknesses=4, ratios=4, tips=6)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_fixed_reader(tmp_path / "model", LIBRARY, SHARES, contact_m=0.4e-3)
    return tmp_path / "model"


def rewrite(folder: Path, name: str, content: bytes) -> None:
    """Replace a file and its hash."""
    (folder / name).write_bytes(content)
    record = json.loads((folder / "model.json").read_text())
    record["files"][name] = sha256(content)
    (folder / "model.json").write_text(json.dumps(record))


def test_force_and_interval_scale_with_the_modulus_that_it_is_told(folder: Path) -> None:
    reader = load_model(folder)
    edges = ratio_edges(len(SHARES), reader.study.reader.max_force_ratio)
    for modulus_pa in (0.2e6, 0.5e6):
        read = reader.read_slices(CUTS, Known(modulus=Modulus(mean_pa=modulus_pa, sd_pa=5e3, source="own")))
        # A quarter lies below edge 3, half in bin 3, a quarter above edge 4.
        assert read.force_n == pytest.approx(modulus_pa * (edges[3] + edges[4]) / 2, rel=1e-5)
        ends = edges[2] + 0.2 * (edges[3] - edges[2]), edges[5] - 0.2 * (edges[5] - edges[4])
        np.testing.assert_allclose(read.interval_n, modulus_pa * np.array(ends), rtol=1e-5)
        assert read.contact_m == pytest.approx(0.4e-3)
        assert sum(read.probabilities) == pytest.approx(1.0)


def test_what_a_calibration_found_of_the_forces_moves_the_reading_and_its_interval(folder: Path) -> None:
    known = Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"))
    stiffer = ForceDiscrepancy(level=0.05, growth=0.4, level_sd=0.01, growth_sd=0.02, correlation=0.0)
    reader = load_model(folder)
    was, now = (reader.read_slices(CUTS, replace(known, discrepancy=found)) for found in (None, stiffer))
    # The quantiles move as forces do, but for the bins between whose ends they lie.
    np.testing.assert_allclose(now.interval_n, stiffer.corrected_n(np.array(was.interval_n)), rtol=0.02)
    assert now.force_n == pytest.approx(float(stiffer.corrected_n(np.array(was.force_n))), rel=0.02)
    assert now.force_n != pytest.approx(was.force_n, rel=0.02)


def test_the_reading_of_several_slices_is_that_of_the_mean_of_their_histograms(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    histograms = np.array([[0, 1, 0, 0, 0, 0, 0, 0], [0, 0, 0.5, 0, 0.5, 0, 0, 0]], dtype=np.float32)
    fed: list[dict[str, np.ndarray]] = []

    class Session:
        def run(self, _: object, inputs: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
            fed.append(inputs)
            return histograms, np.array([0.1e-3, 0.4e-3], dtype=np.float32)

    reader = load_model(folder)
    edges = ratio_edges(len(SHARES), reader.study.reader.max_force_ratio)
    monkeypatch.setattr(reader._network, "_session", Session())
    read = reader.read_slices(CUTS[:2], Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"), iop_pa=250.0))
    assert read.force_n == pytest.approx(0.3e6 * edges[2], rel=1e-5)  # half of the mean lies below
    assert read.contact_m == pytest.approx(0.25e-3)
    (inputs,) = fed
    assert inputs["slices"].shape == (2, 40, 140)
    np.testing.assert_array_equal(inputs["given"][0], inputs["given"][1])


def test_the_factor_of_its_group_stretches_what_the_network_reads(folder: Path) -> None:
    known = Known(modulus=Modulus(mean_pa=0.3e6, sd_pa=5e3, source="own"))
    was = load_model(folder).read_slices(CUTS, known)
    record = json.loads((folder / "model.json").read_text())
    record["intervals"] = {"network": {"own E": {"unknown": 1.5}, "other E": {"unknown": 9.0}}}
    (folder / "model.json").write_text(json.dumps(record))
    now = load_model(folder).read_slices(CUTS, known)
    assert now.force_n == was.force_n
    assert now.interval_n[1] - now.force_n == pytest.approx(1.5 * (was.interval_n[1] - was.force_n))


def test_an_unknown_modulus_is_the_middle_of_the_training(folder: Path) -> None:
    reader = load_model(folder)
    mean_pa, _ = unknown_modulus(reader.study.reader)
    assert (
        reader.read_slices(CUTS, Known()).force_n
        == reader.read_slices(CUTS, Known(modulus=Modulus(mean_pa=mean_pa, sd_pa=1e3, source="own"))).force_n
    )


def test_what_is_not_known_is_told_as_not_known() -> None:
    told = given_eye(Known(iop_pa=250.0, gap_m=0.5e-3))
    assert np.isnan([told.modulus_pa[0], told.modulus_sd_fraction[0], told.thickness_m[0]]).all()
    assert (told.iop_pa[0], told.gap_m[0]) == (250.0, 0.5e-3)
    sure = given_eye(Known(modulus=Modulus(mean_pa=0.25e6, sd_pa=1.0, source="own")))
    assert sure.modulus_sd_fraction[0] == 0.01
    assert np.isnan([told.polar_rad[0], told.direction_rad[0]]).all()
    placed = given_eye(Known(polar_rad=0.6, direction_rad=-1.2))
    assert (placed.polar_rad[0], placed.direction_rad[0]) == (0.6, -1.2)


def test_the_folder_says_which_method_answers(folder: Path) -> None:
    reader = load_model(folder)
    assert (reader.default, reader.other, reader.kind) == ("fit", "network", "reader")
    record = json.loads((folder / "model.json").read_text())
    (folder / "model.json").write_text(json.dumps({**record, "default": "guess"}))
    with pytest.raises(ModelError, match="default: found 'guess'"):
        load_model(folder)


def test_a_library_that_was_changed_is_refused(folder: Path) -> None:
    content = bytearray((folder / "library.npz").read_bytes())
    content[len(content) // 2] ^= 1
    (folder / "library.npz").write_bytes(content)
    with pytest.raises(ModelError, match=r"library\.npz: SHA-256"):
        load_model(folder)


def test_a_library_that_is_none_is_refused_even_where_its_hash_agrees(folder: Path) -> None:
    rewrite(folder, "library.npz", b"nothing")
    with pytest.raises(ModelError, match=r"library\.npz: not a response library"):
        load_model(folder)


def test_a_network_for_another_histogram_is_refused(folder: Path) -> None:
    study = (folder / "study.toml").read_text().replace(f"bins = {len(SHARES)}\n", "bins = 16\n")
    rewrite(folder, "study.toml", study.encode())
    with pytest.raises(ModelError, match="outputs: found"):
        load_model(folder)


def test_a_reader_where_a_classifier_is_needed_is_refused(folder: Path) -> None:
    with pytest.raises(ModelError, match="found 'reader', a classifier is needed here"):
        load_classifier(folder)
