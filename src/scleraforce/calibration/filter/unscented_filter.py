"""Reduced-order unscented Kalman filter for states and parameters (Moireau and Chapelle
2011; paper sec. 2.2).

The uncertainty lives in a space of p directions, whatever the number n of states: P = L
U^-1 L^T, L of shape (n, p), U of shape (p, p). For a static model the state is a
function of the parameters and is not carried: then n = p.

One step, with sampling points I_i and weights alpha_i (D = diag(alpha)):

- sampling      x_i = x+ + L R I_i, with R R^T = U^-1, R lower triangular
- prediction    none: the parameters do not move, x- = x+ and L becomes L R
- observation   z_i = H(x_i),  HL = [z*] D [I*]^T
- correction    U = 1 + HL^T (W + Omega)^-1 HL
                x+ = x- + L U^-1 HL^T (W + Omega)^-1 (y - sum alpha_i z_i)

with Omega = [z*] D [z*]^T - HL HL^T, the part of the spread of z that is not linear in
the p directions. It vanishes for simplex points, and the correction is then literally
that of the paper; for other points it makes P and the gain the same as in the
full-order UKF (Woodbury's identity). The step may be iterated (García-Fernández et al.
2015, iterated posterior linearisation).
"""

from collections.abc import Callable
from math import sqrt
from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.normal_distribution import is_beyond_chance


class SigmaPoints(NamedTuple):
    """A rule of `r` points in `p` dimensions."""

    points_rp: Floats  # [I*]^T, shape (r, p)
    weights_r: Floats  # alpha, shape (r,), sums to 1


def simplex(dimension: int) -> SigmaPoints:
    """Return the p + 1 corners of a regular simplex on the sphere of radius sqrt(p),
    equal weights.

    One parameter takes two points, as in the paper (sec. 3.2):

    >>> simplex(1).points_rp.ravel().tolist()
    [-1.0, 1.0]
    """
    points = np.zeros((dimension + 1, dimension))
    for d in range(1, dimension + 1):
        points[:d, d - 1] = -sqrt((dimension + 1) / (d * (d + 1)))
        points[d, d - 1] = sqrt((dimension + 1) * d / (d + 1))
    return SigmaPoints(points, np.full(dimension + 1, 1 / (dimension + 1)))


def canonical(dimension: int) -> SigmaPoints:
    """Return the 2p points at +- sqrt(p) on the axes, equal weights (Julier and
    Uhlmann's symmetric set).
    """
    axes = sqrt(dimension) * np.eye(dimension)
    return SigmaPoints(
        np.concatenate([axes, -axes]), np.full(2 * dimension, 1 / (2 * dimension))
    )


def star(dimension: int) -> SigmaPoints:
    """Return the canonical points, moved out, and the centre: 2p + 1 points of equal
    weight.
    """
    outer = sqrt((2 * dimension + 1) / (2 * dimension)) * canonical(dimension).points_rp
    points = np.concatenate([outer, np.zeros((1, dimension))])
    return SigmaPoints(points, np.full(2 * dimension + 1, 1 / (2 * dimension + 1)))


RULES = {"simplex": simplex, "canonical": canonical, "star": star}


def sigma_points(rule: str, dimension: int) -> SigmaPoints:
    """Return the points of a rule by its name in the study; raises `ValueError`."""
    if rule not in RULES or dimension < 1:
        raise ValueError(
            f"sigma points {rule!r} in {dimension} dimensions: one of"
            f" {', '.join(RULES)}, from 1 up"
        )
    return RULES[rule](dimension)


Operator = Callable[[Floats], Floats]  # sigma points (r, n) -> observations (r, m)

WINDOW = 5  # updates over which the innovations are watched for divergence
LARGEST_GATED_SHARE = 0.3  # of outliers; with more, the model does not fit the frame


class FilterParams(NamedTuple):
    """Settings of the filter; nothing in it changes from step to step."""

    sigma: SigmaPoints
    iterations: int = 1  # at most; 1 is the plain filter
    tolerance: float = 0.01  # of an iteration, in posterior standard deviations
    # normalised innovation from which an observation is an outlier
    gate: float = np.inf
    # scale the noise of a frame that does not fit by its innovation (Birge's ratio)
    inflate: bool = False


class Posterior(NamedTuple):
    """Mean, and covariance in reduced form."""

    mean: Floats  # x, shape (n,)
    factor: Floats  # L, shape (n, p)
    precision: Floats  # U, shape (p, p)
    updates: int = 0
    recent: tuple[
        tuple[float, int], ...
    ] = ()  # (normalised innovation squared, observations) of the last updates

    @property
    def covariance(self) -> Floats:
        """P = L U^-1 L^T, shape (n, n)."""
        return self.factor @ _solve(self.precision, self.factor.T)


class StepResult(NamedTuple):
    """One step: the posterior, and how it was found."""

    posterior: Posterior
    # normalised innovation squared of the kept ones; about `observations` when the
    # model is right
    nis: float
    observations: int  # number kept
    gated: tuple[int, ...]  # indices of the observations left out
    inflation: float  # factor on the noise covariance (1: as given)
    iterations: int
    status: str  # "ok", or a sentence
    # G of x+ = x- + G (y - h), shape (n, m), zero where an observation was left out
    gain: Floats
    # 1 - G H, shape (n, n), in the p directions: how far an error of x- survives
    contraction: Floats


class _Linear(NamedTuple):
    """The observation, linear in the reduced coordinates v about the sampled region: z
    = offset + slope v + noise.
    """

    offset: Floats  # (m,)
    slope: Floats  # (m, p)
    noise: Floats  # W + Omega, (m, m)


def initial_posterior(mean: Floats, covariance: Floats) -> Posterior:
    """Return the prior N(mean (n,), covariance (n, n)) with L its Cholesky factor and U
    = 1.
    """
    mean = np.asarray(mean, dtype=np.float64)
    return Posterior(
        mean,
        np.linalg.cholesky(np.asarray(covariance, dtype=np.float64)),
        np.eye(len(mean)),
    )


def filter_step(
    params: FilterParams,
    posterior: Posterior,
    observe: Operator,
    observation: Floats,
    noise_covariance: Floats,
) -> StepResult:
    """Assimilate an observation y (m,) with the noise covariance W (m, m); a step that
    fails keeps the posterior.

    `observe` is H: it takes sigma points (r, n) and returns predicted observations (r,
    m).
    """
    observed = np.asarray(observation, dtype=np.float64)
    factor = posterior.factor @ np.linalg.cholesky(np.linalg.inv(posterior.precision))
    p = factor.shape[1]
    prior = posterior._replace(factor=factor, precision=np.eye(p))
    first_rm = observe(prior.mean + params.sigma.points_rp @ factor.T)
    none = np.zeros((len(posterior.mean), len(observed)))
    same = np.eye(len(posterior.mean))
    failed = StepResult(posterior, np.inf, 0, (), 1.0, 0, "", none, same)

    if not np.isfinite(first_rm).all() or len(observed) == 0:
        return failed._replace(
            status="diverged: the model cannot be evaluated at the sigma points"
        )

    frame = _CorrectionInput(prior, observe, first_rm, observed, noise_covariance)
    try:
        return _step(params, frame)
    except np.linalg.LinAlgError:
        return failed._replace(
            status=(
                "diverged: the iteration left the region in which the model can be"
                " evaluated"
            )
        )


class _CorrectionInput(NamedTuple):
    """The input of one correction."""

    prior: Posterior
    observe: Operator
    first_rm: Floats  # observations predicted at the sigma points
    observed: Floats
    noise: Floats


def _step(params: FilterParams, frame: _CorrectionInput) -> StepResult:
    """Return the step; raises `LinAlgError` if only rounding is left, or the model
    cannot be evaluated.
    """
    fit = _fit(params, frame)
    prior = frame.prior
    observed = frame.observed
    whitened = (
        _whitening(fit.linear, fit.kept).T @ (observed - fit.linear.offset)[fit.kept]
    )
    nis = float(whitened @ whitened)
    count = int(fit.kept.sum())
    inflation = max(1.0, nis / count) if params.inflate else 1.0
    inflated = fit.linear._replace(noise=fit.linear.noise * inflation)
    shift, precision = _correct(inflated, observed, fit.kept)
    np.linalg.cholesky(np.linalg.inv(precision))  # raises unless it is a covariance
    recent = (*prior.recent, (nis, count))[-WINDOW:]
    corrected = Posterior(
        prior.mean + prior.factor @ shift,
        prior.factor,
        precision,
        prior.updates + 1,
        recent,
    )
    gated = tuple(int(index) for index in np.flatnonzero(~fit.kept))
    gain = _gain(prior.factor, inflated, precision, fit.kept)

    return StepResult(
        corrected, nis, count, gated, inflation, fit.iterations, _status(recent), *gain
    )


class _GatedFit(NamedTuple):
    linear: _Linear
    kept: Flags
    iterations: int


def _fit(params: FilterParams, frame: _CorrectionInput) -> _GatedFit:
    """Linearise, leave out outliers one by one and linearise again."""
    kept = np.ones(len(frame.observed), dtype=bool)
    allowed = LARGEST_GATED_SHARE * len(kept)

    while True:
        fit = _linearise(params, frame, kept)
        worst, size = _worst(fit.linear, frame.observed, kept)
        if size <= params.gate:
            return fit

        kept = kept.copy()
        kept[worst] = False
        if len(kept) - kept.sum() > allowed:
            return _linearise(params, frame, np.ones(len(kept), dtype=bool))


def _linearise(params: FilterParams, frame: _CorrectionInput, kept: Flags) -> _GatedFit:
    """Linearise the observation about the (iterated) posterior."""
    points = params.sigma.points_rp
    prior = frame.prior
    # in the coordinates v of x = mean + L v, whose prior is N(0, 1)
    centre = np.zeros(points.shape[1])
    root = np.eye(points.shape[1])
    linear = _regress(params.sigma, frame.first_rm, centre, root, frame.noise)

    for iteration in range(1, params.iterations):
        new_centre, precision = _correct(linear, frame.observed, kept)
        new_root = np.linalg.cholesky(np.linalg.inv(precision))

        predicted_rm = frame.observe(
            prior.mean + (new_centre + points @ new_root.T) @ prior.factor.T
        )
        if not np.isfinite(predicted_rm).all():
            raise np.linalg.LinAlgError("the model cannot be evaluated here")

        linear = _regress(params.sigma, predicted_rm, new_centre, new_root, frame.noise)
        moved = np.abs(_solve(new_root, new_centre - centre)).max()
        centre = new_centre
        root = new_root

        if moved < params.tolerance:
            return _GatedFit(linear, kept, iteration + 1)

    return _GatedFit(linear, kept, params.iterations)


def _regress(
    sigma: SigmaPoints,
    predicted_rm: Floats,
    centre: Floats,
    root: Floats,
    noise: Floats,
) -> _Linear:
    """Regress predicted observations on the sampled coordinates centre + root I_i; HL
    where centre = 0, root = 1.
    """
    points, weights = sigma
    mean = weights @ predicted_rm
    spread = predicted_rm - mean
    along_points = spread.T @ (weights[:, None] * points)
    slope = _solve(root.T, along_points.T).T
    # squared, not taken from the spread's square: that may round below zero
    bent = spread - points @ along_points.T

    return _Linear(
        mean - slope @ centre, slope, noise + bent.T @ (weights[:, None] * bent)
    )


def _correct(linear: _Linear, observed: Floats, kept: Flags) -> tuple[Floats, Floats]:
    """Return U^-1 HL^T W^-1 (y - z) (p,) and U (p, p) for the prior v ~ N(0, 1)."""
    slope = linear.slope[kept]
    noise = linear.noise[np.ix_(kept, kept)]
    weighted = _solve(noise, slope)
    precision = np.eye(slope.shape[1]) + slope.T @ weighted
    precision = (precision + precision.T) / 2
    return _solve(precision, weighted.T @ (observed - linear.offset)[kept]), precision


def _gain(
    factor: Floats, linear: _Linear, precision: Floats, kept: Flags
) -> tuple[Floats, Floats]:
    """Return G = L U^-1 HL^T (W + Omega)^-1 (n, m) and 1 - G H = L U^-1 L^+ on the span
    of L (n, n).
    """
    gain = np.zeros((len(factor), len(kept)))
    weighted = _solve(linear.noise[np.ix_(kept, kept)], linear.slope[kept]).T
    gain[:, kept] = factor @ _solve(precision, weighted)
    onto_span = np.asarray(np.linalg.pinv(factor), dtype=np.float64)
    return gain, factor @ _solve(precision, onto_span)


def _solve(matrix: Floats, right: Floats) -> Floats:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def _worst(linear: _Linear, observed: Floats, kept: Flags) -> tuple[int, float]:
    """Return the observation with the largest innovation given all others, and its size
    in standard deviations.

    Given the others, because a common mode (a pose, a wide prior) makes every plain
    innovation look harmless (Baarda 1968): w_j = (S^-1 nu)_j / sqrt((S^-1)_jj), which
    for a single observation is nu / sqrt(S).
    """
    root = _whitening(linear, kept)
    sizes = np.abs(root @ (root.T @ (observed - linear.offset)[kept])) / np.sqrt(
        (root**2).sum(axis=1)
    )
    return int(np.flatnonzero(kept)[sizes.argmax()]), float(sizes.max())


def _whitening(linear: _Linear, kept: Flags) -> Floats:
    """Return B with S^-1 = B B^T of the innovation's covariance S.

    S itself is not formed: beside what a wide prior adds to it, the noise would be lost
    in the rounding.
    """
    noise_root = np.linalg.cholesky(linear.noise[np.ix_(kept, kept)])
    return np.linalg.inv(
        np.linalg.qr(np.vstack([noise_root.T, linear.slope[kept].T]), mode="r")
    )


def _status(recent: tuple[tuple[float, int], ...]) -> str:
    """Compare the innovations of the last updates with their expectation."""
    nis = sum(entry[0] for entry in recent)
    count = sum(entry[1] for entry in recent)
    if not np.isfinite(nis):
        return "diverged: an innovation is not finite"

    if not is_beyond_chance(nis, count):
        return "ok"

    return (
        f"diverged: over the last {len(recent)} frames the model misses the"
        f" observations by {np.sqrt(nis / count):.1f} sd"
    )
