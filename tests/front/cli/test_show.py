"""`show` recognises each kind of thing, describes and draws it; `export` writes it for
other programs.
"""

import csv
import json
import os
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import pytest
from analytic_frames import SMALL_LIBRARY
from effects import contents
from foreign_files import with_log
from scanned_planes import write_moments
from small_models import write_fixed_reader
from small_monitor import READ_ENTRY, verdict
from small_recordings import (
    calibration_of_a_sealed_eye,
    write_notebook_folder,
    write_small_recording,
)

from scleraforce.live.companions.decision_log import DecisionLog
from scleraforce.live.companions.process_messages import Entry
from scleraforce.records.calibration_file import write_calibration


def decisions(count: int = 30) -> list[Entry]:
    """A needle that pushes by 1 mN more in each frame, 10 ms apart; the monitor
    withdraws at the 21st.
    """
    return [
        replace(
            READ_ENTRY,
            number=n,
            frame=n,
            at_s=n / 100,
            time_s=1.8e9 + n / 100,
            verdict=verdict(float(n), (n - 1.0, n + 1.0)),
            state="WITHDRAW" if n > 20 else "WATCHING",
            cause="BOUND" if n > 20 else None,
        )
        for n in range(1, count + 1)
    ]


def write_log(folder: Path) -> Path:
    log = DecisionLog(folder / "log")
    log.append({"kind": "note", "text": "robot came"})
    for entry in decisions():
        log.append({"kind": "entry", "entry": entry.as_json()})
    log.close()
    return folder


def write_push(path: Path) -> None:
    """Write a force log: no contact for a second, then 1 mN more every 10 ms; in
    contact the sensor's z is negative.
    """
    samples = [(n / 200, -0.1 * max(n / 200 - 1.0, 0.0)) for n in range(400)]
    rows = [f"{time_s},0,0,{force_n},0,0,0" for time_s, force_n in samples]
    path.write_text(
        "\n".join(["time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm", *rows]) + "\n"
    )


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one thing of each kind that is quickly made."""
    folder = tmp_path_factory.mktemp("things")
    study = (
        "[eye]\nradius_mm = 11.0\n[dataset]\nframing_depth_mm = { min = 0.2, max ="
        " 0.6 }\n"
    )
    (folder / "study.toml").write_text(study)
    write_small_recording(folder / "eye")
    write_push(folder / "eye" / "forces.csv")
    write_calibration(calibration_of_a_sealed_eye().to_dict(), folder / "modulus.json")
    write_log(folder / "box")
    write_fixed_reader(folder / "reader", SMALL_LIBRARY, [0.0, 1.0] + [0.0] * 14)

    return folder


@pytest.fixture
def here(things: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(things)
    return things


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("study.toml", "study", "eye.radius_mm = 11.0 (the paper's: 12.0)"),
        (".", "study", "dataset.framing_depth_mm = 0.2 to 0.6 (the paper's: [0.0])"),
        ("eye", "recording", "40 in 0.39 s, 32 x 24 pixels of 12 bits"),
        ("modulus.json", "calibration", "mine: thickness 651 ± 12 µm"),
        ("box", "decision log", "1 BOUND"),
        ("box/log", "decision log", "30, 30 of them on a frame"),
        ("box/log/decisions-000001.jsonl", "decision log", "1.0 to 30.0 mN"),
        ("reader", "model", "reader, answers with its fit"),
        ("default", "model", "library.npz"),
        ("wall-finder", "model", "wall-finder"),
        ("reader/library.npz", "library", "radius 12 mm, 350 to 900 µm thick"),
    ],
)
def test_each_thing_is_recognised_described_within_80_columns_and_drawn(
    tmp_path: Path, shell, name: str, kind: str, words: str
) -> None:
    first, *lines = shell.run("show", name)[0].splitlines()
    assert first == f"{name}: {kind}"
    assert words in "\n".join(lines)
    assert max(map(len, lines)) <= 80
    plot = tmp_path / "plot.svg"
    said = shell.json("show", name, "--plot", plot)
    assert (said["kind"], said["path"]) == (kind, name)
    assert plot.read_bytes().startswith(b"<?xml")


def test_the_frames_of_a_recording_have_their_forces_unless_the_log_lacks_their_time(
    things, tmp_path, shell
) -> None:
    frames = shell.json("show", things / "eye")["frames"]
    assert [frame["file"] for frame in frames] == [f"{n:04d}.png" for n in range(40)]
    for n, target in {15: 1, 20: 1, 36: 2}.items():
        assert frames[n]["measured_force_mn"] == pytest.approx(n, abs=0.5)
        assert frames[n]["target"] == target

    eye = copytree(things / "eye", tmp_path / "eye")
    table = (eye / "frames.csv").read_text()
    (eye / "frames.csv").write_text(table.replace("0000.png,1.0000", "0000.png,-9.0"))
    shown = shell.json("show", eye)
    assert shown["no_labels"] is None
    lacks = [frame["target"] is None for frame in shown["frames"]]
    assert lacks == [True] + [False] * 39
    assert "force samples within" in shown["frames"][0]["excluded"]
    assert "1 of 40 frames have no label" in shell.text("show", eye)

    (eye / "frames.csv").write_text(table.replace("png,1.", "png,1001."))
    shown = shell.json("show", eye, "--plot", tmp_path / "eye.png")
    assert "the clocks do not overlap" in shown["no_labels"]
    assert {frame["target"] for frame in shown["frames"]} == {None}


def test_a_log_has_each_withdrawal_once_and_the_number_of_its_torn_parts(
    things: Path, tmp_path: Path, shell
) -> None:
    said = shell.json("show", things / "box")
    assert [(entry["number"], entry["cause"]) for entry in said["withdrawals"]] == [
        (21, "BOUND")
    ]
    assert (said["decisions"], said["notes"], said["torn"]) == (30, ["robot came"], 0)

    with (write_log(tmp_path) / "log" / "decisions-000001.jsonl").open("a") as file:
        file.write('{"kind": "en')

    assert shell.json("show", tmp_path)["torn"] == 1
    os.mkfifo(tmp_path / "log" / "decisions-000002.jsonl")  # which is not waited for
    assert "decisions-000002.jsonl: not a regular file" in shell.refused(
        "show", tmp_path
    )
    wrong = DecisionLog(tmp_path / "wrong")
    wrong.append({"kind": "entry", "entry": {"class": 1}})  # whole, and no decision
    wrong.close()
    assert "decisions-000001.jsonl: byte" in shell.refused("show", tmp_path / "wrong")


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ("nowhere", "nowhere: no such file or folder; give a study"),
        ("empty", "empty: give a study, library, data set, model (or a bundled one"),
        ("eye/recording.toml", "a part of a recording; give its folder"),
        ("eye/frames/0000.png", "0000.png: give a study"),
        ("eye --model nowhere", "nowhere: not a bundled model"),
        ("eye --model ./nowhere", "nowhere: no such folder; give one, or a bundled"),
        ("eye --model wall-finder", "wall_finder: kind: found 'wall-finder'"),
        ("study.toml --model default", "--model: study.toml is a study; a model reads"),
        ("eye --plot a.jpg", "a.jpg: give a name that ends in .png, .svg, .pdf"),
        ("eye --plot old.svg", "old.svg: exists already"),
        ("eye --plot new.svg --model nowhere", "nowhere: not a bundled model"),
    ],
)
def test_wrong_input_is_one_line_and_writes_nothing(
    here: Path, shell, words: str, fault: str
) -> None:
    Path("empty").mkdir(exist_ok=True)
    Path("old.svg").write_text("old")
    before = contents(here)
    assert fault in shell.refused("show", words)
    assert contents(here) == before


@pytest.mark.slow
def test_stores_are_recognised_by_their_content(tmp_path: Path, shell) -> None:
    write_notebook_folder(tmp_path)
    for name, kind, words in (
        ("dataset", "data set", "200, "),
        ("responses", "library", "4 thicknesses x 4 tensions"),
    ):
        said = shell.text("show", tmp_path / name, "--plot", tmp_path / f"{name}.png")
        assert said.startswith(f"{tmp_path / name}: {kind}")
        assert words in said


ANSWERS = {
    "frames": [
        {
            "file": "0001.png",
            "recording": "r",
            "predicted_force_mn": 4.5,
            "interval_mn": [3.0, 6.0],
        }
    ]
}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    (tmp_path / "answers.json").write_text(json.dumps(ANSWERS))
    return with_log(write_small_recording(tmp_path / "r", frames=12))


def test_a_table_has_a_row_for_each_frame_with_its_answer_and_stays_without_force(
    recording: Path, shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(recording.parent)
    done = shell.json("export r --answers answers.json --out a.csv")
    assert done == {"out": "a.csv", "rows": 12}
    rows = list(csv.DictReader(Path("a.csv").read_text().splitlines()))
    assert [row["file"] for row in rows] == [f"{n:04d}.png" for n in range(12)]
    assert [row["predicted_force_mn"] for row in rows[:3]] == ["", "4.5", ""]
    assert float(rows[5]["measured_force_mn"]) == pytest.approx(10.0, abs=0.3)
    assert rows[5]["target"] == "1"
    assert "exists already" in shell.refused("export answers.json --out a.csv")
    assert Path("a.csv").read_text().startswith("file,")
    shell.run("export answers.json --force --out a.csv")
    shell.run("export answers.json --out b.csv")
    assert Path("a.csv").read_bytes() == Path("b.csv").read_bytes()
    (answer,) = csv.DictReader(Path("b.csv").read_text().splitlines())
    assert (answer["file"], answer["interval_low_mn"]) == ("0001.png", "3.0")


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ("r --out a.png", "give a name that ends in .csv, .json, .mcap, .nrrd"),
        ("answers.json --out a.mcap", "answers alone become .csv or .json"),
        ("answers.json --answers answers.json --out a.csv", "is answers already"),
        ("r --answers answers.json --out a.nrrd", "has room for frames only"),
        ("gone --out a.csv", "gone: No such file"),
    ],
)
def test_an_export_that_is_not_possible_is_refused(
    recording: Path, monkeypatch: pytest.MonkeyPatch, shell, words: str, fault: str
) -> None:
    monkeypatch.chdir(recording.parent)
    before = contents(Path())
    assert fault in shell.refused("export", words)
    assert contents(Path()) == before


def test_planes_are_a_column_of_a_table_and_other_exports_of_them_are_refused(
    tmp_path: Path, shell
) -> None:
    folder = write_moments(tmp_path / "planes", (0.010, 0.020))
    shell.run("export", folder, "--out", tmp_path / "a.csv")
    rows = csv.DictReader((tmp_path / "a.csv").read_text().splitlines())
    assert [row["plane"] for row in rows] == ["along", "across"] * 2

    for ending in ("mcap", "nrrd"):
        refused = shell.refused("export", folder, "--out", tmp_path / f"a.{ending}")
        assert "has room for frames of one plane; give a .csv or .json" in refused
