"""Pictures that come back are known, whatever is burned into them; live ones are new, whatever stays in them."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from scleraforce.service.shown_pictures import ShownPictures

Pixels = NDArray[np.uint8] | NDArray[np.uint16]
SIZE = 512, 512
MOST = 50


def speckle(rng: np.random.Generator, size: tuple[int, int] = SIZE) -> NDArray[np.uint16]:
    """A dark background, tissue below it, on a logarithmic scale of 12 bits."""
    mean = np.where(np.arange(size[0]) < size[0] // 3, 1.0, 30.0)[:, None]
    level_db = 10.0 * np.log10(mean * rng.exponential(1.0, size) + 1e-3)
    return np.clip(4095 * (level_db + 10.0) / 45.0, 0, 4095).astype(np.uint16)


@cache
def speckled(count: int) -> tuple[NDArray[np.uint16], ...]:
    """So many pictures of a scanner, one like no other."""
    rng = np.random.default_rng(0)
    return tuple(speckle(rng) for _ in range(count))


def changed(rng: np.random.Generator, picture: NDArray[np.uint16], what: tuple[slice, slice]) -> NDArray[np.uint16]:
    other = picture.copy()
    other[what] = rng.integers(0, 4096, other[what].shape)
    return other


BURNED_IN = {
    "nothing": (slice(0), slice(0)),
    "a pixel": (slice(200, 201), slice(300, 301)),
    "a clock": (slice(4, 24), slice(350, 500)),
    "a row": (slice(256, 257), slice(None)),
    "a column": (slice(None), slice(100, 101)),
    "a strip": (slice(None), slice(400, 490)),
}


@pytest.mark.parametrize("pictures", [1, 2, 10, 50])
@pytest.mark.parametrize("what", BURNED_IN)
def test_old_pictures_in_turns_are_known_whatever_is_burned_in(what: str, pictures: int) -> None:
    rng = np.random.default_rng(1)
    shown, old = ShownPictures(MOST), speckled(MOST + 10)[:pictures]
    assert [shown.back(picture) for picture in old] == [0] * pictures
    again = [shown.back(changed(rng, picture, BURNED_IN[what])) for picture in (old * 10)[:10]]
    assert again == [pictures] * 10


def test_a_picture_that_is_older_than_those_remembered_is_new() -> None:
    shown, old = ShownPictures(MOST), speckled(MOST + 10)[: MOST + 1]
    assert [shown.back(picture) for picture in old * 2] == [0] * len(old) * 2


def bands(picture: Pixels) -> Pixels:
    picture = picture.copy()
    picture[:, :200] = picture[:, -200:] = 0
    return picture


LIVE: dict[str, Callable[[NDArray[np.uint16]], Pixels]] = {
    "12 bits": lambda picture: picture,
    "8 bits": lambda picture: (picture >> 4).astype(np.uint8),
    "4 bits": lambda picture: (picture >> 8).astype(np.uint8),
    "saturated": lambda picture: np.minimum(picture, np.uint16(1500)),
    "nearly black": lambda picture: np.where(picture > 2600, picture, np.uint16(0)),
    "black bands": bands,
    "of few pixels": lambda picture: picture[:24, :32],
}


@pytest.mark.parametrize("how", LIVE)
def test_live_pictures_are_new_whatever_stays_in_them(how: str) -> None:
    shown = ShownPictures(MOST)
    assert {shown.back(LIVE[how](picture)) for picture in speckled(MOST + 10)} == {0}


def test_a_phase_stable_scanner_whose_tissue_does_not_move_shows_new_pictures_by_its_noise() -> None:
    rng = np.random.default_rng(2)
    shown = ShownPictures(MOST)
    normal = lambda: rng.standard_normal((2, *SIZE), np.float32)  # noqa: E731 - real and imaginary part
    still = 10 ** (25.0 / 20.0) * normal() / np.sqrt(2.0)
    for _ in range(MOST + 10):
        real, imaginary = still + normal() / np.sqrt(2.0)
        level_db = 10.0 * np.log10(real**2 + imaginary**2)
        assert shown.back(np.clip(255 * level_db / 50.0, 0, 255).astype(np.uint8)) == 0


def test_pictures_of_one_grey_are_the_same_only_to_the_last_bit() -> None:
    shown, black = ShownPictures(MOST), np.zeros(SIZE, np.uint16)
    one = black.copy()
    one[100, 100] = 7
    assert [shown.back(picture) for picture in (black, one, black, black)] == [0, 0, 2, 1]


def test_another_size_or_depth_begins_anew() -> None:
    shown, picture = ShownPictures(MOST), speckle(np.random.default_rng(0))
    found = [shown.back(seen) for seen in (picture, picture[:-1], picture, (picture >> 4).astype(np.uint8))]
    assert found == [0, 0, 0, 0]
    assert shown.back(np.zeros((1, 1), np.uint8)) == 0
