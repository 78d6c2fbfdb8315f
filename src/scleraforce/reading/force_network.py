"""Networks that read a force: a picture and known values of the eye in, a histogram of
F/E and the contact out.

The histogram has the probability of bins of x = F/E, E the modulus that the network was
given. The density is even in a bin, so the distribution function is piecewise linear,
and all figures of the force agree: the probability of a class is that of its forces,
and the median lies in the class that has more than half of it. The control loop reads
one frame at a time, which plain Python does in a third of the time of arrays.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import accumulate, pairwise
from math import inf, nan, radians, sqrt
from typing import Any

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import ModelError
from scleraforce.base.onnx_network import check_interface, run_network
from scleraforce.fit.one_frame import positive_share
from scleraforce.library.library_plan import LARGEST_POLAR_DEG
from scleraforce.library.moving_base import pole_directions
from scleraforce.reading.answer import Reading, stretched_interval, unstretched
from scleraforce.reading.frame_checks import read_by_fit
from scleraforce.reading.interval_widths import NO_FACTORS, IntervalFactors
from scleraforce.records.eye import NO_DISCREPANCY
from scleraforce.records.fields import Sampled
from scleraforce.records.globe import SAME_SLOPE_PA, UNKNOWN
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy, Study
from scleraforce.records.study_of_eye import RIGIDITY_LAWS
from scleraforce.wall.wall_network import FINDER_FRAMES

INTERVAL = (0.05, 0.95)  # the shares of the distribution below the 90 % interval's ends


def ratio_edges(bins: int, max_force_ratio: float) -> Floats:
    """Return the edges of the bins of F/E (bins + 1,), m^2; they are narrow for small
    forces and stiff eyes.
    """
    return max_force_ratio * (np.arange(bins + 1) / bins) ** 2


def histogram_reading(
    histogram: Sequence[float],
    edges_m2: Sequence[float],
    modulus_pa: float,
    bounds_n: tuple[float, ...],
    contact_m: float = 0.0,
    factor_of: Callable[[float], float] = lambda _: 1.0,
) -> Reading:
    """Return the reading of one histogram.

    `histogram`: probabilities of the bins, of any positive sum; with one that is not a
    number the reading is NaN. `modulus_pa`: the network's input. `bounds_n`: increasing
    bounds between the classes. `factor_of`: factor by which the distribution is
    stretched about its median, as a function of that median
    (`reading.interval_widths`); forces stay at or above 0.

    >>> edges, bounds_n = [0.0, 1e-8, 3e-8], (5e-3, 20e-3)
    >>> histogram_reading([1.0, 1.0], edges, 1e6, bounds_n).probabilities
    (0.25, 0.5, 0.25)
    """
    sums = list(accumulate(histogram, initial=0.0))
    total = sums[-1] if 0.0 < sums[-1] < inf else nan
    low_n, median_n, high_n = (
        modulus_pa * _crossing(sums, edges_m2, share * total)
        for share in (INTERVAL[0], 0.5, INTERVAL[1])
    )
    factor = factor_of(median_n)
    negative, *shares = (
        _sum_below(sums, edges_m2, max(force_n / modulus_pa, 0.0)) / total
        for force_n in unstretched(median_n, (0.0, *bounds_n), factor)
    )
    below = [0.0, *(positive_share(share, negative) for share in shares), 1.0]

    return Reading(
        probabilities=tuple(after - before for before, after in pairwise(below)),
        force_n=median_n,
        interval_n=stretched_interval(median_n, (low_n, high_n), factor),
        contact_m=contact_m,
    )


def _crossing(sums: Sequence[float], edges_m2: Sequence[float], wanted: float) -> float:
    """Return where the sums reach a value."""
    last = min(max(bisect_left(sums, wanted), 1), len(sums) - 1)
    low = sums[last - 1]
    high = sums[last]
    part = (wanted - low) / (high - low if high > low else 1.0)
    return edges_m2[last - 1] + part * (edges_m2[last] - edges_m2[last - 1])


def _sum_below(
    sums: Sequence[float], edges_m2: Sequence[float], ratio_m2: float
) -> float:
    """Return the sum below a ratio."""
    last = bisect_right(edges_m2, ratio_m2)
    if last >= len(edges_m2):
        return sums[-1]
    part = (ratio_m2 - edges_m2[last - 1]) / (edges_m2[last] - edges_m2[last - 1])
    return sums[last - 1] + part * (sums[last] - sums[last - 1])


# One column of the network's input for each.
GIVEN = (
    "modulus known",
    "modulus",
    "log modulus sd",
    "iop known",
    "log iop",
    "log iop ratio",
    "thickness known",
    "thickness",
    "gap known",
    "gap",
    "rigidity low",
    "rigidity high",
    "polar angle known",
    "polar angle",
    "direction known",
    "pole along",
    "pole across",
    "stiffening",
)


STIFF = np.log1p(30.0)  # at a stiffening of 30 the input is 1


@dataclass(frozen=True)
class GivenEyes:
    """Known values of n eyes, each (sample,); NaN: unknown.

    `modulus_pa` and `modulus_sd_fraction` (relative) describe a normal distribution;
    both or none are known. The globe's rigidity lies with 90 % between `rigidity_low`
    and `rigidity_high`, Pa^(1/3)/m^3, of the cube-root law: both 0 in an open globe;
    wide rather than unknown. `polar_rad` is the contact's polar angle, `direction_rad`
    that of the section from the meridian. `stiffening` is b of the tissue, never
    unknown.
    """

    modulus_pa: Floats
    modulus_sd_fraction: Floats
    iop_pa: Floats
    thickness_m: Floats
    gap_m: Floats
    rigidity_low: Floats
    rigidity_high: Floats
    polar_rad: Floats
    direction_rad: Floats
    stiffening: Floats


def given_modulus(eyes: GivenEyes, study: ReaderStudy) -> tuple[Floats, Floats]:
    """Return mean, Pa, and relative standard deviation of the modulus (sample,);
    unknown: even over the training's.
    """
    low, high = study.youngs_modulus_pa.bounds
    mean = 0.5 * (low + high)
    sd = (high - low) / sqrt(12.0) / mean
    unknown = np.isnan(eyes.modulus_pa)

    return np.where(unknown, mean, eyes.modulus_pa), np.where(
        unknown, sd, eyes.modulus_sd_fraction
    )


def given_inputs(eyes: GivenEyes, study: ReaderStudy) -> NDArray[np.float32]:
    """Return the network's second input, shape (sample, len(GIVEN)): flags (1: known)
    and values, 0 if unknown.

    A value at the ends of its training range is -1 or 1. The IOP is given twice: also
    over the modulus, as the mechanics depends on it. The pole's place, along the
    section and across it, is given over the farthest; for an unknown polar angle it is
    that of the range's middle.
    """
    modulus, sd = given_modulus(eyes, study)
    e = study.youngs_modulus_pa.bounds
    p = study.iop_pa.bounds
    s = study.modulus_sd_fraction.bounds
    iop_ratio = (np.log(p[0] / e[1]), np.log(p[1] / e[0]))
    a = study.polar_angle_rad.bounds
    polar = np.minimum(eyes.polar_rad, radians(LARGEST_POLAR_DEG))
    pole = pole_directions(
        np.where(np.isnan(polar), 0.5 * (a[0] + a[1]), polar), eyes.direction_rad
    )
    pole /= max(np.sin(a[1]), 1e-12)
    columns = (
        ~np.isnan(eyes.modulus_pa),
        _scaled(modulus, *e),
        _scaled(np.log(sd), np.log(s[0]), np.log(s[1])),
        ~np.isnan(eyes.iop_pa),
        _scaled(np.log(eyes.iop_pa), np.log(p[0]), np.log(p[1])),
        _scaled(np.log(eyes.iop_pa / modulus), *iop_ratio),
        ~np.isnan(eyes.thickness_m),
        _scaled(eyes.thickness_m, *study.thickness_m.bounds),
        ~np.isnan(eyes.gap_m),
        _scaled(eyes.gap_m, *study.gap_m.bounds),
        _scaled(eyes.rigidity_low, UNKNOWN.lowest, UNKNOWN.highest),
        _scaled(eyes.rigidity_high, UNKNOWN.lowest, UNKNOWN.highest),
        ~np.isnan(polar),
        _scaled(polar, *a),
        ~np.isnan(eyes.direction_rad),
        *pole.T,
        np.log1p(eyes.stiffening) / STIFF,
    )
    inputs: NDArray[np.float32] = np.nan_to_num(np.stack(columns, axis=1)).astype(
        np.float32
    )

    return inputs


def _scaled(values: Floats, low: float, high: float) -> Floats:
    return (values - 0.5 * (low + high)) / max(0.5 * (high - low), 1e-12)


SLICES = "slices"
GIVEN_INPUT = "given"
HISTOGRAM, CONTACT = OUTPUTS = ["histogram", "contact_m"]
EYES = 16  # whose inputs are cached


class ForceNetwork:
    """A network that ONNX Runtime runs: pictures and known values of an eye in, a force
    and the contact out.

    Inputs: pictures (n, row, column), uint8 `slices` or, with `raw`, float32 reduced
    frames (`FrameWindow.reduced`); and `given` float32 (n, len(GIVEN)). Outputs:
    `histogram` float32 (n, bin), the probability of bins of F/E, E the modulus that it
    was given, and `contact_m` float32 (n,), the needle's place from the picture's
    middle.
    """

    def __init__(
        self,
        session: onnxruntime.InferenceSession,
        study: Study,
        place: str,
        factors: IntervalFactors = NO_FACTORS,
        raw: bool = False,
    ) -> None:
        """Check a network; raises `ModelError`."""
        # raw frames are of eyes with gaps from 0
        trained = read_by_fit(study.reader) if raw else study.reader
        self._session = session
        self._place = place
        self._factors = factors
        self._trained = trained
        self._bounds_n = study.classes.bounds_n
        self._edges_m2 = ratio_edges(trained.bins, trained.max_force_ratio)
        self._inputs_of = lru_cache(maxsize=EYES)(self._inputs)
        self._pictures = FINDER_FRAMES if raw else SLICES
        shape = (
            [study.raw_reader.rows, study.raw_reader.columns]
            if raw
            else [study.slice.rows, study.slice.columns]
        )
        seen = ("tensor(float)" if raw else "tensor(uint8)", shape)
        inputs = {self._pictures: seen, GIVEN_INPUT: ("tensor(float)", [len(GIVEN)])}
        outputs = {
            HISTOGRAM: ("tensor(float)", [trained.bins]),
            CONTACT: ("tensor(float)", list[int]()),
        }
        check_interface(session, inputs, outputs, place)

    def read(self, pictures: NDArray[Any], setup: Setup) -> Reading:
        """Return the network's reading of pictures of one wall (picture, row, column):
        the mean of its histograms.
        """
        given, weights, modulus_pa, factor_of, edges_m2 = self._inputs_of(
            setup, len(pictures)
        )
        if len(given) > len(pictures):
            pictures = np.tile(pictures, (len(given) // len(pictures), 1, 1))

        inputs: dict[str, NDArray[Any]] = {
            self._pictures: np.ascontiguousarray(pictures),
            GIVEN_INPUT: given,
        }

        histogram, contact_m = run_network(self._session, OUTPUTS, inputs, self._place)
        if histogram.shape != (
            len(pictures),
            len(self._edges_m2) - 1,
        ) or contact_m.shape != (len(pictures),):
            found = (
                f"{histogram.shape} and {contact_m.shape} to {len(pictures)}"
                f" {self._pictures}"
            )
            raise ModelError(f"{self._place}: answers {found}")

        if weights is None:
            mean = histogram.mean(axis=0)
            middle_m = float(contact_m.mean())
        else:
            mean = weights @ histogram
            middle_m = float(weights @ contact_m)

        return histogram_reading(
            mean.tolist(), edges_m2, modulus_pa, self._bounds_n, middle_m, factor_of
        )

    def _inputs(
        self, setup: Setup, count: int
    ) -> tuple[
        NDArray[np.float32],
        Floats | None,
        float,
        Callable[[float], float],
        list[float],
    ]:
        """Return the input (eye x count, len(GIVEN)), the weights of its answers, an
        eye's modulus in it, Pa, the factor of a force's interval, edges.

        Several eyes stand for one that is less sure than those of the training
        (`eyes_for_network`); of a single one the weights are None: all alike. The edges
        of the bins of F/E, m^2, have the eye's discrepancy of the force.
        """
        each, shares = eyes_for_network(setup, self._trained)
        eyes = each[0]
        modulus_pa = float(given_modulus(eyes, self._trained)[0][0])
        discrepancy = setup.eye.discrepancy or NO_DISCREPANCY
        edges_m2 = discrepancy.corrected_n(modulus_pa * self._edges_m2) / modulus_pa
        factor_of = partial(self._factors.of_network, setup)
        given = np.concatenate(
            [np.repeat(given_inputs(eye, self._trained), count, axis=0) for eye in each]
        )
        weights = None if len(each) == 1 else np.repeat(shares, count) / count

        return given, weights, modulus_pa, factor_of, edges_m2.tolist()


# Of a normal distribution by three values (Gauss and Hermite): in standard deviations,
# and their weights.
NODES = ((0.0, 2.0 / 3.0), (-sqrt(3.0), 1.0 / 6.0), (sqrt(3.0), 1.0 / 6.0))


def eyes_for_network(
    setup: Setup, trained: ReaderStudy
) -> tuple[list[GivenEyes], Floats]:
    """Return the eyes that stand for one whose declared pressure and thickness are less
    sure than those of the training, and their weights, of sum 1; the first is the one
    that is declared.

    The network's histograms are averaged over what is left of the declared uncertainty
    once the training's own is taken off.
    """
    eye = setup.eye
    pressures = _values(
        eye.iop_pa, eye.iop_sd_pa, trained.iop_noise_fraction, trained.iop_pa
    )
    thicknesses = _values(
        eye.thickness_m,
        eye.thickness_sd_m,
        trained.thickness_noise_fraction,
        trained.thickness_m,
    )
    eyes = list[GivenEyes]()
    weights = list[float]()

    for iop_pa, iop_weight in pressures:
        for thickness_m, thickness_weight in thicknesses:
            one = replace(eye, iop_pa=iop_pa, thickness_m=thickness_m)
            eyes.append(eye_for_network(replace(setup, eye=one)))
            weights.append(iop_weight * thickness_weight)

    return eyes, np.array(weights)


def _values(
    value: float | None, sd: float | None, trained_fraction: float, trained: Sampled
) -> list[tuple[float | None, float]]:
    """Return values within the training's range, with their weights, that stand for one
    whose standard deviation is beyond a fraction of it.
    """
    if value is None or sd is None or sd <= trained_fraction * value:
        return [(value, 1.0)]

    left = sqrt(sd**2 - (trained_fraction * value) ** 2)
    low, high = trained.bounds
    return [
        (min(max(value + z * left, low), high) if z else value, weight)
        for z, weight in NODES
    ]


def eye_for_network(setup: Setup) -> GivenEyes:
    """Return one eye as the network's training represents it: arrays (1,), NaN where a
    value is unknown.
    """
    modulus = setup.eye.modulus
    globe = UNKNOWN if setup.eye.globe is None else setup.eye.globe
    of_modulus = (modulus.mean_pa, modulus.relative_sd) if modulus else (None, None)
    # by the cube-root law, as steep at the resting pressure as the globe's own law
    low, high = globe.band

    if globe.law != RIGIDITY_LAWS[0] and setup.eye.iop_pa is not None:
        steepness = float(np.cbrt(setup.eye.iop_pa / SAME_SLOPE_PA))
        low = low * steepness
        high = high * steepness

    of_eye = (
        setup.eye.iop_pa,
        setup.eye.thickness_m,
        setup.needle.gap_m,
        low,
        high,
        setup.needle.polar_rad,
        setup.scan.direction_rad,
    )
    values = (*of_modulus, *of_eye, setup.eye.stiffening or 0.0)

    return GivenEyes(
        *(np.array([np.nan if value is None else value]) for value in values)
    )
