"""The figures that were asked for, by group of eyes, in the words of the table."""

from collections.abc import Mapping

__all__ = ["ASKED", "ASKED_MODULUS"]

ASKED: Mapping[str, tuple[str, ...]] = {
    "plain": ("98 % or more", "98 % or more", "", "0", "99 % or more", "2 % or less", "0.7 or less", "85 to 95 %"),
    "harder": ("97 % or more", "97 % or more", "", "", "", "", "1.2 or less", ""),
}
ASKED_MODULUS = "after 5 frames within 3 %, plain eyes"
