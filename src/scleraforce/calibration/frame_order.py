"""In which order the frames of a recording are calibrated on, and how far up the forces of those that could be go."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scleraforce.units import from_si

Array = NDArray[np.float64]

FAR_ABOVE = 1.5  # of the highest force that is calibrated on: a force above is far from it


def frame_order(
    force_n: Array, included: Sequence[bool], min_force_n: float, frames: int | None, rising: bool
) -> list[int]:
    """Return the frames in the order in which they are looked at.

    All in theirs; or, where only some are wanted, the first few that say where the eye lies, then those of the highest
    force and of even shares of it, which tell modulus and rigidity apart, in rising order, then whatever else there is
    for those that cannot be used. Shallow dents hardly show the rigidity: they give the modulus, and from there the way
    to both is short. A deep one alone leaves a bent valley of both.

    Args:
        force_n: of each frame, N; not looked at where a frame is not included.
        included: whether a frame may be used.
        min_force_n: up to here a frame only says where the eye lies.
        frames: how many are wanted; None: all.
        rising: whether all are taken in rising order as well.
    """
    if frames is None and not rising:
        return list(range(len(included)))
    light = [index for index, inside in enumerate(included) if inside and force_n[index] <= min_force_n]
    left = [index for index, inside in enumerate(included) if inside and force_n[index] > min_force_n]
    left.sort(key=lambda index: -force_n[index])
    if frames is None:
        return [*light, *reversed(left), *(index for index, inside in enumerate(included) if not inside)]
    chosen, highest_n = list[int](), force_n[left[0]] if left else 0.0
    for share in np.arange(frames, 0, -1) / frames:
        if left:
            nearest = min(left, key=lambda index: abs(force_n[index] - share * highest_n))
            left.remove(nearest)
            chosen.append(nearest)
    return [*light[:frames], *reversed(chosen), *left]


def reach_doubts(used_n: Sequence[float], missed_n: Sequence[float]) -> tuple[str, ...]:
    """Return a sentence on forces far above those that could be calibrated on; none where there are none.

    A wall that leaves the picture, down a dent or up under a rising pressure, cannot be calibrated on, and modulus and
    rigidity of a sealed eye can hardly be told apart in shallow dents.

    Args:
        used_n: forces of the frames that were calibrated on, N.
        missed_n: of those that were to be, and could not.

    >>> reach_doubts([0.011, 0.02], [0.028])
    ()
    """
    highest_n, missed_n = max(used_n, default=0.0), [force_n for force_n in missed_n if np.isfinite(force_n)]
    if not missed_n or max(missed_n) <= FAR_ABOVE * highest_n:
        return ()
    return (
        f"no frame above {from_si(highest_n, 'mn'):.0f} mN could be calibrated on, of forces up to "
        f"{from_si(max(missed_n), 'mn'):.0f} mN; what is read above rests on the library's walls alone",
    )
