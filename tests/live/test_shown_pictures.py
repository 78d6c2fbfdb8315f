"""Pictures that come back are known, whatever is burned into them; live ones are new,
whatever stays in them.
"""

import subprocess
import sys
from collections.abc import Sequence
from functools import cache

import numpy as np
import plain_pictures
import pytest
from numpy.typing import NDArray

from scleraforce.live import picture_signs, repeated_pictures
from scleraforce.live.repeated_pictures import ShownPictures

Pixels = NDArray[np.uint8] | NDArray[np.uint16]
SIZE = 512, 512
MOST = 50


def speckle(
    rng: np.random.Generator, size: tuple[int, int] = SIZE
) -> NDArray[np.uint16]:
    """A dark background, tissue below it, on a logarithmic scale of 12 bits."""
    mean = np.where(np.arange(size[0]) < size[0] // 3, 1.0, 30.0)[:, None]
    level_db = 10.0 * np.log10(mean * rng.exponential(1.0, size) + 1e-3)
    return np.clip(4095 * (level_db + 10.0) / 45.0, 0, 4095).astype(np.uint16)


@cache
def speckled(count: int) -> tuple[NDArray[np.uint16], ...]:
    """Return pictures of a scanner, each different."""
    rng = np.random.default_rng(0)
    return tuple(speckle(rng) for _ in range(count))


def changed(
    rng: np.random.Generator, picture: NDArray[np.uint16], what: tuple[slice, slice]
) -> NDArray[np.uint16]:
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
def test_old_pictures_in_turns_are_known_whatever_is_burned_in(what, pictures):
    rng = np.random.default_rng(1)
    shown = ShownPictures(MOST)
    old = speckled(MOST + 10)[:pictures]
    assert [shown.back(picture) for picture in old] == [0] * pictures
    again = [
        shown.back(changed(rng, picture, BURNED_IN[what]))
        for picture in (old * 10)[:10]
    ]
    assert again == [pictures] * 10


def test_a_picture_that_is_older_than_those_remembered_is_new():
    shown = ShownPictures(MOST)
    old = speckled(MOST + 10)[: MOST + 1]
    assert [shown.back(picture) for picture in old * 2] == [0] * len(old) * 2


def bands(picture: Pixels) -> Pixels:
    picture = picture.copy()
    picture[:, :200] = picture[:, -200:] = 0
    return picture


LIVE = {
    "12 bits": lambda picture: picture,
    "8 bits": lambda picture: (picture >> 4).astype(np.uint8),
    "4 bits": lambda picture: (picture >> 8).astype(np.uint8),
    "saturated": lambda picture: np.minimum(picture, np.uint16(1500)),
    "nearly black": lambda picture: np.where(picture > 2600, picture, np.uint16(0)),
    "black bands": bands,
    "of few pixels": lambda picture: picture[:24, :32],
}


@pytest.mark.parametrize("how", LIVE)
def test_live_pictures_are_new_whatever_stays_in_them(how):
    shown = ShownPictures(MOST)
    backs = {shown.back(LIVE[how](picture)) for picture in speckled(MOST + 10)}
    assert backs == {0}


def normal(rng: np.random.Generator) -> NDArray[np.complex64]:
    pairs = rng.standard_normal((*SIZE, 2), dtype=np.float32) / np.float32(2.0**0.5)
    return pairs.view(np.complex64)[..., 0]


def displayed(
    level_db: NDArray[np.float32], top: int, least_db: float, range_db: float
) -> Pixels:
    """A logarithmic display, of 8 bits or more."""
    counts = np.clip(top * (level_db - least_db) / range_db, 0, top)
    return counts.astype(np.uint8 if top < 256 else np.uint16)


DISPLAYS = {
    "8 bits": lambda level_db: displayed(level_db, 255, -10.0, 50.0),
    "12 bits": lambda level_db: displayed(level_db, 4095, -10.0, 50.0),
    "linear": lambda level_db: displayed(10 ** (level_db / 10), 4095, 0.0, 1000.0),
    "black where there is no tissue": lambda level_db: displayed(
        level_db, 255, 8.0, 40.0
    ),
}


@pytest.mark.parametrize("snr_db", [15.0, 30.0])
def test_tissue_at_rest_whose_speckle_stays_is_new_by_the_noise_around_it(
    snr_db,
):
    rng = np.random.default_rng(2)
    shown = {display: ShownPictures(MOST) for display in DISPLAYS}
    rows = np.arange(SIZE[0])[:, None]
    level = np.float32(10 ** (snr_db / 20.0)) * ((rows > 100) & (rows < 350))
    still = level * normal(rng)

    for _ in range(MOST + 10):
        level_db = 20.0 * np.log10(abs(still + normal(rng)))
        backs = {
            display: shown[display].back(DISPLAYS[display](level_db))
            for display in DISPLAYS
        }
        assert backs == dict.fromkeys(DISPLAYS, 0)


def first_alarm(before: Sequence[Pixels], old: Sequence[Pixels]) -> int | None:
    """Return the number of the first old picture at which the third in a row, or the
    second return, is noticed.
    """
    shown = ShownPictures(MOST)
    backs = [shown.back(picture) for picture in (*before, *old)]
    assert backs[: len(before)] == [0] * len(before)
    in_row = returns = 0

    for number, back in enumerate(backs[len(before) :], start=1):
        in_row = in_row + 1 if back == 1 else 0
        returns = returns + (back > 1)
        if in_row == 2 or (back > 1 and returns == 2):
            return number

    return None


def as_counts(values: NDArray[np.float64]) -> NDArray[np.uint16]:
    return np.clip(np.rint(values), 0, 65535).astype(np.uint16)


def part_of_the_first(
    live: Sequence[NDArray[np.uint16]], part: tuple[slice, slice]
) -> list[NDArray[np.uint16]]:
    pictures = [picture.copy() for picture in live]
    for picture in pictures:
        picture[part] = live[0][part]
    return pictures


def filtered(
    live: Sequence[NDArray[np.uint16]], kept: float
) -> list[NDArray[np.uint16]]:
    mean = live[0].astype(np.float64)
    pictures = []
    for picture in live:
        mean = kept * mean + (1 - kept) * picture
        pictures.append(as_counts(mean))
    return pictures


Live = Sequence[NDArray[np.uint16]]
OLD = {
    "the dark level moves": lambda live, _: [live[0] + np.uint16(n) for n in range(20)],
    "the gain grows": lambda live, _: [
        as_counts(live[0] * (1 + 0.005 * n)) for n in range(20)
    ],
    "the contrast changes": lambda live, _: [
        as_counts(4095 * (live[0] / 4095) ** (1 + n / 100)) for n in range(20)
    ],
    "16 and 8 bits in turns": lambda live, _: [
        live[0] if n % 2 else (live[0] >> 4).astype(np.uint8) for n in range(20)
    ],
    "it moves by a row": lambda live, _: [
        np.roll(live[0], n, axis=0) for n in range(20)
    ],
    "it moves by a column": lambda live, _: [
        np.roll(live[0], -n, axis=1) for n in range(20)
    ],
    "it jitters": lambda live, rng: [
        np.roll(live[0], tuple(rng.integers(-1, 2, 2)), (0, 1)) for _ in range(20)
    ],
    "three in turns, the dark level moves": lambda live, _: [
        live[n % 3] + np.uint16(n) for n in range(20)
    ],
    "fresh noise on it": lambda live, rng: [
        as_counts(live[0] + rng.normal(0, 50, SIZE)) for _ in range(20)
    ],
    "its left half": lambda live, _: part_of_the_first(live, (slice(None), slice(256))),
    "its middle half": lambda live, _: part_of_the_first(
        live, (slice(None), slice(128, 384))
    ),
    "its lower half": lambda live, _: part_of_the_first(
        live, (slice(256, None), slice(None))
    ),
    "80 % of it": lambda live, _: [
        as_counts(0.8 * live[0] + 0.2 * seen) for seen in live
    ],
    "60 % of it": lambda live, _: [
        as_counts(0.6 * live[0] + 0.4 * seen) for seen in live
    ],
    "a filter that keeps 80 %": lambda live, _: filtered(live, 0.8),
}


@pytest.mark.parametrize("what", OLD)
def test_an_old_picture_is_known_whatever_is_done_to_it(what):
    live = speckled(MOST + 10)
    found = first_alarm(live[:30], OLD[what](live[30:50], np.random.default_rng(4)))
    assert found is not None
    assert found <= 6


@pytest.mark.parametrize("share", [0.5, 0.25])
def test_a_filter_that_keeps_half_of_the_last_picture_or_less_shows_new_ones(
    share,
):
    assert first_alarm((), filtered(speckled(MOST + 10), share)[10:]) is None


def test_pictures_of_one_grey_are_the_same_only_to_the_last_bit():
    shown = ShownPictures(MOST)
    black = np.zeros(SIZE, np.uint16)
    one = black.copy()
    one[100, 100] = 7
    assert [shown.back(picture) for picture in (black, one, black, black)] == [
        0,
        0,
        2,
        1,
    ]


def test_another_size_begins_anew_and_another_depth_does_not():
    shown = ShownPictures(MOST)
    picture = speckle(np.random.default_rng(0))
    found = [
        shown.back(seen)
        for seen in (picture, picture[:-1], picture, (picture >> 4).astype(np.uint8))
    ]
    assert found == [0, 0, 0, 1]
    assert shown.back(np.zeros((1, 1), np.uint8)) == 0


@pytest.mark.parametrize("size", [(512, 512), (64, 700), (20, 40), (300, 900)])
def test_loops_know_the_same_pictures_as_whole_arrays(
    size: tuple[int, int], monkeypatch: pytest.MonkeyPatch
):
    """New, old, moved and mixed pictures, few grey levels, of 16 and 8 bits."""
    rng = np.random.default_rng(3)
    kept = [speckle(rng, size)]
    pictures = list[Pixels]()

    for _ in range(60):
        old = kept[rng.integers(len(kept))]
        new = speckle(rng, size)
        part = np.arange(size[1]) < size[1] * rng.uniform(0.2, 0.9)
        kinds: list[Pixels] = [
            new,
            old,
            np.roll(kept[-1], tuple(rng.integers(-1, 2, 2)), (0, 1)),
            (0.8 * old + 0.2 * new).astype(np.uint16),
            np.where(part, old, new),
            (new > 3000).astype(np.uint16),
            np.full(size, rng.integers(3), dtype=np.uint16),
        ]
        picture = kinds[rng.integers(len(kinds))]
        if rng.random() < 0.2:
            picture = (picture >> 4).astype(np.uint8)

        pictures.append(picture)
        kept.append(picture.astype(np.uint16))

    def answers() -> list[int]:
        shown = ShownPictures(MOST)
        return [shown.back(picture) for picture in pictures]

    by_loops = answers()
    assert 10 < np.count_nonzero(by_loops) < 50
    for name in ("read_signs", "alike_pictures"):
        monkeypatch.setattr(repeated_pictures, name, getattr(plain_pictures, name))
    assert by_loops == answers()


def test_pictures_are_alike_for_loops_where_they_are_for_whole_arrays():
    """Words whose halves agree by any share, so that each limit is met from both sides:
    half a picture may be a copy while the other half is its negative.
    """
    rng = np.random.default_rng(5)
    blocks = 64
    left = np.arange(blocks) < blocks // 2
    parts = np.stack([np.ones(blocks, dtype=np.bool_), left, ~left])
    limits = parts, np.array([0.6, 0.8, 0.8]), np.array([43.0, 22.0, 22.0])
    found = list[bool]()

    for _ in range(400):
        differs, rises = rng.integers(0, 2**32, (2, blocks), dtype=np.uint64)
        differs[rng.random(blocks) < rng.choice([0.0, 0.2, 0.5])] = 0  # no texture
        share = np.where(left, *rng.choice([0.0, 0.03, 0.3, 0.6, 0.85, 1.0], 2))
        flipped = rng.random((blocks, 32)) < share[:, None]
        others = rises ^ (flipped @ (np.uint64(1) << np.arange(32, dtype=np.uint64)))
        words = others[None], differs[None], rises, differs, *limits
        (alike,) = picture_signs.alike_pictures(*words)
        assert [alike] == plain_pictures.alike_pictures(*words).tolist()
        found.append(bool(alike))

    assert 50 < sum(found) < 350


def test_nothing_is_left_to_compile_once_the_pictures_are_warm():
    """A compilation in the loop would last for seconds, and the watchdog end it."""
    code = """
from scleraforce.live import picture_signs
from scleraforce.live.repeated_pictures import warm_pictures
loops = picture_signs.read_signs, picture_signs.alike_pictures
warm_pictures()
print([len(one.signatures) for one in loops])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    # pictures of 8 and 16 bits are looked at, and one kind of words compared
    assert done.stdout.strip() == "[2, 1]"
