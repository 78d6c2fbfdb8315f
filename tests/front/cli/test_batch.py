"""Many recordings into one table: its rows and summary, and what is read again."""

import csv
import re
import shutil
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from small_recordings import calibration_text, write_pushes

import scleraforce as sf
from scleraforce.base import kept_results
from scleraforce.base.errors import InputError
from scleraforce.front.api import evaluation_table
from scleraforce.front.api.evaluation_table import Batch, by_eye, evaluate_to_table
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER

NAMES = ("eye-a", "eye-b")


@pytest.fixture(scope="module")
def eyes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("eyes")
    for name in NAMES:
        write_pushes(folder / name, name, (12.0, 30.0))

    (folder / "notes.txt").write_text("not a recording")
    return folder


@pytest.fixture
def folder(eyes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(shutil.copytree(eyes, tmp_path / "eyes"))
    return tmp_path / "eyes"


def evaluated(table: str = "t.csv", calibration: Path | None = None) -> Batch:
    paths = [path for path in sorted(Path().iterdir()) if not path.name.startswith(".")]
    return evaluate_to_table(
        "default",
        paths,
        Path(table),
        calibration,
        SHIPPED_WALL_FINDER,
        lambda *_: nullcontext(lambda _: None),
    )


def test_the_table_has_the_rows_and_the_summary_the_metrics_of_evaluate(
    folder: Path,
) -> None:
    found = evaluated()
    together = sf.evaluate("default", list(NAMES))
    assert found.rows == together.rows()
    assert found.notes[0] == "left out, not recordings: notes.txt"
    with (folder / "t.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))

    frames = [(frame.recording, frame.file) for frame in together.frames]
    assert [(row["recording"], row["file"]) for row in lines] == frames
    columns = {"time_s", "measured_force_mn", "interval_low_mn", "covered"}
    assert columns <= lines[0].keys()
    eyes = by_eye(found.rows)
    assert [eye["eye"] for eye in eyes] == [*NAMES]
    alone = sf.evaluate("default", NAMES[1])
    expected = {
        "frames": 2,
        "scored": len(alone.scored),
        "mae_mn": pytest.approx(1e3 * alone.mae_n),
        "accuracy": alone.accuracy.value,
        "coverage": alone.coverage.value,
        "modulus_source": alone.frames[0].modulus_source,
    }
    assert {key: eyes[1][key] for key in expected} == expected

    parquet = pytest.importorskip("pyarrow.parquet")
    assert evaluated("t.parquet").rows == found.rows
    # with the types of the columns
    assert parquet.read_table(folder / "t.parquet").to_pylist() == found.rows


def test_an_interrupted_batch_continues_after_its_last_whole_recording(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = evaluation_table.evaluate_recordings
    calls = list[Path]()

    def interrupted(reader: Any, recordings: Any, summary: Any) -> Any:
        if calls:
            raise KeyboardInterrupt
        calls.append(recordings[0].path)
        return real(reader, recordings, summary)

    with monkeypatch.context() as patched:
        patched.setattr(evaluation_table, "evaluate_recordings", interrupted)
        with pytest.raises(KeyboardInterrupt):
            evaluated()

    assert not (folder / "t.csv").exists()
    assert not [*folder.rglob("*.part")]
    resumed = evaluated()
    assert (resumed.recordings, resumed.read) == (2, 1)
    assert resumed.rows == evaluated("fresh.csv").rows
    assert (folder / "t.csv").read_bytes() == (folder / "fresh.csv").read_bytes()


def test_what_has_changed_is_read_again_and_nothing_else(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert [evaluated().read, evaluated().read] == [2, 0]
    frames = sorted((folder / "eye-a" / "frames").iterdir())
    frames[0].write_bytes(frames[1].read_bytes())
    assert evaluated().read == 1
    (folder / "eye-b" / "walls").mkdir()
    # hidden: of no effect on the answers
    (folder / "eye-b" / "walls" / ".0001.draft.json").write_text("{}")
    assert evaluated().read == 0
    state = sorted((folder / ".t.csv.state").iterdir())
    assert len(state) == 2  # files of earlier contents are gone
    state[1].write_bytes(state[1].read_bytes()[:-9])
    assert evaluated().read == 1
    shutil.rmtree(folder / "eye-b")
    assert (evaluated().read, len(list((folder / ".t.csv.state").iterdir()))) == (0, 1)

    calibration = folder / "c.json"
    calibration.write_text(calibration_text(0.3, {"eye-a": {}}))
    assert evaluated(calibration=calibration).read == 1
    monkeypatch.setattr(evaluation_table, "__version__", "9.9")
    assert evaluated(calibration=calibration).read == 1
    monkeypatch.setattr(evaluation_table, "hash_sources", lambda *_: "other code")
    assert evaluated(calibration=calibration).read == 1
    real = evaluation_table.read_folder

    def other(path: Any, kinds: Any) -> Any:
        found = real(path, kinds)
        record = {**found.record, "seed": 9} if path == "living" else found.record
        return replace(found, record=record)

    monkeypatch.setattr(evaluation_table, "read_folder", other)
    assert evaluated(calibration=calibration).read == 1


def test_every_byte_of_a_recording_counts_wherever_its_frames_lie(
    folder: Path,
) -> None:
    """In folders below, behind links, and with a name that begins with a point."""
    frames = folder / "eye-a" / "frames"
    (frames / "below" / ".more").mkdir(parents=True)
    names = sorted(file.name for file in frames.glob("*.png"))
    moved = ["below/.more/.first.png", "link/second.png"]
    (frames / "link").symlink_to("below")
    for name, place in zip(
        names, ["below/.more/.first.png", "below/second.png"], strict=True
    ):
        (frames / name).rename(frames / place)
    (frames / "below" / "round").symlink_to("..")

    text = (folder / "eye-a" / "frames.csv").read_text()
    for name, place in zip(names, moved, strict=True):
        text = text.replace(name, place)
    (folder / "eye-a" / "frames.csv").write_text(text)

    shutil.rmtree(folder / "eye-b")
    assert [evaluated().read, evaluated().read] == [1, 0]
    for place in moved:
        before = (frames / place).read_bytes()
        (frames / place).write_bytes((frames / moved[1]).read_bytes() + b"\0")
        assert evaluated().read == 1
        (frames / place).write_bytes(before)
        assert evaluated().read == 1  # the earlier answers are deleted by then

    (frames / "other").mkdir()
    shutil.copy(frames / moved[0], frames / "other" / "second.png")
    (frames / "link").unlink()
    (frames / "link").symlink_to("other")
    assert evaluated().read == 1


def test_only_what_this_user_wrote_is_believed_or_deleted_and_no_link_is_followed(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    kept_results._key.cache_clear()
    true_rows = evaluated().rows
    key = tmp_path / "state" / "scleraforce" / "keys" / "results"
    assert (key.stat().st_mode & 0o777, key.parent.stat().st_mode & 0o777) == (
        0o600,
        0o700,
    )
    state = folder / ".t.csv.state"
    for part in state.iterdir():
        code, text, _ = part.read_text().split("\n")
        forged = text.replace('"predicted": ', '"predicted": 1')
        assert forged != text
        part.write_text(f"{code}\n{forged}\n")

    assert not any(map(kept_results.kept_result, state.iterdir()))
    with pytest.raises(InputError, match="exists already"):
        evaluated()  # whose table is it?

    (folder / "t.csv").unlink()
    (state / f"{'0' * 64}.kept").write_text("mine")
    (state / "other.json").write_text("mine")
    (folder / "elsewhere").write_text("mine")
    (state / "link.kept").symlink_to(folder / "elsewhere")
    again = evaluated()
    assert (again.read, again.rows) == (2, true_rows)
    assert [file.name for file in state.iterdir() if file.read_text() == "mine"] != []
    assert len(list(state.iterdir())) == 5
    assert (folder / "elsewhere").read_text() == "mine"

    for mode in (0o770, 0o777):  # then nothing is believed, and nothing fails
        key.parent.chmod(mode)
        kept_results._key.cache_clear()
        (folder / "t.csv").unlink()
        assert evaluated().read == 2

    key.parent.chmod(0o700)
    kept_results._key.cache_clear()
    state.rename(folder / "others")
    state.symlink_to("others")
    before = sorted((folder / "others").iterdir())
    shutil.rmtree(folder / "eye-b")
    with pytest.raises(InputError, match=r"\.t\.csv\.state: a link or no folder"):
        evaluated()
    assert sorted((folder / "others").iterdir()) == before
    kept_results._key.cache_clear()


def test_answers_to_frames_that_change_meanwhile_are_not_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = evaluation_table.evaluate_recordings
    frame = min((folder / "eye-a" / "frames").iterdir())
    before = frame.read_bytes()

    def with_a_change(reader: Any, recordings: Any, summary: Any) -> Any:
        found = real(reader, recordings, summary)
        frame.write_bytes(frame.read_bytes() + b"\0")
        return found

    monkeypatch.setattr(evaluation_table, "evaluate_recordings", with_a_change)
    assert evaluated().read == 2
    monkeypatch.setattr(evaluation_table, "evaluate_recordings", real)
    frame.write_bytes(before)
    assert evaluated().read == 1


@pytest.mark.parametrize(
    ("recordings", "table", "fault"),
    [
        ("eye-a", "t.xlsx", "ends in .csv or .parquet"),
        ("eye-a", "taken.csv", "exists already"),
        ("eye-a", "no/t.csv", "its folder does not exist"),
        ("eye-a", "t.parquet", "pyarrow, which is not installed: pip install"),
        ("eye-a nothing", "t.csv", "nothing: no such recording"),
        ("eye-a ./eye-a", "t.csv", "given twice"),
    ],
)
def test_what_cannot_be_written_is_refused_before_reading(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    shell,
    recordings: str,
    table: str,
    fault: str,
) -> None:
    monkeypatch.setattr(evaluation_table, "evaluate_recordings", None)
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    (folder / "taken.csv").write_text("mine")
    error = shell.refused(f"evaluate default {recordings} --table {table}")
    assert fault in error
    assert (folder / "taken.csv").read_text() == "mine"


def test_a_table_and_a_report_are_of_the_same_frames(folder: Path, shell) -> None:
    """The table as without the report, the report as without the table, and what was
    kept serves the next table.
    """
    command = f"evaluate default {' '.join(NAMES)}"
    lines = shell.run(f"{command} --table alone.csv")[0].splitlines()
    assert [line.split()[:2] for line in lines[1:3]] == [[name, "2"] for name in NAMES]
    assert max(map(len, lines)) <= 80
    before = (folder / "alone.csv").read_bytes()
    shell.run(f"{command} --html alone.html")
    for name in ("alone", "t"):  # also where nothing has changed
        both = f"--table {name}.csv --html {name}-2.html"
        lines = shell.run(f"{command} {both}")[0].splitlines()
        assert lines[-1] == f"wrote {name}.csv: 4 frames; recordings read now: 2 of 2"
        assert (folder / f"{name}.csv").read_bytes() == before

    pages = [
        re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d", "", (folder / name).read_text())
        for name in ("t-2.html", "alone.html")
    ]
    assert pages[0] == pages[1]
    assert evaluated("t.csv").read == 0
