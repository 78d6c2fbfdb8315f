"""The groups of readings that intervals are measured by, of what makes a reader wrong.

Whether E is the eye's own, what is told of the globe, whether the wall is even, whether the pressure under the needle
has drawn a sealed globe's wall so taut that its dent says little, and whether the force is so light that errors
of the boundaries count and the eye hardly does.
"""

from itertools import product

from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.fitting.prior import form_size
from scleraforce.known.eye import Known
from scleraforce.known.globe import UNKNOWN

__all__ = ["FIT_GROUPS", "NETWORK_GROUPS", "group_of"]

MODULI, GLOBES, FORMS = ("own E", "other E"), ("open", "sealed", "unknown"), ("even", "uneven")
TAUT, LIGHT = "taut", "light"
NETWORK_GROUPS = tuple(", ".join(words) for words in product(MODULI, GLOBES))
FIT_GROUPS = tuple(", ".join(words) for words in (*product(MODULI, GLOBES, FORMS), *product(MODULI, (TAUT, LIGHT))))
# Of the fit: frames of even walls lie nearer to an even wall of the library, those of uneven ones are farther from it.
LARGEST_MISFIT_M, LARGEST_FORM = 6e-6, 1.0
# Of 140 virtual eyes of the library that were not told open, calibrated on frames of their own, 90 % of the scores of
# even walls stayed below 0.6 at smaller tensions; of all walls below 1.6 at larger ones.
SLACK_TENSION = 0.05
LIGHTEST_N = 10e-3  # of other groups


def group_of(known: Known, fit: BoundaryFit | None = None) -> str:
    """Return the group of a reading: of the network, or with a fit that of the fit.

    >>> group_of(Known())
    'other E, unknown'
    """
    own = known.modulus is not None and known.modulus.source != "population"
    globe = UNKNOWN if known.globe is None else known.globe
    words = [MODULI[0 if own else 1], globe.kind]
    if fit is not None:
        if fit.force_n < LIGHTEST_N:
            return ", ".join([words[0], LIGHT])
        if globe.can_be_sealed and fit.tension > SLACK_TENSION:
            return ", ".join([words[0], TAUT])
        even = fit.misfit_m <= LARGEST_MISFIT_M and form_size(fit.unknown) <= LARGEST_FORM
        words.append(FORMS[0 if even else 1])
    return ", ".join(words)
