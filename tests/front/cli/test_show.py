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


SAID = {
    "study.toml": ("study", "eye.radius_mm = 11.0 (the paper's: 12.0)"),
    ".": ("study", "dataset.framing_depth_mm = 0.2 to 0.6 (the paper's: [0.0])"),
    "eye": ("recording", "40 in 0.39 s, 32 x 24 pixels of 12 bits"),
    "modulus.json": (
        "calibration",
        "info            mine: thickness 651 ± 12 µm",
    ),
    "box": ("decision log", "1 BOUND"),
    "box/log": ("decision log", "30, 30 of them on a frame"),
    "box/log/decisions-000001.jsonl": ("decision log", "1.0 to 30.0 mN"),
    "reader": ("model", "reader, answers with its fit"),
    "default": ("model", "library.npz"),
    "wall-finder": ("model", "wall-finder"),
    "reader/library.npz": ("library", "radius 12 mm, 350 to 900 µm thick"),
}


@pytest.fixture
def here(things: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(things)
    return things


@pytest.mark.usefixtures("here")
def test_each_thing_is_recognised_and_described_within_80_columns_and_as_json(
    shell,
) -> None:
    for name, (kind, words) in SAID.items():
        first, *lines = shell.run("show", name)[0].splitlines()
        assert first == f"{name}: {kind}"
        assert words in "\n".join(lines)
        assert max(map(len, lines)) <= 80
        said = shell.json("show", name)
        assert (said["kind"], said["path"]) == (kind, name)


BEGINS = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
DRAWN = {
    "study.toml": ".png",
    "eye": ".svg",
    "modulus.json": ".pdf",
    "box": ".svg",
    "reader/library.npz": ".svg",
    "default": ".svg",
    "wall-finder": ".svg",
}


@pytest.mark.usefixtures("here")
def test_each_thing_is_drawn(tmp_path: Path, shell) -> None:
    for number, (name, ending) in enumerate(DRAWN.items()):
        plot = tmp_path / f"plot-{number}{ending}"
        shell.run("show", name, "--plot", plot)
        assert plot.read_bytes().startswith(BEGINS[ending])


def test_the_frames_of_a_recording_have_their_forces_unless_the_log_lacks_their_time(
    things, tmp_path, shell
) -> None:
    frames = shell.json("show", things / "eye")["frames"]
    assert [frame["file"] for frame in frames] == [f"{n:04d}.png" for n in range(40)]

    for n, target in {15: 1, 20: 1, 36: 2}.items():
        assert (frames[n]["measured_force_mn"], frames[n]["target"]) == (
            pytest.approx(n, abs=0.5),
            target,
        )

    copytree(things / "eye", tmp_path / "eye")
    table = (tmp_path / "eye" / "frames.csv").read_text().splitlines()
    file, _, *others = table[1].split(",")
    (tmp_path / "eye" / "frames.csv").write_text(
        "\n".join([table[0], ",".join([file, "-9.0", *others]), *table[2:]])
    )
    shown = shell.json("show", tmp_path / "eye", "--plot", tmp_path / "eye.png")
    assert shown["no_labels"] is None
    assert [frame["target"] is None for frame in shown["frames"]] == [True] + [
        False
    ] * 39
    assert "force samples within" in shown["frames"][0]["excluded"]
    assert any(
        "1 of 40 frames have no label and are left out" in note
        for note in shown["notes"]
    )
    assert "1 of 40 frames have no label" in shell.text("show", tmp_path / "eye")


def test_a_recording_whose_clocks_do_not_overlap_is_shown_with_that_reason(
    things: Path, tmp_path: Path, shell
) -> None:
    copytree(things / "eye", tmp_path / "eye")
    head, *rows = (tmp_path / "eye" / "frames.csv").read_text().splitlines()
    moved = [
        f"{file},{float(time_s) + 1e3}"
        for file, time_s, *_ in (row.split(",") for row in rows)
    ]
    (tmp_path / "eye" / "frames.csv").write_text(
        "\n".join([",".join(head.split(",")[:2]), *moved])
    )
    shown = shell.json("show", tmp_path / "eye", "--plot", tmp_path / "eye.png")
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


REFUSED = {
    "nowhere": "nowhere: no such file or folder; give a study",
    "empty": (
        "empty: give a study, library, data set, model (or a bundled one: default,"
        " living, paper, wall-finder)"
    ),
    "eye/recording.toml": "a part of a recording; give its folder",
    "eye/frames/0000.png": "0000.png: give a study",
    "eye --model nowhere": "nowhere: not a bundled model",
    "eye --model ./nowhere": "nowhere: no such folder; give one, or a bundled model",
    "eye --model wall-finder": "wall_finder: kind: found 'wall-finder'",
    "study.toml --model default": (
        "--model: study.toml is a study; a model reads recordings"
    ),
    "eye --plot picture.jpg": "picture.jpg: give a name that ends in .png, .svg, .pdf",
    "eye --plot study.toml": "give a name that ends in",
    "eye --plot old.svg": "old.svg: exists already",
    "eye --plot new.svg --model nowhere": ("nowhere: not a bundled model"),
}


def test_wrong_input_is_one_line_and_writes_nothing(here: Path, shell) -> None:
    Path("empty").mkdir()
    Path("old.svg").write_text("old")
    before = contents(here)
    for arguments, words in REFUSED.items():
        assert words in shell.refused("show", *arguments.split())
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


def test_a_table_has_a_row_for_each_frame_with_its_answer(
    recording: Path, shell
) -> None:
    out = recording.parent / "a.csv"
    answers = recording.parent / "answers.json"
    assert shell.json("export", recording, "--answers", answers, "--out", out) == {
        "out": str(out),
        "rows": 12,
    }
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [row["file"] for row in rows] == [f"{n:04d}.png" for n in range(12)]
    assert [row["predicted_force_mn"] for row in rows[:3]] == ["", "4.5", ""]
    assert float(rows[5]["measured_force_mn"]) == pytest.approx(10.0, abs=0.3)
    assert rows[5]["target"] == "1"
    shell.run("export", recording, "--out", recording.parent / "a.json")
    found = json.loads((recording.parent / "a.json").read_text())
    assert (found["oct"]["bits"], found["needle"]["gauge"], len(found["frames"])) == (
        12,
        22,
        12,
    )
    shell.run("export", answers, "--out", recording.parent / "b.csv")
    assert (
        (recording.parent / "b.csv").read_text()
        == "file,recording,predicted_force_mn,interval_low_mn,interval_high_mn\n0001.png,r,4.5,3.0,6.0\n"
    )


def test_a_file_that_is_there_stays_without_force(recording: Path, shell) -> None:
    out = recording.parent / "a.csv"
    out.write_text("mine")
    assert "exists already" in shell.refused("export", recording, "--out", out)
    assert out.read_text() == "mine"
    shell.run("export", recording, "--out", out, "--force")
    assert out.read_text().startswith("file,")


def test_an_export_that_is_not_possible_is_refused(
    recording: Path, monkeypatch: pytest.MonkeyPatch, shell
) -> None:
    monkeypatch.chdir(recording.parent)
    for arguments, message in (
        (["r", "--out", "a.png"], "give a name that ends in .csv, .json, .mcap, .nrrd"),
        (["answers.json", "--out", "a.mcap"], "answers alone become .csv or .json"),
        (
            ["answers.json", "--answers", "answers.json", "--out", "a.csv"],
            "answers.json is answers already",
        ),
        (
            ["r", "--answers", "answers.json", "--out", "a.nrrd"],
            "has room for frames only",
        ),
        (["gone", "--out", "a.csv"], "gone: No such file"),
    ):
        assert message in shell.refused("export", *arguments)
        assert not (recording.parent / arguments[-1]).exists()


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
