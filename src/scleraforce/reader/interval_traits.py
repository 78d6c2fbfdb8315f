"""The traits of a reading that intervals are measured by: what makes a reader wrong.

Whether E was found on frames of the eye; what is told of the globe, or that the pressure under the needle has drawn a
sealed globe's wall so taut that its dent says little; whether the wall is uneven; whether the force is so light that
errors of the boundaries count and the eye hardly does; whether it lies beyond the forces that the eye was calibrated
on, and whether these leave wide gaps.
"""

from collections.abc import Mapping

from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.fitting.prior import form_size
from scleraforce.known.eye import Known
from scleraforce.known.globe import UNKNOWN, KnownGlobe

OWN, OTHER = "own E", "other E"  # whose modulus: of which a reading has one
GLOBES, TAUT = ("open", "sealed", "unknown"), "taut"
GLOBE_TRAITS = (*GLOBES, TAUT)  # likewise; of the other traits it has none or some
UNEVEN, LIGHT, BEYOND, SPARSE = "uneven", "light", ("beyond", "far beyond"), "sparse"
OF_CALIBRATION = (*BEYOND, SPARSE)
NETWORK_TRAITS: Mapping[str, tuple[str, ...]] = {OWN: (*GLOBES, *OF_CALIBRATION), OTHER: GLOBES}
FIT_TRAITS: Mapping[str, tuple[str, ...]] = {
    OWN: (*GLOBE_TRAITS, UNEVEN, LIGHT, *OF_CALIBRATION),
    OTHER: (*GLOBE_TRAITS, UNEVEN, LIGHT),
}
# Of the fit: frames of even walls lie nearer to an even wall of the library, those of uneven ones are farther from it.
LARGEST_MISFIT_M, LARGEST_FORM = 6e-6, 1.0
# Of 140 virtual eyes of the library that were not told open, calibrated on frames of their own, 90 % of the scores of
# even walls stayed below 0.6 at smaller tensions; of all walls below 1.6 at larger ones.
SLACK_TENSION = 0.05
LIGHTEST_N = 10e-3  # of other readings
# Of the largest force that an eye was calibrated on: up to 1.2 of it, 90 % of the scores of 82 virtual eyes, calibrated
# on three forces of up to 15 to 60 mN, stayed below 1.2, up to twice it below 1.3, beyond below 1.6 to 2.6.
BEYOND_FROM = 1.2, 2.0
# As a share of the largest force. Even shares of three leave 0.33; with three forces at random 0.98 of the intervals of
# eight virtual eyes held whose widest gap was below 0.4, and 0.76 of those of 81 others.
SPARSE_FROM = 0.45


def traits_of(known: Known, force_n: float, fit: BoundaryFit | None = None) -> tuple[str, ...]:
    """Return the traits of a reading of a force, N: of the network, or with a fit those of the fit.

    First whose modulus, then of `GLOBE_TRAITS`, then the others. An E that was told, or that is of other eyes, is not
    the eye's own: how sure it is was said, not measured.

    >>> traits_of(Known(), 20e-3)
    ('other E', 'unknown')
    """
    globe = UNKNOWN if known.globe is None else known.globe
    of_eye = _of_calibration(known, force_n) if known.has_own_modulus else ()
    of_frame = (globe.kind,) if fit is None else _of_fit(fit, force_n, globe)
    return OWN if known.has_own_modulus else OTHER, *of_frame, *of_eye


def _of_fit(fit: BoundaryFit, force_n: float, globe: KnownGlobe) -> tuple[str, ...]:
    """Return what makes a fit wrong."""
    taut = globe.can_be_sealed and fit.tension > SLACK_TENSION
    even = fit.misfit_m <= LARGEST_MISFIT_M and form_size(fit.unknown) <= LARGEST_FORM
    found = {UNEVEN: not even, LIGHT: force_n < LIGHTEST_N}
    return TAUT if taut else globe.kind, *(trait for trait, has in found.items() if has)


def _of_calibration(known: Known, force_n: float) -> tuple[str, ...]:
    """Return what the frames that an eye was calibrated on leave open of a force."""
    if known.discrepancy is None:
        return ()
    largest_n, gap = known.discrepancy.largest_n, known.discrepancy.widest_gap
    beyond = 0 if largest_n is None else sum(force_n > times * largest_n for times in BEYOND_FROM)
    if beyond:
        return (BEYOND[beyond - 1],)
    return (SPARSE,) if gap is not None and gap > SPARSE_FROM else ()
