import os
import signal
import subprocess
import sys

import pytest
from waiting import FUSE_S, ends

from scleraforce.live.companions.decision_log import DecisionLog, read_log

RECORDS = [
    {
        "kind": "entry",
        "entry": {
            "number": 1,
            "state": "WATCHING",
            "force_mn": 12.5,
            "message": 'a "quoted" }, {\n',
        },
    },
    {"kind": "note", "time_s": 1.5, "text": "é \\ \t"},
    {
        "kind": "entry",
        "entry": {"number": 2, "probabilities": [0.1, 0.9], "cause": None},
    },
]


@pytest.fixture
def log(tmp_path):
    """The one file of a log with three records."""
    log = DecisionLog(tmp_path / "log")
    for record in RECORDS:
        log.append(record)
    log.close()
    return tmp_path / "log" / "decisions-000001.jsonl"


def records(path):
    return [part.record for part in read_log(path) if part.record is not None]


def torn(path):
    return [part.data for part in read_log(path) if part.record is None]


def ends_of_records(path):
    ends = []
    at = 0
    for line in path.read_bytes().splitlines(keepends=True):
        at += len(line)
        ends.append(at)
    return ends


def test_a_log_that_is_cut_at_any_byte_has_all_records_before_and_says_what_is_torn(
    log, monkeypatch
):
    """It continues all the same, and keeps its bytes."""
    for wait in ("fsync", "fdatasync"):
        monkeypatch.setattr(os, wait, lambda _: None)

    whole = log.read_bytes()
    ends = ends_of_records(log)

    for length in range(len(whole)):
        log.unlink()  # writing over a file takes longer
        log.write_bytes(whole[:length])
        # the end of the line may be missing
        complete = sum(end - 1 <= length for end in ends)
        assert records(log) == RECORDS[:complete]
        assert b"".join(torn(log)) == whole[([0, *ends])[complete] : length]
        again = DecisionLog(log.parent)
        again.append(RECORDS[1])
        again.close()
        assert records(log) == [*RECORDS[:complete], RECORDS[1]]
        assert log.read_bytes().startswith(whole[:length])


def test_a_changed_byte_costs_its_own_record_and_no_other_one(log):
    whole = log.read_bytes()
    ends = ends_of_records(log)
    file = os.open(log, os.O_WRONLY)

    for place, byte in enumerate(whole):
        record = sum(end <= place for end in ends)
        others = [one for number, one in enumerate(RECORDS) if number != record]

        for changed in {byte ^ 1, byte ^ 32, *b'\n{"'} - {byte}:
            os.pwrite(file, bytes([changed]), place)
            found = records(log)
            assert found in (others, RECORDS)
            # the end of a line is outside the record's bytes
            assert (found == RECORDS) == (place + 1 in ends)
            assert torn(log)

        os.pwrite(file, bytes([byte]), place)

    os.close(file)


def test_files_are_numbered_and_the_oldest_go_but_never_the_newest(tmp_path):
    log = DecisionLog(tmp_path, file_bytes=1000, total_bytes=3500)
    for number in range(200):
        log.append({"number": number})
        files = sorted(tmp_path.iterdir())
        assert all(file.stat().st_size <= 1000 for file in files)
        assert sum(file.stat().st_size for file in files) <= 3500 + 1000

    log.close()
    numbers = [record["number"] for record in records(tmp_path)]
    assert numbers == list(range(numbers[0], 200))
    assert len(numbers) > 70
    assert files[-1].name == "decisions-000008.jsonl"
    assert len(files) < 8
    tiny = DecisionLog(tmp_path / "tiny", file_bytes=10, total_bytes=0)

    for number in range(5):
        tiny.append({"number": number})

    tiny.close()
    assert records(tmp_path / "tiny") == [{"number": 4}]


def test_two_processes_do_not_write_one_log(tmp_path):
    log = DecisionLog(tmp_path)
    with pytest.raises(OSError, match="in use by another monitor"):
        DecisionLog(tmp_path)
    log.close()
    DecisionLog(tmp_path).close()


def test_a_record_that_the_disk_took_in_part_is_an_error_and_the_next_one_is_whole(
    tmp_path, monkeypatch
):
    log = DecisionLog(tmp_path)
    log.append(RECORDS[0])

    with monkeypatch.context() as disk:
        write = os.write
        disk.setattr(os, "write", lambda file, data: write(file, data[:20]))
        with pytest.raises(OSError, match="a record was cut"):
            log.append(RECORDS[1])

    log.append(RECORDS[2])
    log.close()
    assert records(tmp_path) == [RECORDS[0], RECORDS[2]]
    assert [len(part) for part in torn(tmp_path)] == [20]


def test_a_process_that_is_killed_while_it_writes_leaves_every_record_that_it_had_written(
    tmp_path,
):
    """The child says each number after it is appended."""
    code = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from scleraforce.live.companions.decision_log import DecisionLog\n"
        f"log = DecisionLog(Path({str(tmp_path)!r}), file_bytes=100_000)\n"
        "for number in range(10**9):\n"
        "    log.append({'number': number, 'text': 'x' * (number * 37 % 5000)})\n"
        "    os.write(1, b'%d\\n' % number)\n"
    )
    for _ in range(2):
        child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
        with ends(child.stdout, FUSE_S):
            for _ in range(300):
                said = int(child.stdout.readline())

        child.send_signal(signal.SIGKILL)
        said = max([said, *map(int, child.stdout.read().split())])
        child.stdout.close()
        child.wait(FUSE_S)
        runs = [record["number"] for record in records(tmp_path)]
        last = len(runs) - 1 - runs[::-1].index(0)  # where this child began
        assert runs[last:] in (list(range(said + 1)), list(range(said + 2)))
        # one each: of a line across two pages of memory, half may have been written
        assert len(torn(tmp_path)) <= 2


def test_the_disk_is_asked_for_the_folder_when_a_file_is_made_and_for_the_file_with_each_sync(
    tmp_path, monkeypatch
):
    asked = []

    def note(kind):
        return lambda descriptor: asked.append(
            (kind, os.readlink(f"/proc/self/fd/{descriptor}"))
        )

    for kind in ("fsync", "fdatasync"):
        monkeypatch.setattr(os, kind, note(kind))

    folder = tmp_path / "log"
    log = DecisionLog(folder, file_bytes=200)
    assert asked == [("fsync", str(folder))]
    log.append(RECORDS[0])
    log.sync()
    first, second = (
        str(folder / f"decisions-00000{number}.jsonl") for number in (1, 2)
    )
    assert asked[1:] == [("fdatasync", first)]
    log.append(RECORDS[0])
    assert asked[2:] == [("fsync", str(folder)), ("fdatasync", first)]
    log.close()
    assert asked[4:] == [("fdatasync", second)]
