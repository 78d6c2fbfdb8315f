"""Networks that read a force: their histograms, their known inputs, and their
folders.
"""

import json
from collections.abc import Callable
from dataclasses import fields
from math import inf, isfinite, nan
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from analytic_library import analytic_library
from small_models import rehash_model, write_fixed_reader

from scleraforce.base.errors import ModelError
from scleraforce.library.moving_base import pole_directions
from scleraforce.reading import force_network
from scleraforce.reading.answer import Reading
from scleraforce.reading.load_model import load_classifier, load_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.eye import Eye, ForceDiscrepancy, Modulus
from scleraforce.records.globe import OPEN, UNKNOWN
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, ReaderStudy
from virtual_eyes import changed

EDGES_M2 = force_network.ratio_edges(20, 0.4e-6)
BOUNDS_N = (5e-3, 30e-3)


def reading_of(histogram: list[float]) -> Reading:
    return force_network.histogram_reading(
        histogram, EDGES_M2.tolist(), 0.3e6, BOUNDS_N
    )


@pytest.mark.parametrize("concentration", [0.02, 0.3, 5.0])
def test_the_classes_have_the_histogram_s_shares_below_their_bounds(
    concentration: float,
):
    rng = np.random.default_rng(8)
    for histogram in rng.dirichlet(np.full(20, concentration), size=60):
        found = reading_of(histogram.tolist())
        below = np.interp(BOUNDS_N, 0.3e6 * EDGES_M2, [0.0, *histogram.cumsum()])
        np.testing.assert_allclose(
            found.probabilities, np.diff([0.0, *below, 1.0]), atol=1e-12
        )


@pytest.mark.parametrize(
    ("place", "wrong"),
    [(place, wrong) for place in (0, 7, 19) for wrong in (nan, inf)] + [(None, 0.0)],
)
def test_a_histogram_that_is_empty_or_not_finite_gives_a_reading_that_is_not_a_number(
    place: int | None, wrong: float
):
    histogram = [0.05 if place is not None else 0.0] * 20
    histogram[place or 0] = wrong
    found = reading_of(histogram)
    assert not isfinite(found.force_n)
    assert not all(map(isfinite, found.probabilities))
    assert not found.finite


RANGES = ReaderStudy()
RIGIDITIES = Range(min=UNKNOWN.lowest, max=UNKNOWN.highest)
KNOWN = ("modulus", "iop", "thickness", "gap", "polar angle", "direction")


def given(**values: float) -> dict[str, float]:
    """The network's input for an eye of some known values, in an open globe by default,
    by name.
    """
    unknown = dict.fromkeys((one.name for one in fields(force_network.GivenEyes)), nan)
    default = {"rigidity_low": 0.0, "rigidity_high": 0.0, "stiffening": 0.0}
    eye = unknown | default | values
    eyes = force_network.GivenEyes(**{name: np.array([v]) for name, v in eye.items()})
    inputs = force_network.given_inputs(eyes, RANGES)
    assert inputs.dtype == np.float32
    return dict(zip(force_network.GIVEN, inputs[0].tolist(), strict=True))


@pytest.mark.parametrize(("end", "wanted"), [(0, -1.0), (1, 1.0)])
def test_the_ends_of_a_range_are_minus_one_and_one(end: int, wanted: float):
    ranges = {
        "modulus_pa": ("modulus", RANGES.youngs_modulus_pa),
        "modulus_sd_fraction": ("log modulus sd", RANGES.modulus_sd_fraction),
        "iop_pa": ("log iop", RANGES.iop_pa),
        "thickness_m": ("thickness", RANGES.thickness_m),
        "gap_m": ("gap", RANGES.gap_m),
        "polar_rad": ("polar angle", RANGES.polar_angle_rad),
        "rigidity_low": ("rigidity low", RIGIDITIES),
        "rigidity_high": ("rigidity high", RIGIDITIES),
    }
    values = {name: of.bounds[end] for name, (_, of) in ranges.items()}
    found = given(**values, direction_rad=0.0)
    for name, _ in ranges.values():
        assert found[name] == pytest.approx(wanted, abs=1e-6), name
    assert all(found[f"{name} known"] == 1.0 for name in KNOWN)

    stiffest_pa = RANGES.youngs_modulus_pa.bounds[1 - end]
    found = given(**values | {"modulus_pa": stiffest_pa})
    assert found["log iop ratio"] == pytest.approx(wanted, abs=1e-6)


def test_flag_and_value_of_an_unknown_are_zero():
    wide = {"log modulus sd", "rigidity low", "rigidity high"}
    found = {name: value for name, value in given().items() if name not in wide}
    assert found == pytest.approx(dict.fromkeys(found, 0.0), abs=1e-6)


@pytest.mark.parametrize(
    ("polar_rad", "direction_rad"), [(0.5, 0.0), (0.7, 1.1), (0.4, -2.5), (1.4, 0.3)]
)
def test_the_pole_s_place_is_given_along_the_section_and_across_it(
    polar_rad: float, direction_rad: float
):
    found = given(polar_rad=polar_rad, direction_rad=direction_rad)
    # the library's farthest
    pole = pole_directions(min(polar_rad, np.radians(55.0)), direction_rad)
    expected = pole / np.sin(RANGES.polar_angle_rad.bounds[1])
    assert (found["pole along"], found["pole across"]) == pytest.approx(
        tuple(expected), abs=1e-6
    )


def test_an_unknown_polar_angle_is_that_of_the_range_s_middle():
    middle = 0.5 * sum(RANGES.polar_angle_rad.bounds)
    alone = given(direction_rad=0.8)
    both = given(polar_rad=middle, direction_rad=0.8)
    assert (alone["polar angle known"], both["polar angle known"]) == (0.0, 1.0)
    for name in ("pole along", "pole across", "polar angle"):
        assert alone[name] == pytest.approx(both[name], abs=1e-6)
    turned = given(polar_rad=middle)
    assert (turned["pole along"], turned["pole across"]) == (0.0, 0.0)


def test_the_stiffening_is_even_in_the_logarithm_from_0_to_30():
    found = [given(stiffening=b)["stiffening"] for b in (0.0, np.sqrt(31.0) - 1, 30.0)]
    assert found == pytest.approx([0.0, 0.5, 1.0], abs=1e-6)


pytest.importorskip("onnx")

SHARES = (0.0, 0.0, 0.25, 0.5, 0.25, 0.0, 0.0, 0.0)
CUTS = np.zeros((4, 40, 140), dtype=np.uint8)
LIBRARY = analytic_library(thicknesses=4, ratios=4, tips=6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("networks") / "model"
    write_fixed_reader(path, LIBRARY, SHARES, contact_m=0.4e-3)
    return path


@pytest.fixture
def reader(folder: Path) -> ForceReader:
    return load_reader(folder, finder=None)


@pytest.fixture
def edges_m2(reader: ForceReader) -> np.ndarray:
    most = reader.study.reader.max_force_ratio
    return force_network.ratio_edges(len(SHARES), most)


def own(modulus_pa: float = 0.3e6, sd_pa: float = 5e3, **eye: object) -> Setup:
    modulus = Modulus(mean_pa=modulus_pa, sd_pa=sd_pa, source="own")
    return Setup(eye=Eye(modulus=modulus, **eye))


@pytest.mark.parametrize("modulus_pa", [0.2e6, 0.5e6])
def test_force_and_interval_scale_with_the_given_modulus(
    reader, edges_m2, modulus_pa: float
):
    read = reader.network.read(CUTS, own(modulus_pa))
    # A quarter lies below edge 3, half in bin 3, a quarter above edge 4.
    middle_n = modulus_pa * (edges_m2[3] + edges_m2[4]) / 2
    assert read.force_n == pytest.approx(middle_n, rel=1e-5)
    ends_m2 = np.array([edges_m2[2], edges_m2[5]])
    ends_m2 += np.array([0.2, -0.2]) * np.diff(edges_m2)[[2, 4]]
    np.testing.assert_allclose(read.interval_n, modulus_pa * ends_m2, rtol=1e-5)
    assert read.contact_m == pytest.approx(0.4e-3)
    assert sum(read.probabilities) == pytest.approx(1.0)


def test_an_unknown_modulus_is_the_middle_of_the_training_s(reader):
    middle = own(0.5 * sum(reader.study.reader.youngs_modulus_pa.bounds), 1e3)
    unknown = reader.network.read(CUTS, Setup())
    assert unknown.force_n == reader.network.read(CUTS, middle).force_n


def test_an_eye_s_discrepancy_of_forces_moves_the_reading_and_its_interval(
    reader,
):
    stiffer = ForceDiscrepancy(
        level=0.05, growth=0.4, level_sd=0.01, growth_sd=0.02, correlation=0.0
    )
    was, now = (
        reader.network.read(CUTS, own(discrepancy=found)) for found in (None, stiffer)
    )
    # The quantiles move as forces do, but for the bins between whose ends they lie.
    read_n = np.array([*was.interval_n, was.force_n])
    moved_n = np.array([*now.interval_n, now.force_n])
    np.testing.assert_allclose(moved_n, stiffer.corrected_n(read_n), rtol=0.02)
    assert now.force_n != pytest.approx(was.force_n, rel=0.02)


class Session:
    """The part of an ONNX Runtime session that is asked; it keeps its inputs."""

    def __init__(self) -> None:
        self.fed = list[dict[str, np.ndarray]]()

    def run(
        self, _: object, inputs: dict[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        self.fed.append(inputs)
        histograms = np.array([[0, 1, 0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 1, 0, 0, 0]])
        histograms = histograms / histograms.sum(axis=1, keepdims=True)
        contacts_m = np.array([0.1e-3, 0.4e-3], dtype=np.float32)
        return histograms.astype(np.float32), contacts_m


@pytest.fixture
def session(reader, monkeypatch: pytest.MonkeyPatch) -> Session:
    told = Session()
    monkeypatch.setattr(reader.network, "_session", told)
    return told


def test_several_slices_are_read_by_the_mean_of_their_histograms(
    reader, session, edges_m2
):
    read = reader.network.read(CUTS[:2], own(iop_pa=250.0))
    # half of the mean lies below
    assert read.force_n == pytest.approx(0.3e6 * edges_m2[2], rel=1e-5)
    assert read.contact_m == pytest.approx(0.25e-3)
    (inputs,) = session.fed
    assert inputs["slices"].shape == (2, 40, 140)
    np.testing.assert_array_equal(inputs["given"][0], inputs["given"][1])


def test_the_known_values_of_an_eye_reach_the_network(reader, session):
    eye = {"iop_pa": 250.0, "thickness_m": 0.6e-3, "stiffening": 5.0}
    plane = {"gap_m": 0.5e-3, "polar_rad": 0.6, "direction_rad": -1.2}
    known = changed(own(0.25e6, 1.0, globe=OPEN), **eye, **plane)
    reader.network.read(CUTS[:2], known)
    # the modulus is taken for no surer than the training's
    modulus = {"modulus_pa": 0.25e6, "modulus_sd_fraction": 0.01}
    expected = given(**eye, **plane, **modulus)
    shown = session.fed[-1]["given"][0].tolist()
    assert shown == pytest.approx([*expected.values()], abs=1e-6)

    reader.network.read(CUTS[:2], changed(Setup(), globe=OPEN))
    shown = session.fed[-1]["given"][0].tolist()
    assert shown == pytest.approx([*given().values()], abs=1e-6)


@pytest.fixture
def with_record(folder: Path, tmp_path: Path) -> Callable[..., Path]:
    """Return the function that copies the folder with other values in its record."""

    def change(**record: object) -> Path:
        path = copytree(folder, tmp_path / "changed")
        kept = json.loads((path / "model.json").read_text())
        (path / "model.json").write_text(json.dumps(kept | record))
        return path

    return change


OPEN_BY = [
    {"network": {"own E": {"open": factor}}} for factor in (0.0, -1.0, "1", True, None)
]
OTHERS = [3, {"fit": 3}, {"fit": {"nobody": {}}}, {"fit": {"own E": 1.0}}]


@pytest.mark.parametrize(
    "intervals",
    [
        *OPEN_BY,
        *OTHERS,
        {"network": {"own E": {"uneven": 1.0}}},
        {"fit": {"own E, open, even": 1.5}},  # of an earlier version
    ],
    ids=range(11),
)
def test_factors_that_cannot_be_are_refused(with_record, intervals):
    with pytest.raises(
        ModelError, match=r"model\.json: intervals.* made anew|expected"
    ):
        load_reader(with_record(intervals=intervals), finder=None)


@pytest.mark.parametrize(
    ("name", "before", "after", "message"),
    [
        ("study.toml", b"bins = 8\n", b"bins = 16\n", "outputs: found"),
        ("library.npz", b"PK", b"no", r"library\.npz: not a response library"),
    ],
)
def test_a_folder_whose_parts_do_not_fit_is_refused(
    with_record, name, before, after, message
):
    path = with_record()
    content = (path / name).read_bytes()
    (path / name).write_bytes(content.replace(before, after))
    rehash_model(path, name)
    with pytest.raises(ModelError, match=message):
        load_reader(path, finder=None)


def test_a_folder_has_a_kind_and_a_default(reader, with_record):
    assert (reader.default, reader.kind) == ("fit", "reader")
    with pytest.raises(ModelError, match="found 'reader', a classifier is needed here"):
        load_classifier(reader.path)
    with pytest.raises(ModelError, match="default: found 'guess'"):
        load_reader(with_record(default="guess"), finder=None)


def test_the_factors_of_the_record_widen_the_interval(reader, with_record):
    factors = {"network": {"own E": {"open": 2.0}}}
    wide = load_reader(with_record(intervals=factors), finder=None)
    eye = own(globe=OPEN)
    was, now = (one.network.read(CUTS, eye) for one in (reader, wide))
    assert now.force_n == was.force_n
    above_n = [one.interval_n[1] - one.force_n for one in (was, now)]
    assert above_n[1] == pytest.approx(2.0 * above_n[0])
