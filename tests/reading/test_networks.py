"""Networks that read a force: their histograms, their known inputs, and their
folders.
"""

import json
from dataclasses import fields, replace
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np
import pytest
from analytic_library import analytic_library
from small_models import write_fixed_reader

from scleraforce.base.errors import ModelError
from scleraforce.base.units import to_si
from scleraforce.library.moving_base import pole_directions
from scleraforce.reading import force_network
from scleraforce.reading.load_model import load_classifier, load_reader
from scleraforce.records.eye import Eye, ForceDiscrepancy, Modulus
from scleraforce.records.globe import OPEN, UNKNOWN, Globe
from scleraforce.records.model_folder import sha256
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy

EDGES_M2 = force_network.ratio_edges(20, 0.4e-6)
BOUNDS_N = (5e-3, 30e-3)


def test_the_classes_have_the_histogram_s_shares_below_their_bounds() -> None:
    rng = np.random.default_rng(8)
    for concentration in (0.02, 0.3, 5.0):
        for histogram in rng.dirichlet(np.full(20, concentration), size=60):
            found = force_network.histogram_reading(
                histogram.tolist(), EDGES_M2.tolist(), 0.3e6, BOUNDS_N
            )
            below = np.interp(BOUNDS_N, 0.3e6 * EDGES_M2, [0.0, *histogram.cumsum()])
            np.testing.assert_allclose(
                found.probabilities, np.diff([0.0, *below, 1.0]), atol=1e-12
            )

    single = force_network.histogram_reading([1.0], [0.0, 1e-8], 1e6, (5e-3, 30e-3))
    # no force above the last bound
    np.testing.assert_allclose(single.probabilities, [0.5, 0.5, 0.0], atol=1e-12)


def test_a_histogram_that_is_empty_or_not_finite_gives_a_reading_that_is_not_a_number():
    for place in (0, 7, 19):
        for wrong in (nan, inf):
            histogram = [0.05] * 20
            histogram[place] = wrong
            single = force_network.histogram_reading(
                histogram, EDGES_M2.tolist(), 0.3e6, BOUNDS_N
            )
            assert not isfinite(single.force_n)
            assert not all(map(isfinite, single.probabilities))

    single = force_network.histogram_reading(
        [0.0] * 20, EDGES_M2.tolist(), 0.3e6, BOUNDS_N
    )
    assert not any(
        map(isfinite, (single.force_n, *single.interval_n, single.probabilities[1]))
    )


RANGES = ReaderStudy()
KNOWN = ("modulus", "iop", "thickness", "gap", "polar angle", "direction")


def given(**values: float) -> dict[str, float]:
    """The network's input for an eye of some known values, in an open globe by default,
    by name.
    """
    eye = {field.name: np.array([nan]) for field in fields(force_network.GivenEyes)} | {
        name: np.array([0.0])
        for name in ("rigidity_low", "rigidity_high", "stiffening")
    }
    eyes = force_network.GivenEyes(
        **eye | {name: np.array([value]) for name, value in values.items()}
    )
    inputs = force_network.given_inputs(eyes, RANGES)
    assert inputs.dtype == np.float32

    return dict(zip(force_network.GIVEN, inputs[0].tolist(), strict=True))


def test_the_ends_of_a_range_are_minus_one_and_one() -> None:
    ranges = {
        "modulus_pa": RANGES.youngs_modulus_pa,
        "modulus_sd_fraction": RANGES.modulus_sd_fraction,
        "iop_pa": RANGES.iop_pa,
        "thickness_m": RANGES.thickness_m,
        "gap_m": RANGES.gap_m,
        "polar_rad": RANGES.polar_angle_rad,
    }
    for end, wanted in ((0, -1.0), (1, 1.0)):
        found = given(
            **{name: of.bounds[end] for name, of in ranges.items()}, direction_rad=0.0
        )
        for name in (
            "modulus",
            "log modulus sd",
            "log iop",
            "thickness",
            "gap",
            "polar angle",
        ):
            assert abs(found[name] - wanted) < 1e-6, name

        assert all(found[f"{name} known"] == 1.0 for name in KNOWN)

    low_e, high_e = RANGES.youngs_modulus_pa.bounds
    low_p, high_p = RANGES.iop_pa.bounds

    for e, p, wanted in ((high_e, low_p, -1.0), (low_e, high_p, 1.0)):
        assert (
            abs(
                given(modulus_pa=e, modulus_sd_fraction=0.02, iop_pa=p)["log iop ratio"]
                - wanted
            )
            < 1e-6
        )


def test_flag_and_value_of_an_unknown_are_zero() -> None:
    found = given()
    names = (
        "modulus",
        "log iop",
        "log iop ratio",
        "thickness",
        "gap",
        "polar angle",
        "pole along",
        "pole across",
    )
    assert [found[f"{name} known"] for name in KNOWN] == [0.0] * len(KNOWN)
    assert [found[name] for name in names] == pytest.approx(
        [0.0] * len(names), abs=1e-6
    )


def test_the_rigidity_counts_from_an_open_globe_to_the_stiffest() -> None:
    for globe, ends in (
        (OPEN, (-1.0, -1.0)),
        (UNKNOWN, (-0.949, 0.949)),
        (Globe.declared("sealed", to_si(0.03, "mmhg13_per_ul")), (-0.132, 0.132)),
    ):
        found = given(rigidity_low=globe.band[0], rigidity_high=globe.band[1])
        assert (found["rigidity low"], found["rigidity high"]) == pytest.approx(
            ends, abs=1e-3
        )


def test_the_pole_s_place_is_given_along_the_section_and_across_it() -> None:
    farthest = np.sin(RANGES.polar_angle_rad.bounds[1])
    for polar_rad, direction_rad in ((0.5, 0.0), (0.7, 1.1), (0.4, -2.5), (1.4, 0.3)):
        found = given(polar_rad=polar_rad, direction_rad=direction_rad)
        # the library's farthest
        along, across = pole_directions(min(polar_rad, np.radians(55.0)), direction_rad)
        assert found["pole along"] == pytest.approx(along / farthest, abs=1e-6)
        assert found["pole across"] == pytest.approx(across / farthest, abs=1e-6)

    middle = 0.5 * sum(RANGES.polar_angle_rad.bounds)
    alone = given(direction_rad=0.8)
    both = given(polar_rad=middle, direction_rad=0.8)
    for name in ("pole along", "pole across", "polar angle"):
        assert alone[name] == pytest.approx(both[name], abs=1e-6)

    assert (alone["polar angle known"], both["polar angle known"]) == (0.0, 1.0)
    turned = given(polar_rad=middle)
    assert (turned["pole along"], turned["pole across"]) == (0.0, 0.0)


def test_the_stiffening_is_even_in_the_logarithm_from_0_to_30() -> None:
    for stiffening, wanted in ((0.0, 0.0), (30.0, 1.0), (np.sqrt(31.0) - 1.0, 0.5)):
        assert given(stiffening=stiffening)["stiffening"] == pytest.approx(
            wanted, abs=1e-6
        )
    assert force_network.eye_for_network(
        Setup(eye=Eye(stiffening=5.0))
    ).stiffening.tolist() == [5.0]


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


def own(modulus_pa: float = 0.3e6, sd_pa: float = 5e3) -> Setup:
    return Setup(
        eye=Eye(modulus=Modulus(mean_pa=modulus_pa, sd_pa=sd_pa, source="own"))
    )


def test_force_and_interval_scale_with_the_given_modulus(folder: Path) -> None:
    reader = load_reader(folder)
    edges = force_network.ratio_edges(len(SHARES), reader.study.reader.max_force_ratio)

    for modulus_pa in (0.2e6, 0.5e6):
        read = reader.network.read(CUTS, own(modulus_pa))
        # A quarter lies below edge 3, half in bin 3, a quarter above edge 4.
        assert read.force_n == pytest.approx(
            modulus_pa * (edges[3] + edges[4]) / 2, rel=1e-5
        )
        ends = (
            edges[2] + 0.2 * (edges[3] - edges[2]),
            edges[5] - 0.2 * (edges[5] - edges[4]),
        )
        np.testing.assert_allclose(
            read.interval_n, modulus_pa * np.array(ends), rtol=1e-5
        )
        assert read.contact_m == pytest.approx(0.4e-3)
        assert sum(read.probabilities) == pytest.approx(1.0)

    middle = own(0.5 * sum(reader.study.reader.youngs_modulus_pa.bounds), 1e3)
    assert (
        reader.network.read(CUTS, Setup()).force_n
        == reader.network.read(CUTS, middle).force_n
    )


def test_an_eye_s_discrepancy_of_forces_moves_the_reading_and_its_interval(
    folder: Path,
) -> None:
    stiffer = ForceDiscrepancy(
        level=0.05, growth=0.4, level_sd=0.01, growth_sd=0.02, correlation=0.0
    )
    reader = load_reader(folder)
    was, now = (
        reader.network.read(
            CUTS, replace(own(), eye=replace(own().eye, discrepancy=found))
        )
        for found in (None, stiffer)
    )
    # The quantiles move as forces do, but for the bins between whose ends they lie.
    np.testing.assert_allclose(
        now.interval_n, stiffer.corrected_n(np.array(was.interval_n)), rtol=0.02
    )
    assert now.force_n == pytest.approx(
        float(stiffer.corrected_n(np.array(was.force_n))), rel=0.02
    )
    assert now.force_n != pytest.approx(was.force_n, rel=0.02)


def test_several_slices_are_read_by_the_mean_of_their_histograms(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    histograms = np.array(
        [[0, 1, 0, 0, 0, 0, 0, 0], [0, 0, 0.5, 0, 0.5, 0, 0, 0]], dtype=np.float32
    )
    fed: list[dict[str, np.ndarray]] = []

    class Session:
        def run(
            self, _: object, inputs: dict[str, np.ndarray]
        ) -> tuple[np.ndarray, np.ndarray]:
            fed.append(inputs)
            return histograms, np.array([0.1e-3, 0.4e-3], dtype=np.float32)

    reader = load_reader(folder)
    edges = force_network.ratio_edges(len(SHARES), reader.study.reader.max_force_ratio)
    monkeypatch.setattr(reader.network, "_session", Session())
    read = reader.network.read(
        CUTS[:2], replace(own(), eye=replace(own().eye, iop_pa=250.0))
    )
    # half of the mean lies below
    assert read.force_n == pytest.approx(0.3e6 * edges[2], rel=1e-5)
    assert read.contact_m == pytest.approx(0.25e-3)
    (inputs,) = fed
    assert inputs["slices"].shape == (2, 40, 140)
    np.testing.assert_array_equal(inputs["given"][0], inputs["given"][1])


def test_the_known_values_of_an_eye_reach_the_network_and_the_others_are_nan() -> None:
    eye = force_network.eye_for_network(
        Setup(eye=Eye(iop_pa=250.0), needle=Needle(gap_m=0.5e-3))
    )
    assert (eye.iop_pa[0], eye.gap_m[0]) == (250.0, 0.5e-3)
    unknown = (
        eye.modulus_pa,
        eye.modulus_sd_fraction,
        eye.thickness_m,
        eye.polar_rad,
        eye.direction_rad,
    )
    assert np.isnan(unknown).all()
    assert (
        force_network.eye_for_network(own(0.25e6, 1.0)).modulus_sd_fraction[0] == 0.01
    )
    placed = force_network.eye_for_network(
        Setup(needle=Needle(polar_rad=0.6), scan=Scan(direction_rad=-1.2))
    )
    assert (placed.polar_rad[0], placed.direction_rad[0]) == (0.6, -1.2)


def test_a_folder_whose_parts_do_not_fit_is_refused(folder: Path) -> None:
    reader = load_reader(folder)
    assert (reader.default, reader.kind) == ("fit", "reader")
    with pytest.raises(ModelError, match="found 'reader', a classifier is needed here"):
        load_classifier(folder)

    record = (folder / "model.json").read_text()
    study = (folder / "study.toml").read_text()
    (folder / "model.json").write_text(
        json.dumps({**json.loads(record), "default": "guess"})
    )

    with pytest.raises(ModelError, match="default: found 'guess'"):
        load_reader(folder)

    (folder / "model.json").write_text(record)
    rewrite(
        folder,
        "study.toml",
        study.replace(f"bins = {len(SHARES)}\n", "bins = 16\n").encode(),
    )

    with pytest.raises(ModelError, match="outputs: found"):
        load_reader(folder)

    rewrite(folder, "study.toml", study.encode())
    rewrite(folder, "library.npz", b"nothing")
    with pytest.raises(ModelError, match=r"library\.npz: not a response library"):
        load_reader(folder)
