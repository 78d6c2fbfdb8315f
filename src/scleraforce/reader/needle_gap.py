"""Which gaps between B-scan and needle axis are read, and what a needle in the picture says of the gap."""

from dataclasses import replace

from scleraforce.known.eye import Known
from scleraforce.segmentation.needle import SeenNeedle
from scleraforce.study import Range, ReaderStudy
from scleraforce.units import from_si

SLACK_M = 0.1e-3  # of a stated gap, beyond the needle's radius


def read_by_fit(trained: ReaderStudy) -> ReaderStudy:
    """Return what the fit reads: all that a model was trained on, and gaps from 0.

    The library's walls are surfaces of revolution about the needle axis: it has a section at any gap.
    """
    return replace(trained, gap_m=Range(min=0.0, max=trained.gap_m.bounds[1]))


def crossed_by_needle(trained: ReaderStudy, radius_m: float) -> ReaderStudy:
    """Return what is known of a frame that a needle crosses: where no gap is told, it is within the needle's radius."""
    return replace(trained, gap_m=Range(min=0.0, max=radius_m))


def needle_elsewhere(needle: SeenNeedle | None, known: Known, radius_m: float) -> str | None:
    """Return why a needle in the picture and the gap that was told exclude each other; None where they do not.

    Args:
        needle: the one that is seen.
        known: of the eye.
        radius_m: of the needle that the model knows.

    >>> seen = SeenNeedle(angle_rad=0.0, tip_m=(0.0, 1e-3), tip=(256.0, 128.0), top=(256.0, -0.5), hidden=(244, 268))
    >>> needle_elsewhere(seen, Known(gap_m=0.8e-3), 0.35e-3)
    'a needle is seen, although the B-scan is said to pass 0.8 mm from its axis: its radius is 0.35 mm'
    >>> needle_elsewhere(seen, Known(gap_m=0.1e-3), 0.35e-3)
    """
    if needle is None or known.gap_m is None or known.gap_m <= radius_m + SLACK_M:
        return None
    return (
        f"a needle is seen, although the B-scan is said to pass {from_si(known.gap_m, 'mm'):.4g} mm from its axis: "
        f"its radius is {from_si(radius_m, 'mm'):.4g} mm"
    )
