"""`show` knows each kind of thing by itself, describes and draws it; `export` writes it for other programs."""

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
from small_models import write_fixed_reader
from small_monitor import READ_ENTRY, verdict
from small_recordings import calibration_of_a_sealed_eye, write_notebook_folder, write_small_recording

from scleraforce.calibration.result import calibration_as_json
from scleraforce.cli.main import run
from scleraforce.known.calibration_file import write_calibration
from scleraforce.service.decision_log import DecisionLog
from scleraforce.service.messages import Entry

Captured = pytest.CaptureFixture[str]


def decisions(count: int = 30) -> list[Entry]:
    """A needle that pushes by 1 mN more in each frame, 10 ms apart; the monitor withdraws at the 21st."""
    return [
        replace(
            READ_ENTRY, number=n, frame=n, at_s=n / 100, time_s=1.8e9 + n / 100,
            verdict=verdict(float(n), (n - 1.0, n + 1.0)),
            state="WITHDRAW" if n > 20 else "WATCHING",
            cause="BOUND" if n > 20 else None,
        )
        for n in range(1, count + 1)
    ]  # fmt: skip


def write_log(folder: Path) -> Path:
    log = DecisionLog(folder / "log")
    log.append({"kind": "note", "text": "robot came"})
    for entry in decisions():
        log.append({"kind": "entry", "entry": entry.as_json()})
    log.close()
    return folder


def write_push(path: Path) -> None:
    """Write a force log: no contact for a second, then 1 mN more every 10 ms; in contact the sensor's z is negative."""
    samples = [(n / 200, -0.1 * max(n / 200 - 1.0, 0.0)) for n in range(400)]
    rows = [f"{time_s},0,0,{force_n},0,0,0" for time_s, force_n in samples]
    path.write_text("\n".join(["time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm", *rows]) + "\n")


@pytest.fixture(scope="module")
def things(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one thing of each kind that is quickly made."""
    folder = tmp_path_factory.mktemp("things")
    (folder / "study.toml").write_text(
        "[eye]\nradius_mm = 11.0\n[dataset]\nframing_depth_mm = { min = 0.2, max = 0.6 }\n"
    )
    write_small_recording(folder / "eye")
    write_push(folder / "eye" / "forces.csv")
    write_calibration(calibration_as_json(calibration_of_a_sealed_eye()), folder / "modulus.json")
    write_log(folder / "box")
    write_fixed_reader(folder / "reader", SMALL_LIBRARY, [0.0, 1.0] + [0.0] * 14)
    return folder


SAID = {
    "study.toml": ("study", "eye.radius_mm = 11.0 (the paper's: 12.0)"),
    ".": ("study", "dataset.framing_depth_mm = 0.2 to 0.6 (the paper's: [0.0])"),
    "eye": ("recording", "40 in 0.39 s, 32 x 24 pixels of 12 bits"),
    "modulus.json": ("calibration", "mine               0.300   0.0100        3  thickness 651 ± 12 µm"),
    "box": ("decision log", "1 BOUND"),
    "box/log": ("decision log", "30, 30 of them on a frame"),
    "box/log/decisions-000001.jsonl": ("decision log", "1.0 to 30.0 mN"),
    "reader": ("model", "reader, answers with its fit"),
    "default": ("model", "library.npz"),
    "wall-finder": ("model", "wall-finder"),
    "reader/library.npz": ("library", "radius 12 mm, 350 to 900 µm thick"),
}


def test_each_thing_is_known_and_described_within_80_columns_and_as_json(
    things: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(things)
    for name, (kind, words) in SAID.items():
        assert run(["show", name]) == 0
        first, *lines = capsys.readouterr().out.splitlines()
        assert first == f"{name}: {kind}"
        assert words in "\n".join(lines)
        assert max(map(len, lines)) <= 80
        assert run(["show", name, "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert (said["kind"], said["path"]) == (kind, name)


BEGINS = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
DRAWN = {"study.toml": ".png", "eye": ".svg", "modulus.json": ".pdf", "box": ".svg", "reader/library.npz": ".svg",
         "default": ".svg", "wall-finder": ".svg"}  # fmt: skip


def test_each_thing_is_drawn(things: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(things)
    for number, (name, ending) in enumerate(DRAWN.items()):
        plot = tmp_path / f"plot-{number}{ending}"
        assert run(["show", name, "--plot", str(plot)]) == 0
        assert plot.read_bytes().startswith(BEGINS[ending])


def test_a_thing_of_a_shipped_name_is_shown_itself(things: Path, tmp_path: Path, capsys: Captured,
                                                   monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    copytree(things / "eye", "default")
    assert run(["show", "default"]) == 0
    assert capsys.readouterr().out.startswith("default: recording")


def test_the_subject_of_a_trainings_figures_precedes_them(capsys: Captured) -> None:
    subjects = {"default": "the network alone", "paper": "simulated slices", "wall-finder": "drawn scenes"}
    for model, words in subjects.items():
        assert run(["show", model]) == 0
        text = " ".join(capsys.readouterr().out.split())
        said = text.index("figures below are of")
        assert words in text[said : said + 60]
        assert said < min(text.find(name) % len(text) for name in ("mean error", "validation accuracy", "overlap"))


def test_the_frames_of_a_recording_have_their_forces(things: Path, capsys: Captured) -> None:
    run(["show", str(things / "eye"), "--json"])
    frames = json.loads(capsys.readouterr().out)["frames"]
    assert [frame["file"] for frame in frames] == [f"{n:04d}.png" for n in range(40)]
    read = {n: (frames[n]["measured_force_mn"], frames[n]["target"]) for n in (15, 20, 36)}
    assert read == {15: (pytest.approx(15, abs=0.5), 1), 20: (pytest.approx(20, abs=0.5), 1),
                    36: (pytest.approx(36, abs=0.5), 2)}  # fmt: skip


def test_a_frame_outside_the_log_is_shown_without_a_label_and_the_others_with_theirs(
    things: Path, tmp_path: Path, capsys: Captured
) -> None:
    copytree(things / "eye", tmp_path / "eye")
    table = (tmp_path / "eye" / "frames.csv").read_text().splitlines()
    file, _, *others = table[1].split(",")
    (tmp_path / "eye" / "frames.csv").write_text("\n".join([table[0], ",".join([file, "-9.0", *others]), *table[2:]]))
    assert run(["show", str(tmp_path / "eye"), "--json", "--plot", str(tmp_path / "eye.png")]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["no_labels"] is None
    assert [frame["target"] is None for frame in shown["frames"]] == [True] + [False] * 39
    assert "force samples within" in shown["frames"][0]["excluded"]
    assert any("1 of 40 frames have no label and are left out" in note for note in shown["notes"])
    run(["show", str(tmp_path / "eye")])
    assert "1 of 40 frames have no label" in " ".join(capsys.readouterr().out.split())


def test_a_recording_whose_frames_have_no_label_is_shown_with_the_reason(
    things: Path, tmp_path: Path, capsys: Captured
) -> None:
    copytree(things / "eye", tmp_path / "eye")
    table = (tmp_path / "eye" / "frames.csv").read_text().splitlines()
    moved = [(file, float(time_s) + 1e3, others) for file, time_s, *others in (line.split(",") for line in table[1:])]
    lines = [",".join([file, f"{time_s}", *others]) for file, time_s, others in moved]
    (tmp_path / "eye" / "frames.csv").write_text("\n".join([table[0], *lines]))
    assert run(["show", str(tmp_path / "eye"), "--json", "--plot", str(tmp_path / "eye.png")]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert "the clocks do not overlap" in shown["no_labels"]
    assert {frame["target"] for frame in shown["frames"]} == {None}


def test_a_withdrawal_is_counted_once_with_its_cause_and_sentence(things: Path, capsys: Captured) -> None:
    run(["show", str(things / "box"), "--json"])
    said = json.loads(capsys.readouterr().out)
    assert [(entry["number"], entry["cause"]) for entry in said["withdrawals"]] == [(21, "BOUND")]
    assert (said["decisions"], said["notes"], said["torn"]) == (30, ["robot came"], 0)


def test_torn_parts_of_a_log_are_counted(tmp_path: Path, capsys: Captured) -> None:
    with (write_log(tmp_path) / "log" / "decisions-000001.jsonl").open("a") as file:
        file.write('{"kind": "en')
    assert run(["show", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["torn"] == 1


REFUSED = {
    "nowhere": "nowhere: no such file or folder; give a study",
    "empty": "empty: give a study, library, data set, model (or a bundled one: default, paper, wall-finder)",
    "eye/recording.toml": "a part of a recording; give its folder",
    "eye/frames/0000.png": "0000.png: give a study",
    "eye --calibration modulus.json": "--calibration: only used with --html",
    "eye --wall-finder none": "--wall-finder: only used with --html",
    "eye --html page.html": "--html: shows what a model reads; give --model, like default",
    "eye --model nowhere": "nowhere: no such folder, and no model that ships",
    "eye --model wall-finder": "wall-finder: kind: found 'wall-finder'",
    "study.toml --model default": "--model: study.toml is a study; a model reads recordings",
    "eye --plot picture.jpg": "picture.jpg: give a name that ends in .png, .svg, .pdf",
    "eye --plot study.toml": "give a name that ends in",
    "eye --plot old.svg": "old.svg: exists already",
    "eye --plot new.svg --html page.html --model nowhere": "nowhere: no such folder, and no model that ships",
}


def test_wrong_input_is_one_line_and_writes_nothing(
    things: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(things)
    Path("empty").mkdir()
    Path("old.svg").write_text("old")
    before = contents(things)
    for arguments, words in REFUSED.items():
        assert run(["show", *arguments.split()]) == 2
        said = capsys.readouterr()
        assert words in said.err
        assert (said.out, said.err.count("\n")) == ("", 1)
    assert contents(things) == before


def test_a_whole_record_that_is_not_a_decision_is_named_with_its_place(tmp_path: Path, capsys: Captured) -> None:
    for name, more in {"wrong": {"entry": {"class": 1}}, "none": {}}.items():
        log = DecisionLog(tmp_path / name)
        log.append({"kind": "note", "text": "here"})
        log.append({"kind": "entry", **more})
        log.close()
        assert run(["show", str(tmp_path / name)]) == 2
        assert "decisions-000001.jsonl: byte" in capsys.readouterr().err


def test_a_pipe_in_a_log_is_refused_and_not_waited_for(tmp_path: Path, capsys: Captured) -> None:
    os.mkfifo(write_log(tmp_path) / "log" / "decisions-000002.jsonl")
    assert run(["show", str(tmp_path)]) == 2
    assert "decisions-000002.jsonl: not a regular file" in capsys.readouterr().err


def test_the_curves_of_a_training_are_drawn_as_far_as_they_are_numbers(things: Path, tmp_path: Path) -> None:
    copytree(things / "reader", tmp_path / "reader")
    file = tmp_path / "reader" / "model.json"
    record = json.loads(file.read_text()) | {"curves": {"training_loss": [2, 1.5], "validation_loss": ["a"], "b": 3}}
    file.write_text(json.dumps(record))
    assert run(["show", str(tmp_path / "reader"), "--plot", str(tmp_path / "curves.svg")]) == 0


@pytest.mark.slow
def test_stores_are_known_by_what_is_in_them(tmp_path: Path, capsys: Captured) -> None:
    write_notebook_folder(tmp_path)
    for name, kind, words in (("dataset", "data set", "200, "), ("responses", "library", "4 thicknesses x 4 tensions")):
        assert run(["show", str(tmp_path / name), "--plot", str(tmp_path / f"{name}.png")]) == 0
        said = capsys.readouterr().out
        assert said.startswith(f"{tmp_path / name}: {kind}")
        assert words in said


ANSWERS = {"frames": [{"file": "0001.png", "recording": "r", "predicted_force_mn": 4.5, "interval_mn": [3.0, 6.0]}]}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    (tmp_path / "answers.json").write_text(json.dumps(ANSWERS))
    return with_log(write_small_recording(tmp_path / "r", frames=12))


def exported(*arguments: object) -> int:
    return run(["export", *map(str, arguments)])


def test_a_table_has_a_row_for_each_frame_with_its_answer(recording: Path, capsys) -> None:
    out = recording.parent / "a.csv"
    assert exported(recording, "--answers", recording.parent / "answers.json", "--out", out, "--json") == 0
    assert json.loads(capsys.readouterr().out) == {"out": str(out), "rows": 12}
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert [row["file"] for row in rows] == [f"{n:04d}.png" for n in range(12)]
    assert [row["predicted_force_mn"] for row in rows[:3]] == ["", "4.5", ""]
    assert float(rows[5]["measured_force_mn"]) == pytest.approx(10.0, abs=0.3)
    assert rows[5]["target"] == "1"


def test_json_has_the_settings_of_the_recording_too(recording: Path) -> None:
    out = recording.parent / "a.json"
    assert exported(recording, "--out", out) == 0
    found = json.loads(out.read_text())
    assert (found["oct"]["bits"], found["needle"]["gauge"], len(found["frames"])) == (12, 22, 12)


def test_answers_alone_become_a_table(recording: Path) -> None:
    out = recording.parent / "b.csv"
    assert exported(recording.parent / "answers.json", "--out", out) == 0
    assert out.read_text() == (
        "file,recording,predicted_force_mn,interval_low_mn,interval_high_mn\n0001.png,r,4.5,3.0,6.0\n"
    )


@pytest.mark.parametrize("name", ["a.mcap", "a.nrrd", "a.seq.nrrd"])
def test_frames_become_a_file_that_import_takes(recording: Path, tmp_path: Path, name: str) -> None:
    pytest.importorskip("rosbags")
    pytest.importorskip("nrrd")
    assert exported(recording, "--out", tmp_path / name) == 0
    like = ["--like", recording, "--eye", "again", "--out", tmp_path / "back"]
    assert run(["import", str(tmp_path / name), *map(str, like)]) == 0


def test_a_file_that_is_there_stays_without_force(recording: Path, capsys) -> None:
    out = recording.parent / "a.csv"
    out.write_text("mine")
    assert exported(recording, "--out", out) == 2
    assert "exists already" in capsys.readouterr().err
    assert out.read_text() == "mine"
    assert exported(recording, "--out", out, "--force") == 0
    assert out.read_text().startswith("file,")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["r", "--out", "a.png"], "give a name that ends in .csv, .json, .mcap, .nrrd"),
        (["answers.json", "--out", "a.mcap"], "answers alone become .csv or .json"),
        (["answers.json", "--answers", "answers.json", "--out", "a.csv"], "is a file of answers already"),
        (["r", "--answers", "answers.json", "--out", "a.nrrd"], "has room for frames only"),
        (["gone", "--out", "a.csv"], "gone: No such file"),
    ],
)
def test_what_cannot_be_done_is_refused(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(recording.parent)
    assert exported(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (recording.parent / arguments[-1]).exists()
