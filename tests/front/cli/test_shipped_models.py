"""MODEL is the name of a bundled model, whatever the current folder holds, or a
path.
"""

import json
import re
import shutil
from math import pi
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import recording_toml, write_one_frame

import scleraforce as sf
from scleraforce.records.model_folder import (
    LIBRARY_FILE,
    NETWORK_FILE,
    RECORD_FILE,
    SHIPPED,
    SHIPPED_LIVING,
    SHIPPED_READER,
    STUDY_FILE,
    read_folder,
    sha256,
)
from scleraforce.records.scan import PixelScale, Plane


@pytest.fixture
def frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A frame of a recording, in a folder of its own that is the current one."""
    monkeypatch.chdir(tmp_path)
    return write_one_frame(tmp_path / "session", recording_toml("mine"))


def test_the_bundled_reader_that_was_trained_for_an_eye_reads_it(
    frame: Path, shell
) -> None:
    living = "--youngs-modulus-mpa 1.8 --globe sealed --iop-mmhg 16"
    chosen, named = (
        shell.json("read", model, frame, living) for model in ("default", "living")
    )
    assert chosen["frames"] == named["frames"]
    assert "bundled reader living" in " ".join(chosen["notes"])
    assert "bundled reader" not in " ".join(named["notes"])
    recording = frame.parents[1]
    info = recording / "recording.toml"
    for iop_pa, is_living in ((270.0, False), (2133.0, True)):
        info.write_text(re.sub(r"iop_pa = .*", f"iop_pa = {iop_pa}", info.read_text()))
        notes = " ".join(shell.json("evaluate default", recording)["notes"])
        assert ("bundled reader living" in notes) == is_living
    both = shell.json("read living", frame, "--youngs-modulus-mpa 0.25 --iop-mmhg 2")
    assert "bundled reader default" in " ".join(both["notes"])
    (neither,) = shell.json("read default", frame, "--iop-mmhg 80")["frames"]
    assert neither["reason"].startswith("IOP 80 mmHg")


def test_both_bundled_readers_are_small_and_have_one_library() -> None:
    assert not (SHIPPED_LIVING / LIBRARY_FILE).exists()
    library = read_folder("default").files[LIBRARY_FILE]
    assert read_folder("living").files[LIBRARY_FILE] == library
    files = SHIPPED_READER.parent.rglob("*.*")
    assert sum(file.stat().st_size for file in files) < 24e6


KNOWN = "--youngs-modulus-mpa 0.25 --globe open"
FORGED_MN = [300.0, 301.0]


def write_forged(bundled: str, folder: str) -> None:
    """Copy a bundled model with other class bounds and hashes that match them."""
    shutil.copytree(SHIPPED[bundled], folder)
    if bundled == "living":
        shutil.copy(SHIPPED["default"] / LIBRARY_FILE, folder)

    study = Path(folder, STUDY_FILE)
    before = sha256(study.read_bytes())
    text, count = re.subn(
        r"^bounds_mn = .*", f"bounds_mn = {FORGED_MN}", study.read_text(), flags=re.M
    )
    assert count == 1
    study.write_text(text)

    network = Path(folder, NETWORK_FILE)
    stated = sha256(study.read_bytes()).encode()
    network.write_bytes(network.read_bytes().replace(before.encode(), stated))
    record = json.loads(Path(folder, RECORD_FILE).read_text())
    record["files"] |= {
        name: sha256(Path(folder, name).read_bytes()) for name in record["files"]
    }
    Path(folder, RECORD_FILE).write_text(json.dumps(record))


@pytest.fixture
def forged(frame: Path) -> Path:
    """A frame in a current folder with forged folders of all bundled names."""
    for bundled in SHIPPED:
        write_forged(bundled, bundled)
    shutil.copytree("paper", "none")
    return frame


@pytest.mark.parametrize("bundled", ["default", "living", "paper"])
def test_a_folder_of_a_bundled_name_is_read_by_its_path_alone(
    forged: Path, shell, bundled: str
) -> None:
    """Every answer says which model it is of, and which bounds its classes have."""
    found, own = (
        shell.json("read", model, forged, KNOWN) for model in (bundled, f"./{bundled}")
    )
    path = str(Path(bundled).absolute())
    assert [found["model"], own["model"]] == [bundled, path]
    assert [one["class_bounds_mn"] for one in (found, own)] == [[5, 30], FORGED_MN]

    suited = found["frames"][0]["model"]
    assert suited == ("default" if bundled == "living" else bundled)
    for result in (found, own):
        assert result["frames"][0]["class_bounds_mn"] == result["class_bounds_mn"]
    assert own["frames"][0]["model"] == path

    evaluated = shell.json("evaluate", bundled, forged.parents[1])
    assert (evaluated["model"], evaluated["class_bounds_mn"]) == (bundled, [5, 30])
    assert f"model: {bundled} (" in shell.run("read", bundled, forged)[0]
    assert "300 and 301 mN" in shell.run("read", f"./{bundled}", forged)[0]


@pytest.mark.usefixtures("forged")
def test_functions_and_commands_take_a_bundled_name_for_the_bundled_files(
    shell,
) -> None:
    for bundled in SHIPPED:
        for given in (bundled, Path(bundled)):
            assert read_folder(given).path == SHIPPED[bundled]
        assert read_folder(f"./{bundled}").path == Path(bundled).absolute()

    assert shell.json("show", "default")["class_bounds_mn"] == [5, 30]
    assert shell.json("show", "./default")["class_bounds_mn"] == FORGED_MN
    described = shell.run("show", "default")[0]
    assert described.startswith("default: model")

    def told(*words: str) -> str:
        return shell.refused("calibrate", "session", "--out", "new", *words)

    # the bundled classifier is refused by its kind, the one at a path by its path
    assert "shipped/paper: kind" in told("--intervals", "paper")
    assert f"{Path('paper').absolute()}: kind" in told("--intervals", "./paper")
    assert "none: kind: found 'classifier'" in shell.refused(
        "segment", "session", "--out", "masks", "--wall-finder", "./none"
    )
    shell.run("segment", "session", "--out", "masks", "--wall-finder", "none")


def test_an_answer_of_several_planes_carries_its_model() -> None:
    """So does the answer to a frame that cannot be read."""
    reader = sf.load_model("default")
    planes = (Plane("a", 0.0, 0.0), Plane("b", 0.0, pi / 2))
    black = np.zeros((512, 512), dtype=np.uint16)
    scale = PixelScale.of(reader.study.oct)
    for answer in (
        *reader.read_together([black, black], scale, planes=planes),
        reader.read(black, scale),
        reader.read_live(black, scale),
    ):
        assert (answer.model, answer.class_bounds_n) == ("default", (5e-3, 30e-3))
        assert answer.to_dict()["class_bounds_mn"] == [5, 30]


@pytest.mark.usefixtures("frame")
@pytest.mark.parametrize(
    "words",
    [
        "classify defualt session/frames/1.png",
        "segment session --wall-finder defualt --out masks",
    ],
)
def test_a_wrong_name_is_an_error_that_lists_the_bundled_ones(
    shell, words: str
) -> None:
    refused = shell.refused(words)
    bundled = "(default, living, paper, wall-finder)"
    assert refused.startswith(f"error: defualt: not a bundled model {bundled}")
    assert refused.endswith("a folder of your own is a path: ./defualt\n")
    assert [path.name for path in Path().iterdir()] == ["session"]
