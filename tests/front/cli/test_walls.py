"""Walls that users give: a mask in place of the wall that is found, and a recording's
corrected walls.
"""

from pathlib import Path
from shutil import copytree

import cv2
import numpy as np
import pytest
from analytic_frames import (
    GAP_M,
    KNOWN,
    KNOWN_EYE,
    MODULUS_PA,
    SCALE,
    SIZE,
    frame_under,
)
from scipy.ndimage import gaussian_filter1d
from small_models import force_reader
from small_recordings import write_places

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.calibration.seen_frames import CalibrationSettings, EyeFrames
from scleraforce.recordings.drawn_walls import RecordedWalls, write_wall
from scleraforce.records.frame import MASK_SD_ROWS, NOT_JUDGED
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import given_wall, segmented_boundaries

pytest.importorskip("torch")

FORCE_N = 0.020
FRAME = frame_under(FORCE_N)
FOUND = find_wall(FRAME, SCALE)
EYE = KNOWN_EYE | {"gap_m": GAP_M}


def test_the_mask_of_a_wall_gives_its_boundaries_and_thickness_back() -> None:
    wall = given_wall(FOUND.mask, SCALE)
    both = np.isfinite(wall.outer_row) & np.isfinite(FOUND.inner_row)
    assert both.mean() > 0.9
    assert np.abs(wall.outer_row - FOUND.outer_row)[both].max() <= 0.5
    assert np.abs(wall.inner_row - FOUND.inner_row)[both].max() <= 0.5
    assert wall.thickness_m == pytest.approx(FOUND.thickness_m, rel=0.01)
    assert (wall.mask == np.where(both, FOUND.mask, 0)).all()
    assert segmented_boundaries(wall, SCALE).sd_m == MASK_SD_ROWS * SCALE.depth_m


def test_columns_that_are_not_judged_interrupted_or_cut_off_by_the_top_are_left_out():
    mask = FOUND.mask.copy()
    at = np.flatnonzero(np.isfinite(FOUND.outer_row))[[100, 200, 300]]
    middle = int(FOUND.outer_row[at[1]]) + 20
    mask[:, at[0]] = np.where(mask[:, at[0]] == 0, NOT_JUDGED, mask[:, at[0]])
    mask[middle, at[1]] = 0
    mask[: middle + 1, at[2]] = 255
    wall = given_wall(mask, SCALE)
    assert np.isnan(wall.outer_row[at]).all()
    assert np.isfinite(wall.outer_row[at + 1]).all()
    assert not given_wall(np.zeros_like(mask), SCALE).usable
    narrow = np.where(np.arange(mask.shape[1]) < 120, FOUND.mask, 0)
    assert "of the imaged width" in given_wall(narrow, SCALE).reason


def test_intervals_hold_when_boundaries_are_off_as_far_as_the_mask_states() -> None:
    reader = force_reader()
    rng = np.random.default_rng(44)
    # errors of people follow a line; the fit takes 1.5 mm for independent
    smooth = 1.5e-3 / 2.5 / SCALE.lateral_m
    row = np.arange(len(FRAME))[:, None]
    held = 0
    widths = []

    for _ in range(40):
        off = gaussian_filter1d(
            rng.standard_normal((2, FRAME.shape[1])), smooth, axis=1, mode="wrap"
        )
        outer, inner = np.stack(
            [FOUND.outer_row, FOUND.inner_row]
        ) + 2.0 * off / off.std(axis=1, keepdims=True)
        mask = ((row >= outer) & (row < inner)).astype(np.uint8) * 255
        answer = reader.read(FRAME, SCALE, KNOWN, given_wall(mask, SCALE))
        by_fit = dict(answer.readings)["fit"]
        held += by_fit.interval_n[0] <= FORCE_N <= by_fit.interval_n[1]
        widths.append(by_fit.width_n)

    assert held >= 32
    assert (
        np.median(widths)
        > 1.2 * dict(reader.read(FRAME, SCALE, KNOWN).readings)["fit"].width_n
    )


def test_a_mask_is_read_in_place_of_the_wall_and_an_array_of_flags_is_a_mask() -> None:
    def read(frame, **given):
        return sf.read(force_reader(), frame, **given, **EYE, **SIZE)

    by_mask = read(FRAME, mask=FOUND.mask)
    alone = read(FOUND.mask > 0)
    assert by_mask.to_dict()["wall"] == alone.to_dict()["wall"] == "mask"
    assert by_mask.force_n == alone.force_n == pytest.approx(FORCE_N, rel=0.05)
    surer = read(sf.Frame(FRAME, mask=FOUND.mask > 0, mask_sd_rows=0.2))
    assert np.ptp(surer.interval_n) < np.ptp(by_mask.interval_n)
    assert read(FRAME).to_dict()["wall"] == "found"


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (FOUND.mask[:100], "mask: 100 x 512 pixels, the frame has 512 x 512"),
        (FRAME, "in a mask"),
        (FOUND.mask[None] > 0, "shape"),
        ([FOUND.mask, FOUND.mask], "2 for 1 frames"),
    ],
)
def test_what_is_not_a_mask_of_the_frame_is_refused(mask, words: str) -> None:
    with pytest.raises(InputError, match=words):
        sf.read(force_reader(), FRAME, mask=mask, **EYE, **SIZE)


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_places(tmp_path_factory.mktemp("places"))


@pytest.fixture
def corrected(places: dict[str, Path], tmp_path: Path) -> tuple[Path, Path]:
    """A model, and a recording whose frame 2 has a wall that was drawn 30 rows too
    low.
    """
    mine = copytree(places["mine"], tmp_path / "mine")
    frame = mine / "frames" / "2.png"
    mask = find_wall(sf.read_frame(frame), SCALE).mask
    write_wall(mine, "2.png", np.roll(mask, 30, axis=0), "me", "2026-11-28T00:00:00Z")
    return places["model"], mine


def test_every_step_uses_a_corrected_wall_and_says_so(
    corrected: tuple[Path, Path], shell
) -> None:
    model, recording = corrected
    frame = recording / "frames" / "2.png"
    given = f"--youngs-modulus-mpa {MODULUS_PA / 1e6} --globe open"
    (entry,) = shell.json("read", model, frame, given)["frames"]
    assert entry["wall"] == "corrected"
    assert "wall: corrected" in shell.text("read", model, frame, given)
    found = shell.json("evaluate", model, recording)
    walls = [one["wall"] for one in found["frames"][:4]]
    assert walls == ["found", "found", "corrected", "found"]
    assert any(note.endswith("wall: corrected in 1 frames") for note in found["notes"])
    wall = RecordedWalls(recording).wall("2.png")
    eye = {"youngs_modulus_pa": MODULUS_PA, "globe": "open"}
    by_mask = sf.read(model, frame, mask=wall, **eye)
    assert entry["predicted_force_mn"] == pytest.approx(by_mask.force_n * 1e3)


def test_a_calibration_uses_a_corrected_wall(corrected: tuple[Path, Path]) -> None:
    recording = sf.read_recording(corrected[1])
    settings = CalibrationSettings(sf.Study(), None, ("e",), False, None, FoundWalls())
    lowered, found = (
        EyeFrames(recording, settings, frozenset(), None).seen(number).wall
        for number in (2, 3)
    )
    assert (lowered.sd_m, found.sd_m) == (MASK_SD_ROWS * SCALE.depth_m, 0.0)
    assert [str(remark) for remark in recording.walls.remarks] == [
        "wall: corrected in 1 frames"
    ]
    mine = segmented_boundaries(
        find_wall(recording.frame(recording.frames[2]), SCALE), SCALE
    )
    assert np.nanmedian(lowered.depth_m - mine.depth_m) == pytest.approx(
        30 * SCALE.depth_m, abs=SCALE.depth_m
    )


def test_a_changed_frame_invalidates_its_wall_and_a_table_that_contradicts_is_refused(
    corrected: tuple[Path, Path], shell
) -> None:
    model, recording = corrected
    frame = recording / "frames" / "2.png"
    walls = recording / "walls.csv"
    before = frame.read_bytes()
    cv2.imwrite(str(frame), cv2.imread(str(frame), cv2.IMREAD_UNCHANGED) // 2 * 2)
    found = shell.json("evaluate", model, recording)
    assert {frame["wall"] for frame in found["frames"][:4]} == {"found"}
    words = "drawn on another version of 2.png; it is not used"
    assert any(words in note for note in found["notes"])
    frame.write_bytes(before)
    table = walls.read_text()

    for text, words in (
        (table.replace("2.png", "3.png"), "walls.csv: file: 2.png is missing"),
        (table.replace("author", "who"), "walls.csv:1: unknown column 'who'"),
        (table[:-20], "source_sha256: not a SHA-256 for 2.png"),
    ):
        walls.write_text(text)
        assert words in shell.refused("evaluate", model, recording)

    walls.unlink()  # then the walls are a user's own, of whatever the frames show
    assert shell.json("evaluate", model, recording)["frames"][2]["wall"] == "corrected"
    cv2.imwrite(str(recording / "walls" / "2.png"), np.zeros((9, 9), np.uint8))
    assert "9 x 9 pixels, the frame has 512 x 512" in shell.refused(
        "evaluate", model, recording
    )


def test_the_command_takes_a_mask_for_each_frame(
    places: dict[str, Path], tmp_path: Path, shell
) -> None:
    frame = places["mine"] / "frames" / "1.png"
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), find_wall(sf.read_frame(frame), SCALE).mask)
    words = ("read", places["model"], frame, f"--mask {mask} --globe open")
    assert shell.json(*words)["frames"][0]["wall"] == "mask"
    assert "2 for 1 frames" in shell.refused(*words, "--mask", mask)
