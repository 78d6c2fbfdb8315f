"""`library`, `generate`, `train`: results, Ctrl-C that the same command repairs, full
disks, wall finders.
"""

import json
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from analytic_library import solve_analytic
from effects import SCLERAFORCE
from small_models import SMALL_STUDY
from small_recordings import calibration_text
from waiting import FUSE_S, LIMIT_S, wait_until

import scleraforce as sf
from scleraforce.base.errors import ModelError
from scleraforce.front.api.calibrating import library_for
from scleraforce.lab.scenes.drawn_scenes import draw_scene
from scleraforce.library import library_store
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER, check_place
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import ScenesStudy, format_study
from scleraforce.wall.find_wall import find_wall

STUDY = """
[mesh]
divisions = 4
[dataset]
contacts = 2
[[dataset.group]]
thickness_um = 500.0
images = 20
[library]
thickness_um = { min = 500.0, max = 800.0 }
thicknesses = 4
tensions = 4
tips = 4
max_tip_mm = 1.0
elements = 16
"""


@pytest.fixture
def study(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


@pytest.mark.slow
def test_generate_uses_the_calibrations_modulus_and_reports_its_speed(
    study, tmp_path, shell
):
    calibration = tmp_path / "calibration.json"
    calibration.write_text(calibration_text(0.31))
    out = f"generate --study {study} --out {tmp_path}/dataset.zarr"
    printed, noted = shell.run(out, "--json --calibration", calibration)
    answer = json.loads(printed)
    assert "E was fitted with finite-strain mechanics, the slices are linear" in noted
    assert answer["images"] == 20
    assert answer["images_per_second"] == pytest.approx(20 / answer["seconds"])
    dataset = sf.open_dataset(tmp_path / "dataset.zarr")
    assert dataset.youngs_modulus_pa == pytest.approx(0.31e6)
    assert dataset.attributes["calibration"]["path"] == str(calibration)
    assert "complete" in shell.refused(out)


@pytest.mark.parametrize(
    ("command", "work", "kept"),
    [
        ("generate", "lab.training.slice_dataset.generate_dataset", "7 of 20 images"),
        ("library", "library.library_store.build_library", "7 of 208 load paths"),
    ],
)
def test_an_interrupted_command_says_what_it_keeps_and_exits_with_130(
    study, tmp_path, shell, monkeypatch, command: str, work: str, kept: str
):
    def interrupted(*_, progress, **__):
        progress(7)
        raise KeyboardInterrupt

    monkeypatch.setattr(f"scleraforce.{work}", interrupted)
    said = shell.run(command, "--study", study, "--out", tmp_path / "d", code=130)[1]
    assert f"{kept} are kept; the same command completes them" in said


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_a_generate_that_was_stopped_is_completed_by_the_same_command(
    study, tmp_path, sent
):
    study.write_text(STUDY.replace("images = 20", "images = 3000"))
    out = tmp_path / "dataset.zarr"
    words = f"generate --study {study} --out {out} --json"
    line = [*SCLERAFORCE, *words.split()]
    process = subprocess.Popen(line, stderr=subprocess.PIPE, text=True)

    wait_until(lambda: any(out.glob("slices/c/*/0/0")) or process.poll() is not None)
    assert process.poll() is None
    process.send_signal(sent)
    message = process.communicate(timeout=FUSE_S)[1]
    assert process.returncode == (130 if sent == signal.SIGINT else -signal.SIGKILL)
    if sent == signal.SIGINT:
        assert "Traceback" not in message
        assert "of 3000 images are kept" in message

    kept = len(list(Path(out).glob("slices/c/*/0/0")))
    assert 0 < kept < 15
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL, timeout=LIMIT_S)
    assert sf.open_dataset(out).images == 3000


@pytest.mark.slow
def test_a_library_is_made_with_its_size_and_time(study, tmp_path, shell):
    out = tmp_path / "library.zarr"
    words = ("library --workers 1 --study", study, "--out", out)
    answer = shell.json(*words)
    assert answer["paths"] == 5 * 16 + 8 * 16
    assert answer["seconds"] > 0.0
    assert sf.open_library(out).force_ratio_tpd.shape == (4, 4, 4)
    assert "a complete library" in shell.refused(*words)


@pytest.mark.slow
def test_other_commands_find_the_library_in_the_users_cache(monkeypatch, tmp_path):
    def quiet(*_: object) -> Any:
        return nullcontext(lambda _: None)

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made, again = (
        library_for(sf.parse_study(STUDY), "finite-strain", quiet) for _ in range(2)
    )
    assert len(list((tmp_path / "scleraforce" / "libraries").glob("*.zarr"))) == 1
    assert (again.force_ratio_tpd == made.force_ratio_tpd).all()


LIBRARY = "[library]\nthicknesses = 4\ntensions = 4\ntips = 6\nelements = 16\n"
DATASET = (
    "[mesh]\ndivisions = 4\n[dataset]\ncontacts = 2\n[[dataset.group]]\nthickness_um ="
    " 500.0\nimages = 200\n"
)


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Let no file grow beyond `size` bytes, as on a full disk.

    Python writes no bytecode meanwhile: it would leave cut .pyc files of imported
    modules, and not notice.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.setenv("PYTHONDONTWRITEBYTECODE", "1")
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))

        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


# at the start, at a chunk
@pytest.mark.parametrize(("command", "size"), [("library", 200), ("generate", 3000)])
def test_a_store_on_a_full_disk_is_one_line(
    tmp_path: Path, shell, monkeypatch, command: str, size: int
) -> None:
    monkeypatch.setattr(library_store, "solve_path", solve_analytic)
    study = tmp_path / "study.toml"
    out = tmp_path / "out"
    study.write_text(LIBRARY + DATASET)

    with files_up_to(size):
        err = shell.refused(command, "--study", study, "--out", out, "--workers", 1)

    assert str(out) in err
    assert "File too large" in err


@pytest.mark.parametrize("place", ["file/model", "/proc/model"])
def test_a_model_that_cannot_be_written_is_refused_before_any_work(
    tmp_path: Path, place: str
) -> None:
    (tmp_path / "file").touch()
    # not even root may write there
    with pytest.raises(ModelError, match="cannot be made"):
        check_place(tmp_path / place)
    check_place(tmp_path / "new" / "model")
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("schema", "kind", "said"),
    [
        ("scleraforce-library-2", "classifier", "`train --kind reader` learns from it"),
        ("scleraforce-dataset-2", "reader", "`train --kind classifier`"),
    ],
)
def test_training_on_a_store_of_another_kind_names_the_option(
    tmp_path: Path, shell, schema: str, kind: str, said: str
) -> None:
    pytest.importorskip("torch")
    group = {"zarr_format": 3, "node_type": "group", "attributes": {"schema": schema}}
    (tmp_path / "zarr.json").write_text(json.dumps(group))
    given = f"--kind {kind} --out {tmp_path}/model"
    assert said in shell.refused("train", tmp_path, given)


SIZE = "--width-mm 10 --depth-mm 4"


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("frames") / "scene.png"
    cv2.imwrite(str(path), draw_scene(SMALL_STUDY.scenes, 5).frame)
    return path


def test_the_bundled_wall_finder_checks_the_wall_by_default_and_none_switches_it_off(
    tmp_path, shell
) -> None:
    """In a drawn scene in which it finds another wall than edge detection."""
    scene = draw_scene(ScenesStudy(seed=3), 6)
    path = tmp_path / "scene.png"
    cv2.imwrite(str(path), scene.frame)
    scale = PixelScale(
        lateral_m=10e-3 / scene.frame.shape[1], depth_m=4e-3 / len(scene.frame)
    )
    checked = find_wall(
        scene.frame, scale, finder=load_wall_finder(SHIPPED_WALL_FINDER)
    ).mask
    unchecked = find_wall(scene.frame, scale).mask
    assert not np.array_equal(checked, unchecked)

    for name, words, expected in (
        ("a", "", checked),
        ("b", f"--wall-finder {SHIPPED_WALL_FINDER}", checked),
        ("c", "--wall-finder none", unchecked),
    ):
        given = ("segment", path, SIZE, words, "--out", tmp_path / name)
        (entry,) = shell.json(*given)["frames"]
        assert np.array_equal(cv2.imread(entry["mask"], cv2.IMREAD_UNCHANGED), expected)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("data.zarr --kind wall-finder", "draws its scenes; leave DATASET out"),
        ("", "--kind classifier: DATASET is missing; only --kind wall-finder needs"),
        ("--kind raw-reader", "--kind raw-reader: DATASET is missing"),
        (
            "lib --kind raw-reader --search",
            "a raw-reader has the sizes of [raw_reader]",
        ),
        (
            "slices --scheduler tcp://127.0.0.1:9",
            "--scheduler: for --search and --kind wall-finder",
        ),
    ],
)
def test_options_that_exclude_each_other_are_refused(
    tmp_path, shell, options: str, said: str
) -> None:
    assert said in shell.refused("train", options, "--out", tmp_path / "model")
    assert not (tmp_path / "model").exists()


@pytest.mark.slow
def test_training_prints_its_results_and_its_model_segments(
    frame, tmp_path, shell
) -> None:
    study = tmp_path / "study.toml"
    model = tmp_path / "finder"
    study.write_text(format_study(SMALL_STUDY))
    answer = shell.json("train --kind wall-finder --study", study, "--out", model)
    assert (answer["kind"], answer["scenes"]) == ("wall-finder", 640)
    assert answer["dice_mean"] > 0.85
    given = ("segment", frame, SIZE, "--wall-finder", model, "--out", tmp_path)
    reason = shell.json(*given)["frames"][0]["reason"]
    # 640 scenes teach little
    assert reason == "" or "does not know where the wall ends" in reason
