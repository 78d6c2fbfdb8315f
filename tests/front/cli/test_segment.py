"""`segment`: masks of frames and recordings, the scale that is used, and bad files."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from effects import contents
from matplotlib.figure import Figure
from small_recordings import looked_at_frames

SIZE = "--width-mm 15 --depth-mm 4 --refractive-index 1"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("recordings")
    for name in ("eye-1", "eye-2"):
        looked_at_frames(folder / name, 2)
    return folder / "eye-1", folder / "eye-2"


@pytest.fixture
def frame(recordings: tuple[Path, Path]) -> Path:
    return recordings[0] / "frames" / "0001.png"


@pytest.fixture
def loose(frame: Path, tmp_path: Path) -> Path:
    """The same frame, in no recording."""
    (tmp_path / "loose.png").write_bytes(frame.read_bytes())
    return tmp_path / "loose.png"


def pixels(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def test_a_mask_has_the_size_and_the_name_of_its_frame_turned_or_not(
    frame, tmp_path: Path, shell
) -> None:
    (entry,) = shell.json("segment", frame, "--out", tmp_path)["frames"]
    assert (entry["file"], entry["usable"], entry["inner_found"]) == (
        str(frame),
        True,
        True,
    )
    assert entry["thickness_um"] == pytest.approx(600, abs=50)
    mask = pixels(tmp_path / "0001.png")
    assert mask.shape == pixels(frame).shape
    assert set(np.unique(mask)) == {0, 255}
    cv2.imwrite(str(tmp_path / "turned.png"), pixels(frame).T)
    shell.run("segment", tmp_path / "turned.png", "--transpose --out", tmp_path / "t")
    np.testing.assert_array_equal(pixels(tmp_path / "t" / "turned.png").T, mask)


def test_a_recording_means_all_its_frames_and_several_get_a_folder_each(
    recordings, tmp_path: Path, shell
) -> None:
    answer = shell.json("segment", *recordings, "--overlay --out", tmp_path)
    assert len(answer["frames"]) == 4
    for eye in ("eye-1", "eye-2"):
        names = [f"000{n}{kind}.png" for n in (1, 2) for kind in (".overlay", "")]
        assert sorted(path.name for path in (tmp_path / eye).iterdir()) == names
    single = tmp_path / "single"
    frames = (eye / "frames" / "0001.png" for eye in recordings)
    shell.run("segment", *frames, "--out", single)
    assert sorted(path.name for path in single.iterdir()) == ["eye-1", "eye-2"]


@pytest.mark.parametrize("name", ["loose.png", "loose.guess.png"])
def test_two_frames_of_one_name_are_refused_before_anything_is_written(
    loose, tmp_path: Path, shell, name: str
) -> None:
    (tmp_path / "b").mkdir()
    other = tmp_path / "b" / name
    other.write_bytes(loose.read_bytes())
    error = shell.refused("segment", loose, other, "--out", tmp_path / "out")
    assert "its mask would be" in error
    assert not (tmp_path / "out").exists()


def test_a_mask_that_is_there_and_differs_is_kept_unless_forced(
    frame, tmp_path: Path, shell
) -> None:
    mask = tmp_path / "0001.png"
    mask.write_bytes(b"mine")
    assert "--force" in shell.refused("segment", frame, "--out", tmp_path)
    assert mask.read_bytes() == b"mine"
    shell.run("segment", frame, "--out", tmp_path, "--force")
    shell.run("segment", frame, "--out", tmp_path)  # the same mask again
    assert [path.name for path in tmp_path.iterdir()] == ["0001.png"]
    before = frame.read_bytes()
    again = shell.refused("segment", frame, "--force --out", frame.parent)
    assert "would replace a frame" in again
    assert frame.read_bytes() == before


@pytest.fixture
def dark(tmp_path: Path) -> Path:
    """A frame without a wall."""
    cv2.imwrite(str(tmp_path / "dark.png"), np.zeros((64, 80), np.uint16))
    return tmp_path / "dark.png"


def test_a_frame_has_a_mask_or_a_guess_and_never_both(
    frame, dark, tmp_path: Path, shell
) -> None:
    out = tmp_path / "out"
    given = ("segment", dark, "--overlay --out", out)
    (entry,) = shell.json(*given)["frames"]
    assert (entry["usable"], entry["thickness_um"]) == (False, None)
    assert "empty" in entry["reason"]
    assert entry["mask"] == str(out / "dark.guess.png")
    assert not pixels(out / "dark.guess.png").any()
    lines = shell.run(*given, "--strict", code=3)[0].splitlines()
    assert lines[-1] == "1 of 1 frames are not usable"
    dark.write_bytes(frame.read_bytes())  # with a wall
    before = contents(out)
    assert "dark.guess.png: exists already" in shell.refused(*given)
    assert contents(out) == before
    shell.run("segment", dark, "--force --out", out)
    assert [path.name for path in out.iterdir()] == ["dark.png"]


def test_a_scale_that_nothing_states_is_assumed_and_noted(
    frame, loose, tmp_path: Path, shell
) -> None:
    given = ("segment", frame, loose, "--out", tmp_path / "a")
    stated, assumed = shell.json(*given)["frames"]
    for entry, source in ((stated, "recording.toml"), (assumed, "assumed")):
        assert {size["source"] for size in entry["scale"].values()} == {source}

    assert assumed["thickness_um"] == stated["thickness_um"]
    note = "note: of 1 of 2 frames nothing states the width (taken as 15 mm; give"
    assert f"{note} --width-mm)" in shell.text(*given)
    assert "note" not in shell.text("segment", frame, "--out", tmp_path / "a")
    sized = ("segment", loose, "--width-mm 15 --depth-mm 8 --out", tmp_path / "b")
    (note,) = shell.text(*sized).split("note: ")[1:]
    assert "refractive index (taken as 1; give --refractive-index)" in note
    assert not {"width", "depth"} & {*note.split()}


def test_a_sheet_shows_the_images_of_a_folder_and_needs_no_masks(
    frame, dark, tmp_path: Path, shell
) -> None:
    (tmp_path / "read.me").touch()
    sheet = tmp_path / "sheet.svg"
    answer = shell.json("segment", tmp_path, frame, "--sheet", sheet)
    assert [(one["file"], one["mask"]) for one in answer["frames"]] == [
        (str(dark), None),
        (str(frame), None),
    ]
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "dark.png",
        "read.me",
        "sheet.svg",
    ]
    before = sheet.read_bytes()
    sheet.rename(tmp_path / "before.svg")
    shell.run("segment", tmp_path, frame, "--sheet", sheet, "--out", tmp_path / "out")
    assert sheet.read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        "",
        "empty --sheet s.png",
        "--sheet s.gif",
        "--sheet nowhere/s.png",
        "--sheet loose.png --force",
        "--sheet out/loose.png --out out",
        "--sheet s.png --overlay",
        "--sheet s.png --wall-finder none",
    ],
)
def test_a_sheet_that_cannot_be_drawn_is_refused_before_the_work(
    words, loose, shell, monkeypatch
) -> None:
    monkeypatch.chdir(loose.parent)
    Path("empty").mkdir()
    Path("out").mkdir()
    monkeypatch.setattr("scleraforce.front.cli.frame_commands.each_of", pytest.fail)
    shell.refused("segment", loose.name, *words.split())


def test_ctrl_c_while_a_sheet_is_written_leaves_no_part_of_it(
    loose, dark, tmp_path: Path, shell, monkeypatch
) -> None:
    def interrupt(figure: Figure, *_: object) -> None:
        # the worst is first
        assert [axes.texts[0].get_text() for axes in figure.axes] == [
            "dark.png",
            "loose.png",
        ]
        raise KeyboardInterrupt

    monkeypatch.setattr("scleraforce.front.report.figure_files._encoded", interrupt)
    shell.run("segment", loose, dark, "--sheet", tmp_path / "sheet.png", code=130)
    assert sorted(tmp_path.iterdir()) == [dark, loose]


def test_a_change_of_the_pixels_is_a_note(frame, loose, tmp_path: Path, shell) -> None:
    tag = [(274, 3, 1, 4, True)]
    tifffile.imwrite(
        tmp_path / "a.tif", pixels(frame)[::-1].copy(), extratags=tag, metadata=None
    )
    given = ["segment", tmp_path / "a.tif", loose, "--out", tmp_path / "masks", SIZE]
    turned, upright = shell.json(*given)["frames"]
    assert any("Orientation 4" in note for note in turned["notes"])
    assert upright["notes"] == []
    assert turned["thickness_um"] == upright["thickness_um"]
    assert "Orientation 4" in shell.text(*given)
