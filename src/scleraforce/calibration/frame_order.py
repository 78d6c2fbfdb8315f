"""In which order the frames of a recording are calibrated on."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["frame_order"]

Array = NDArray[np.float64]


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
