"""MODEL may be the name of a model that ships with the package; a folder of that name wins."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from analytic_frames import image, recording_toml, tip_of, wall_section

import scleraforce as sf
from scleraforce.cli.main import run
from scleraforce.errors import ModelError
from scleraforce.models import (
    SHIPPED,
    SHIPPED_PAPER,
    SHIPPED_READER,
    SHIPPED_WALL_FINDER,
    model_folder,
    read_folder,
)

NOT_FOR_A_FRAME = (
    "scipy.linalg", "scipy.sparse", "scipy.special", "matplotlib", "zarr", "torch",
    "onnx", "pydicom", "tifffile", "meshio", "pandas",
)  # fmt: skip


@pytest.fixture
def frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A frame of a recording, in a folder of its own that is the current one."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "session" / "frames" / "1.png"
    path.parent.mkdir(parents=True)
    (path.parents[1] / "recording.toml").write_text(recording_toml("mine"))
    cv2.imwrite(str(path), image(wall_section(tip_of(0.020))))
    return path


def test_every_shipped_name_is_a_whole_model_folder() -> None:
    assert set(SHIPPED) == {"default", "paper", "wall-finder"}
    assert sf.load_model("default").path == SHIPPED_READER
    assert sf.load_model("paper").path == SHIPPED_PAPER
    assert read_folder(Path("wall-finder")).path == SHIPPED_WALL_FINDER


def test_the_reader_takes_less_than_10_mb_of_the_package() -> None:
    assert sum(path.stat().st_size for path in SHIPPED_READER.iterdir()) < 10_000_000


def test_a_frame_is_read_with_the_shipped_reader(frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["classify", "default", str(frame), "--youngs-modulus-mpa", "0.25", "--globe", "open", "--json"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["frames"]
    assert entry["usable"]
    assert entry["interval_mn"][0] < entry["predicted_force_mn"] < entry["interval_mn"][1]


def test_a_folder_of_the_name_wins(frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(SHIPPED_READER, "default")
    assert model_folder(Path("default")) == Path("default")
    (Path("default") / "card.md").write_text("changed")
    assert run(["classify", "default", str(frame)]) == 2
    assert "default/card.md: SHA-256" in capsys.readouterr().err


def test_a_wrong_name_is_an_error_that_lists_the_bundled_ones(frame: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (
        ("classify", "defualt", frame),
        ("evaluate", "defualt", frame.parents[1]),
        ("monitor", "defualt"),
        ("calibrate", frame.parents[1], "--intervals", "defualt", "--out", "new"),
        ("segment", frame, "--wall-finder", "defualt", "--out", "masks"),
    ):
        check_wrong_name(arguments, capsys)
        assert sorted(path.name for path in frame.parents[2].iterdir()) == ["session"]


def check_wrong_name(arguments: tuple[str | Path, ...], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(list(map(str, arguments))) == 2
    told = capsys.readouterr()
    assert told.err.startswith(
        "error: defualt: no such folder, and no model that ships with scleraforce (default, paper, wall-finder)"
    )
    assert len(told.err.splitlines()) == 1


def test_a_shipped_model_of_another_kind_is_refused() -> None:
    with pytest.raises(ModelError, match="found 'wall-finder', classifier, reader or raw-reader is needed here"):
        sf.load_model("wall-finder")


def test_reading_a_frame_imports_nothing_that_it_does_not_need(frame: Path) -> None:
    words = ["classify", "default", str(frame), "--youngs-modulus-mpa", "0.25"]
    script = (
        f"import sys; from scleraforce.cli.main import run; code = run({words!r})\n"
        f"print(*[name for name in {NOT_FOR_A_FRAME!r} if name in sys.modules], file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "mN (90 %:" in done.stdout
    assert done.stderr.split() == []
