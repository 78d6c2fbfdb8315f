import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from scleraforce.cli.frames import _wall_line
from scleraforce.cli.main import run
from scleraforce.laboratory.phantom import plan_phantom, write_phantom
from scleraforce.laboratory.virtual_eye import PhantomEye, linear_sections
from scleraforce.study import parse_study

STUDY = parse_study("[mesh]\ndivisions = 6\nlevel = 0\n", "study")


def make_recording(path: Path) -> Path:
    eye = PhantomEye(
        id=path.name, thickness_m=0.7e-3, youngs_modulus_pa=0.3e6, iop_pa=266.0, gap_m=0.5e-3, polar_rad=0.6
    )
    write_phantom(path, plan_phantom(eye, [0.002, 0.02], STUDY, 1), linear_sections(eye, STUDY), STUDY)
    return path


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("recordings")
    return make_recording(folder / "eye-1"), make_recording(folder / "eye-2")


def segmented(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert run(["segment", *map(str, arguments), "--json"]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return json.loads(captured.out)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert run(["segment", *map(str, arguments)]) == 2
    message = capsys.readouterr().err.strip()
    assert message.startswith("error: ")
    assert "\n" not in message
    return message


def test_a_mask_has_the_size_and_the_name_of_its_frame(recordings, tmp_path: Path, capsys) -> None:
    frame = recordings[0] / "frames" / "0001.png"
    (entry,) = segmented(capsys, frame, "--out", tmp_path)["frames"]
    assert entry["file"] == str(frame)
    assert entry["usable"]
    assert entry["inner_found"]
    assert entry["thickness_um"] == pytest.approx(720, abs=60)
    mask = cv2.imread(str(tmp_path / "0001.png"), cv2.IMREAD_UNCHANGED)
    assert mask.shape == (512, 512)
    assert set(np.unique(mask)) == {0, 255}


def test_a_recording_is_all_its_frames_and_two_get_a_folder_each(recordings, tmp_path: Path, capsys) -> None:
    answer = segmented(capsys, *recordings, "--out", tmp_path, "--overlay")
    written = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.png"))
    names = [f"{frame}{kind}.png" for frame in ("0001", "0002") for kind in ("", ".overlay")]
    assert written == sorted(f"{eye}/{name}" for eye in ("eye-1", "eye-2") for name in names)
    assert len(answer["frames"]) == 4


def test_frames_of_two_recordings_get_a_folder_each(recordings, tmp_path: Path, capsys) -> None:
    segmented(capsys, *(eye / "frames" / "0001.png" for eye in recordings), "--out", tmp_path)
    assert (tmp_path / "eye-1" / "0001.png").is_file()
    assert (tmp_path / "eye-2" / "0001.png").is_file()


def test_two_frames_of_one_name_are_refused_before_anything_is_written(recordings, tmp_path: Path, capsys) -> None:
    frame = recordings[0] / "frames" / "0001.png"
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.png").write_bytes(frame.read_bytes())
    out = tmp_path / "out"
    assert "its mask would be" in refused(capsys, tmp_path / "a/x.png", tmp_path / "b/x.png", "--out", out)
    assert not out.exists()


def test_a_recording_states_the_scale_and_options_overrule_it(recordings, tmp_path: Path, capsys) -> None:
    frame = recordings[0] / "frames" / "0001.png"
    loose = tmp_path / "loose.png"
    loose.write_bytes(frame.read_bytes())
    stated = segmented(capsys, frame, "--out", tmp_path / "a")["frames"][0]["thickness_um"]
    default = segmented(capsys, loose, "--out", tmp_path / "b")["frames"][0]["thickness_um"]
    index = segmented(capsys, loose, "--out", tmp_path / "c", "--refractive-index", 1.38)["frames"][0]["thickness_um"]
    assert default == stated
    assert index == pytest.approx(stated / 1.38, rel=0.06)


def test_a_mask_that_is_there_and_differs_is_kept_unless_forced(recordings, tmp_path: Path, capsys) -> None:
    frame, mask = recordings[0] / "frames" / "0001.png", tmp_path / "0001.png"
    mask.write_bytes(b"mine")
    assert "--force" in refused(capsys, frame, "--out", tmp_path)
    assert mask.read_bytes() == b"mine"
    segmented(capsys, frame, "--out", tmp_path, "--force")
    segmented(capsys, frame, "--out", tmp_path)  # the same mask again is no conflict
    assert not list(tmp_path.glob(".*"))


def test_a_mask_never_replaces_a_frame(recordings, capsys) -> None:
    frame = recordings[0] / "frames" / "0001.png"
    before = frame.read_bytes()
    assert "would replace a frame" in refused(capsys, frame, "--out", frame.parent, "--force")
    assert frame.read_bytes() == before


def test_a_transposed_frame_gives_the_transposed_mask(recordings, tmp_path: Path, capsys) -> None:
    frame = recordings[0] / "frames" / "0001.png"
    turned = tmp_path / "turned.png"
    cv2.imwrite(str(turned), cv2.imread(str(frame), cv2.IMREAD_UNCHANGED).T)
    segmented(capsys, frame, "--out", tmp_path / "a")
    segmented(capsys, turned, "--out", tmp_path / "b", "--transpose")
    upright = cv2.imread(str(tmp_path / "a" / "0001.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "b" / "turned.png"), cv2.IMREAD_UNCHANGED).T, upright)


def test_a_frame_without_a_wall_is_told_and_gets_an_empty_mask(tmp_path: Path, capsys) -> None:
    dark = tmp_path / "dark.png"
    cv2.imwrite(str(dark), np.zeros((64, 80), np.uint16))
    (entry,) = segmented(capsys, dark, "--out", tmp_path / "out")["frames"]
    assert (entry["usable"], entry["thickness_um"]) == (False, None)
    assert "empty" in entry["reason"]
    assert not cv2.imread(str(tmp_path / "out" / "dark.png"), cv2.IMREAD_UNCHANGED).any()


def test_what_is_no_frame_is_one_line(tmp_path: Path, capsys) -> None:
    tiny = tmp_path / "tiny.png"
    cv2.imwrite(str(tiny), np.zeros((4, 4), np.uint8))
    assert "at least 16 x 16" in refused(capsys, tiny, "--out", tmp_path / "out")
    assert "No such file" in refused(capsys, tmp_path / "nothing.png", "--out", tmp_path / "out")
    assert "recording.toml" in refused(capsys, tmp_path, "--out", tmp_path / "out")


def test_a_scale_that_nobody_states_is_assumed_and_told(recordings, tmp_path: Path, capsys) -> None:
    frame, loose = recordings[0] / "frames" / "0001.png", tmp_path / "loose.png"
    loose.write_bytes(frame.read_bytes())
    stated, assumed = segmented(capsys, frame, loose, "--out", tmp_path / "a")["frames"]
    assert {size["source"] for size in stated["scale"].values()} == {"recording.toml"}
    assert {size["source"] for size in assumed["scale"].values()} == {"assumed"}
    assert run(["segment", str(frame), str(loose), "--out", str(tmp_path / "a")]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "note: of 1 of 2 frames nothing states the width (taken as 15 mm; give --width-mm)" in text
    assert run(["segment", str(frame), "--out", str(tmp_path / "a")]) == 0
    assert "note" not in capsys.readouterr().out


def test_only_what_nothing_states_of_a_scale_is_called_unknown(recordings, tmp_path: Path, capsys) -> None:
    loose = tmp_path / "loose.png"
    loose.write_bytes((recordings[0] / "frames" / "0001.png").read_bytes())
    sized = ("segment", str(loose), "--out", str(tmp_path / "a"), "--width-mm", "15", "--depth-mm", "8")
    assert run([*sized]) == 0
    (note,) = " ".join(capsys.readouterr().out.split()).split("note: ")[1:]
    assert "refractive index (taken as 1; give --refractive-index)" in note
    assert "width" not in note
    assert "depth" not in note
    assert run([*sized, "--force", "--refractive-index", "1.38"]) == 0
    assert "note: " not in capsys.readouterr().out


def test_a_thickness_is_printed_in_micrometres_and_only_if_it_is_known() -> None:
    entry = {"file": "a.png", "usable": True, "inner_found": False, "thickness_um": None}
    assert _wall_line(entry) == "a.png: inner boundary not seen; the mask ends 1 mm below the surface"
    assert _wall_line({**entry, "inner_found": True, "thickness_um": 650.4}) == "a.png: wall of 650 µm"


def test_a_bad_file_is_told_and_the_others_are_segmented(recordings, tmp_path: Path, capsys) -> None:
    frame, empty, long = recordings[0] / "frames" / "0001.png", tmp_path / "empty.png", tmp_path / ("x" * 300)
    empty.write_bytes(b"")
    given = [str(empty), str(frame), str(long)]
    assert run(["segment", *given, "--out", str(tmp_path / "out"), "--json"]) == 2
    told = capsys.readouterr()
    entries = json.loads(told.out)["frames"]
    assert [entry["file"] for entry in entries] == given
    assert [entry["usable"] for entry in entries] == [False, True, False]
    assert ["error" in entry for entry in entries] == [True, False, True]
    assert told.err.splitlines() == [
        f"error: {empty}: an empty file; give a PNG, TIFF, JPEG or a single DICOM image",
        f"error: {long}: File name too long",
    ]
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["0001.png"]


def test_what_was_done_to_a_frame_is_a_note(recordings, tmp_path: Path, capsys) -> None:
    pixels = cv2.imread(str(recordings[0] / "frames" / "0001.png"), cv2.IMREAD_UNCHANGED)
    tag = [(274, 3, 1, 4, True)]
    tifffile.imwrite(tmp_path / "a.tif", pixels[::-1].copy(), extratags=tag, metadata=None)
    options = ["--out", tmp_path / "masks", "--width-mm", 15, "--depth-mm", 4, "--refractive-index", 1]
    (turned,) = segmented(capsys, tmp_path / "a.tif", *options)["frames"]
    assert any("Orientation 4" in note for note in turned["notes"])
    cv2.imwrite(str(tmp_path / "b.png"), pixels)
    (upright,) = segmented(capsys, tmp_path / "b.png", *options)["frames"]
    assert upright["notes"] == []
    assert turned["thickness_um"] == upright["thickness_um"]
    assert run(["segment", str(tmp_path / "a.tif"), *map(str, options)]) == 0
    assert "Orientation 4" in " ".join(capsys.readouterr().out.split())
