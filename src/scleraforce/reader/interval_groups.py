"""The groups of readings that intervals are measured by, of what makes a reader wrong.

Whether E was found on frames of the eye, what is told of the globe, whether the wall is even, whether the pressure
under the needle has drawn a sealed globe's wall so taut that its dent says little, whether the force is so light that
errors of the boundaries count and the eye hardly does, and whether it lies beyond the forces that the eye was
calibrated on.
"""

from itertools import product

from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.fitting.prior import form_size
from scleraforce.known.eye import Known
from scleraforce.known.globe import UNKNOWN

__all__ = ["BEYOND_FROM", "EXTRAPOLATED_GROUPS", "FIT_GROUPS", "NETWORK_GROUPS", "group_of", "groups_of"]

MODULI, GLOBES, FORMS = ("own E", "other E"), ("open", "sealed", "unknown"), ("even", "uneven")
TAUT, LIGHT, BEYOND = "taut", "light", ("beyond", "far beyond")
EXTRAPOLATED_GROUPS = tuple(f"{MODULI[0]}, {beyond}" for beyond in BEYOND)
NETWORK_GROUPS = *(", ".join(words) for words in product(MODULI, GLOBES)), *EXTRAPOLATED_GROUPS
FIT_GROUPS = (
    *(", ".join(words) for words in (*product(MODULI, GLOBES, FORMS), *product(MODULI, (TAUT, LIGHT)))),
    *EXTRAPOLATED_GROUPS,
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
    if fit is None:
        usual = [modulus, globe.kind]
    elif force_n < LIGHTEST_N:
        return (f"{modulus}, {LIGHT}",)
    elif globe.can_be_sealed and fit.tension > SLACK_TENSION:
        usual = [modulus, TAUT]
    else:
        even = fit.misfit_m <= LARGEST_MISFIT_M and form_size(fit.unknown) <= LARGEST_FORM
        usual = [modulus, globe.kind, FORMS[0 if even else 1]]
    beyond = _beyond(known, force_n) if own else 0
    extrapolated = EXTRAPOLATED_GROUPS[beyond - 1 : beyond] if beyond else ()
    return *extrapolated, ", ".join(usual)


def _beyond(known: Known, force_n: float) -> int:
    """Return how many of `BEYOND_FROM` a force exceeds."""
    calibrated_n = None if known.discrepancy is None else known.discrepancy.largest_n
    return 0 if calibrated_n is None else sum(force_n > times * calibrated_n for times in BEYOND_FROM)
