"""The groups of readings that intervals are measured by, of what makes a reader wrong.

Whether E was found on frames of the eye, what is told of the globe, whether the wall is even, whether the pressure
under the needle has drawn a sealed globe's wall so taut that its dent says little, whether the force is so light that
errors of the boundaries count and the eye hardly does, whether it lies beyond the forces that the eye was calibrated
on, and whether these leave wide gaps.
"""

from itertools import product

from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.fitting.prior import form_size
from scleraforce.known.eye import Known
from scleraforce.known.globe import UNKNOWN, KnownGlobe

__all__ = ["BEYOND_FROM", "FIT_GROUPS", "NETWORK_GROUPS", "group_of", "groups_of"]

MODULI, GLOBES, FORMS = ("own E", "other E"), ("open", "sealed", "unknown"), ("even", "uneven")
TAUT, LIGHT, BEYOND = "taut", "light", ("beyond", "far beyond")
SPARSE = f"{MODULI[0]}, sparse"
EXTRAPOLATED_GROUPS = tuple(f"{MODULI[0]}, {beyond}" for beyond in BEYOND)
NETWORK_GROUPS = *(", ".join(words) for words in product(MODULI, GLOBES)), *EXTRAPOLATED_GROUPS, SPARSE
FIT_GROUPS = (
    *(", ".join(words) for words in (*product(MODULI, GLOBES, FORMS), *product(MODULI, (TAUT, LIGHT)))),
    *EXTRAPOLATED_GROUPS,
    *(f"{SPARSE}, {kind}" for kind in (*GLOBES, TAUT, LIGHT)),
)
# Of the fit: frames of even walls lie nearer to an even wall of the library, those of uneven ones are farther from it.
LARGEST_MISFIT_M, LARGEST_FORM = 6e-6, 1.0
# Of 140 virtual eyes of the library that were not told open, calibrated on frames of their own, 90 % of the scores of
# even walls stayed below 0.6 at smaller tensions; of all walls below 1.6 at larger ones.
SLACK_TENSION = 0.05
LIGHTEST_N = 10e-3  # of other groups
# Of the largest force that an eye was calibrated on: up to 1.2 of it, 90 % of the scores of 82 virtual eyes, calibrated
# on three forces of up to 15 to 60 mN, stayed below 1.2, up to twice it below 1.3, beyond below 1.6 to 2.6.
BEYOND_FROM = 1.2, 2.0
# As a share of the largest force. Even shares of three leave 0.33; with three forces at random 0.98 of the intervals of
# eight virtual eyes held whose widest gap was below 0.4, and 0.76 of those of 81 others.
SPARSE_FROM = 0.45


def group_of(known: Known, force_n: float, fit: BoundaryFit | None = None) -> str:
    """Return the group of a reading of a force, N: of the network, or with a fit that of the fit.

    An E that was told, or that is of other eyes, is not the eye's own: how sure it is was said, not measured.

    >>> group_of(Known(), 20e-3)
    'other E, unknown'
    """
    return groups_of(known, force_n, fit)[0]


def groups_of(known: Known, force_n: float, fit: BoundaryFit | None = None) -> tuple[str, ...]:
    """Return the group of a reading (`group_of`), and the one to take the factor of where a model has none of it."""
    own = known.modulus is not None and known.modulus.source == "own"
    modulus, globe = MODULI[0 if own else 1], UNKNOWN if known.globe is None else known.globe
    usual: tuple[str, ...] = (globe.kind,) if fit is None else _of_fit(fit, force_n, globe)
    rarer = list[str]()
    if own and LIGHT not in usual and (beyond := _beyond(known, force_n)):
        rarer.append(EXTRAPOLATED_GROUPS[beyond - 1])
    elif own and _is_sparse(known):
        rarer.append(SPARSE if fit is None else f"{SPARSE}, {usual[0]}")
    return *rarer, ", ".join([modulus, *usual])


def _of_fit(fit: BoundaryFit, force_n: float, globe: KnownGlobe) -> tuple[str, ...]:
    """Return what makes a fit wrong, or the globe's kind and the wall's form."""
    if force_n < LIGHTEST_N:
        return (LIGHT,)
    if globe.can_be_sealed and fit.tension > SLACK_TENSION:
        return (TAUT,)
    even = fit.misfit_m <= LARGEST_MISFIT_M and form_size(fit.unknown) <= LARGEST_FORM
    return globe.kind, FORMS[0 if even else 1]


def _is_sparse(known: Known) -> bool:
    """Return whether the forces that an eye was calibrated on leave a wide gap."""
    gap = None if known.discrepancy is None else known.discrepancy.widest_gap
    return gap is not None and gap > SPARSE_FROM


def _beyond(known: Known, force_n: float) -> int:
    """Return how many of `BEYOND_FROM` a force exceeds."""
    calibrated_n = None if known.discrepancy is None else known.discrepancy.largest_n
    return 0 if calibrated_n is None else sum(force_n > times * calibrated_n for times in BEYOND_FROM)
