"""Detects a picture that was shown before: the speckle and noise of a live scanner never repeat."""

from typing import Any

import fastcrc
import numpy as np
from numpy.typing import NDArray

PLACES = 256  # pairs of neighbouring pixels that are compared, spread over the frame
LEAST_TOLD = 32  # pairs with texture; with fewer, only pictures equal to the last bit count as the same
SAME_SHARE = 0.75  # of the pairs with texture
NO_TEXTURE = 0xA5C35A3C  # stored in place of a pair of equal pixels, and unequal to every such pair


class ShownPictures:
    """Remembers the last pictures of one size by a sparse sample of their pixels.

    A pair of neighbouring pixels that differ is texture. Black bands, blank and saturated regions, which may rightly
    stay constant, have none. Two pictures are the same if three quarters of the texture agree to the last bit; live
    speckle agrees in a few per cent, by chance. A burned-in clock, a flickering line or a moving strip does not hide
    a repeated picture.

    Args:
        most: how many pictures are remembered.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._size: tuple[int, np.dtype[Any]] | None = None

    def back(self, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> int:
        """Take a picture (row, column); return how many pictures ago it was last shown, 0 if it is new.

        >>> shown, rng = ShownPictures(50), np.random.default_rng(0)
        >>> first, second = rng.integers(0, 4096, (2, 64, 64), dtype=np.uint16)
        >>> [shown.back(picture) for picture in (first, second, first, first)]
        [0, 0, 2, 1]
        """
        if self._size != (pixels.size, pixels.dtype):
            self._begin(pixels)
        pairs_pn = pixels.reshape(-1).take(self._places_pn)
        words_p = pairs_pn.view(self._words_mp.dtype)[:, 0]
        textured_p = pairs_pn[:, 0] != pairs_pn[:, 1]
        told = int(np.count_nonzero(textured_p))
        checksum = None if told >= LEAST_TOLD else fastcrc.crc64.ecma_182(pixels.data)
        if checksum is None:
            alike_m = (self._words_mp == words_p).sum(axis=1, dtype=np.uint16) >= SAME_SHARE * told
        else:
            alike_m = np.array([shown == checksum for shown in self._checksums])
        slot = self._count % self._most
        back = 0
        if alike_m.any():
            back = min((slot - one - 1) % self._most + 1 for one in np.flatnonzero(alike_m).tolist())
        self._words_mp[slot] = words_p
        np.putmask(self._words_mp[slot], ~textured_p, self._no_texture)
        self._checksums[slot] = checksum
        self._count += 1
        return back

    def _begin(self, pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
        """Forget all pictures and choose the pairs for this size: one at random in each of `PLACES` equal parts."""
        count = max(1, min(PLACES, pixels.size // 2))
        part = max(1, (pixels.size - 1) // count)
        left_p = np.arange(count) * part + np.random.default_rng(0).integers(0, part, count)
        self._places_pn = np.minimum(np.stack([left_p, left_p + 1], axis=1), pixels.size - 1)
        word = np.dtype(np.uint16 if pixels.dtype == np.uint8 else np.uint32)
        self._no_texture = word.type(NO_TEXTURE & (256**word.itemsize - 1))
        self._words_mp = np.full((self._most, count), self._no_texture)
        self._checksums: list[int | None] = [None] * self._most
        self._size, self._count = (pixels.size, pixels.dtype), 0
