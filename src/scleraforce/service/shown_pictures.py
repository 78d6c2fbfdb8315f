"""Which of the last pictures a frame shows again: a live scanner's speckle and noise never come back."""

from typing import Any

import fastcrc
import numpy as np
from numpy.typing import NDArray

__all__ = ["ShownPictures"]

PLACES = 512  # pairs of neighbours that are looked at, spread over the frame
LEAST_TOLD = 32  # places with texture; with fewer, only pictures that are the same to the last bit are the same
SAME_SHARE = 0.75  # of the places with texture
NOTHING = 0  # a pair without texture, as it is kept
NO_MATCH = (1 << 16) | 1  # and as it is compared: two neighbours that are alike, which is never kept


class ShownPictures:
    """Remembers the last pictures of one size by a sparse sample of their pixels.

    A pair of neighbours that differ is texture: black bands, blank and saturated regions, which rightly stay as they
    are, have none. Two pictures are the same where three quarters of the texture is the same to the last bit; by chance
    live speckle has a few per cent. A clock burned in, a line that flickers or a strip that moves does not hide that.

    Args:
        most: pictures that are remembered.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._size: tuple[int, np.dtype[Any]] | None = None

    def back(self, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> int:
        """Take a picture (row, column); return how many pictures ago it was shown last, 0 where it is new.

        >>> shown, rng = ShownPictures(50), np.random.default_rng(0)
        >>> first, second = rng.integers(0, 4096, (2, 64, 64), dtype=np.uint16)
        >>> [shown.back(picture) for picture in (first, second, first, first)]
        [0, 0, 2, 1]
        """
        if self._size != (pixels.size, pixels.dtype):
            self._begin(pixels)
        pairs = pixels.reshape(-1)[self._places_pn].astype(np.uint32)
        textured = pairs[0] != pairs[1]
        told = int(textured.sum())
        words = (pairs[0] << 16) | pairs[1]
        if told >= LEAST_TOLD:
            checksum = None
            same_mp = self._words_mp == np.where(textured, words, NO_MATCH)
            alike = same_mp.sum(axis=1, dtype=np.uint16) >= SAME_SHARE * told
        else:
            checksum = fastcrc.crc64.ecma_182(pixels.data)
            alike = np.array([shown == checksum for shown in self._checksums])
        back = min(((self._count - slot - 1) % self._most + 1 for slot in np.flatnonzero(alike).tolist()), default=0)
        slot = self._count % self._most
        self._words_mp[slot] = np.where(textured, words, NOTHING)
        self._checksums[slot] = checksum
        self._count += 1
        return back

    def _begin(self, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
        """Forget all, and choose the places in pictures of this size: one at random in each of as many equal parts."""
        count = max(1, min(PLACES, pixels.size // 2))
        part = max(1, (pixels.size - 1) // count)
        offsets = np.random.default_rng(0).integers(0, part, count)
        left = np.minimum(np.arange(count) * part + offsets, max(0, pixels.size - 2))
        self._places_pn = np.stack([left, np.minimum(left + 1, pixels.size - 1)])
        self._words_mp = np.full((self._most, count), NOTHING, dtype=np.uint32)
        self._checksums: list[int | None] = [None] * self._most
        self._size, self._count = (pixels.size, pixels.dtype), 0
