"""MODEL may be the name of a bundled model; a folder of that name takes precedence."""

import re
import shutil
from pathlib import Path

import pytest
from analytic_frames import recording_toml, write_one_frame

from scleraforce.models import (
    FOLDER,
    LIBRARY_FILE,
    SHIPPED_LIVING,
    SHIPPED_READER,
    read_folder,
)


@pytest.fixture
def frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A frame of a recording, in a folder of its own that is the current one."""
    monkeypatch.chdir(tmp_path)
    return write_one_frame(tmp_path / "session", recording_toml("mine"))


def test_the_bundled_reader_is_small_and_reads_a_frame(frame: Path, shell) -> None:
    assert sum(path.stat().st_size for path in SHIPPED_READER.iterdir()) < 10_000_000
    (entry,) = shell.json(
        "read", "default", frame, "--youngs-modulus-mpa", 0.25, "--globe", "open"
    )["frames"]
    assert entry["usable"]
    assert (
        entry["interval_mn"][0] < entry["predicted_force_mn"] < entry["interval_mn"][1]
    )


def test_the_bundled_reader_that_was_trained_for_an_eye_reads_it(
    frame: Path, shell
) -> None:
    eye = ("--youngs-modulus-mpa", 1.8, "--globe", "sealed", "--iop-mmhg")
    chosen, named = (
        shell.json("read", model, frame, *eye, 16) for model in ("default", "living")
    )
    assert chosen["frames"] == named["frames"]
    assert "bundled reader living" in " ".join(chosen["notes"])
    assert not any("bundled reader" in note for note in named["notes"])
    found = shell.json("evaluate", "default", frame.parents[1])
    assert not any("bundled reader" in note for note in found["notes"])
    info = frame.parents[1] / "recording.toml"
    info.write_text(re.sub(r"iop_pa = .*", "iop_pa = 2133.0", info.read_text()))
    assert "bundled reader living" in " ".join(
        shell.json("evaluate", "default", frame.parents[1])["notes"]
    )
    both = shell.json(
        "read", "living", frame, "--youngs-modulus-mpa", 0.25, "--iop-mmhg", 2
    )
    assert "bundled reader default" in " ".join(both["notes"])
    (neither,) = shell.json("read", "default", frame, "--iop-mmhg", 80)["frames"]
    assert neither["reason"].startswith("IOP 80 mmHg")


def test_both_bundled_readers_have_one_library() -> None:
    assert not (SHIPPED_LIVING / LIBRARY_FILE).exists()
    assert (
        read_folder(Path("living")).files[LIBRARY_FILE]
        == read_folder(Path("default")).files[LIBRARY_FILE]
    )
    assert (
        sum(file.stat().st_size for file in FOLDER.rglob("*") if file.is_file()) < 24e6
    )


def test_a_folder_of_the_name_takes_precedence(frame: Path, shell) -> None:
    shutil.copytree(SHIPPED_READER, "default")
    (Path("default") / "card.md").write_text("changed")
    assert "default/card.md: SHA-256" in shell.refused("read", "default", frame)


def test_a_wrong_name_is_an_error_that_lists_the_bundled_ones(
    frame: Path, shell
) -> None:
    bundled = "(default, living, paper, wall-finder)"
    for arguments in (
        ("classify", "defualt", frame),
        ("evaluate", "defualt", frame.parents[1]),
        ("monitor", "defualt"),
        ("calibrate", frame.parents[1], "--intervals", "defualt", "--out", "new"),
        ("segment", frame, "--wall-finder", "defualt", "--out", "masks"),
    ):
        refused = shell.refused(*arguments)
        assert refused.startswith(
            f"error: defualt: no such folder, and not a bundled model {bundled}"
        )
        assert sorted(path.name for path in frame.parents[2].iterdir()) == ["session"]
