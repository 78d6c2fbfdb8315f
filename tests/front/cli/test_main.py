"""Every command: exit codes, one error line, pure JSON on standard output, a clean
Ctrl-C; findings of `doctor`.
"""

import os
import shutil
import signal
import subprocess
import sys
from math import inf, nan
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import click
import numpy as np
import pytest
from analytic_frames import recording_toml, write_one_frame
from effects import SCLERAFORCE
from waiting import FUSE_S, ends, wait_until

import scleraforce as sf
from scleraforce.base.errors import SolverError, StudyError
from scleraforce.base.plain_json import finite_json
from scleraforce.front.cli import installation_checks, main as entry
from scleraforce.front.cli.installation_checks import Finding
from scleraforce.front.cli.main import cli
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.records.study import refuse_unused


@pytest.fixture
def fails(monkeypatch: pytest.MonkeyPatch):
    """Give the command line one more command, `fails`, that raises a fault."""

    def install(fault: BaseException) -> None:
        @click.command()
        def fails() -> None:
            raise fault

        original = cli.get_command
        monkeypatch.setattr(
            cli,
            "get_command",
            lambda ctx, name: fails if name == "fails" else original(ctx, name),
        )

    return install


@pytest.mark.parametrize(
    ("fault", "code", "line"),
    [
        (StudyError("a.toml:3: eye.iris: unknown key"), 2, "a.toml:3: eye.iris: "),
        (SolverError("load step 3: did not converge"), 1, "load step 3: did not"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (ValueError("two\nlines"), 1, "internal fault: ValueError: two lines"),
        (OSError(36, "File name too long", "xxx"), 2, "xxx: File name too long"),
        (OSError(28, "No space left on device"), 2, "No space left on device"),
        (
            ConnectionRefusedError(111, "Connection refused"),
            1,
            "internal fault: ConnectionRefusedError: ",
        ),
        (click.UsageError("no such thing"), 2, "no such thing"),
    ],
)
def test_every_failure_is_one_line_and_its_exit_code(
    fails, shell, fault: BaseException, code: int, line: str
) -> None:
    fails(fault)
    out, err = shell.run("fails", code=code)
    assert out == ""
    assert err.lstrip("\n").startswith(f"error: {line}")
    assert err.strip().count("\n") == 0


def test_a_developer_gets_the_traceback_on_request(fails, monkeypatch, shell) -> None:
    monkeypatch.setenv("SCLERAFORCE_TRACEBACK", "1")
    fails(ZeroDivisionError("x"))
    with pytest.raises(ZeroDivisionError):
        shell.run("fails")


@pytest.mark.parametrize(
    ("typed", "words", "page"),
    [
        ("no-such-command", "No such command 'no-such-command'", ""),
        ("exprt", "Did you mean 'export'?", ""),
        ("--no-such-option", "No such option", ""),
        ("init", "Missing argument 'DIRECTORY'", " init"),
        ("init a b", "unexpected extra argument (b)", " init"),
        ("import a.tif --out r --bits 99", "99 is not in the range", " import"),
        ("replay r --fault-at-s 1", "give the --fault, too", " replay"),
    ],
)
def test_wrong_usage_is_exit_code_2_and_one_line_that_says_where_to_look(
    shell, typed: str, words: str, page: str
) -> None:
    err = shell.refused(typed)
    assert words in err
    assert err.endswith(f"; see `scleraforce{page} --help`\n")


def test_help_is_a_command_as_well(shell) -> None:
    assert "reproduce" in shell.run(code=2)[0]
    assert shell.text("--version").startswith("scleraforce, version ")
    assert shell.run("help") == shell.run("--help")
    assert shell.run("help read") == shell.run("read --help")
    assert "Did you mean 'read'?" in shell.refused("help raed")


def test_init_writes_the_papers_study_or_another_preset_once(
    tmp_path: Path, shell
) -> None:
    path = tmp_path / "a" / "b" / "study.toml"
    assert shell.json("init", path.parent) == {"path": str(path), "preset": "ex-vivo"}
    assert sf.read_study(path) == sf.Study()
    assert "exists already; remove it" in shell.refused("init", path.parent)
    shell.refused("init", path / "below")  # a file
    assert "'ex-vivo', 'living'" in shell.refused("init c --preset mars")
    shell.run("init", tmp_path / "living", "--preset living")
    study = sf.read_study(tmp_path / "living" / "study.toml")
    refuse_unused(study, "library")
    refuse_unused(study, "calibrate", "finite-strain")
    shares, times_s = zip(*study.tissue.relaxation, strict=True)
    pork = PronySeries(
        tuple(share.bounds[1] for share in shares),
        tuple(time_s.bounds[0] for time_s in times_s),
    )
    assert pork.left(np.array([1.0, 10.0])) == pytest.approx([0.70, 0.46], abs=0.05)
    least_pa = [each.reader.youngs_modulus_pa.bounds[0] for each in (study, sf.Study())]
    assert least_pa[0] > least_pa[1]


def test_json_has_no_number_that_json_does_not_know() -> None:
    found = finite_json({"a": nan, "b": [inf, 1.0], "c": {"d": (-inf, 2)}, "e": "f"})
    assert found == {"a": None, "b": [None, 1.0], "c": {"d": [None, 2]}, "e": "f"}


def test_control_c_in_a_real_process_is_exit_code_130_and_one_line() -> None:
    # A command that blocks: the test's own `wait`, installed in the child before the
    # entry point runs. As zarr does, it leaves a task in a loop of asyncio, which says
    # so when it is destroyed.
    code = """
import asyncio, sys, time, click
from scleraforce.front.cli import main as entry

@click.command()
def wait():
    loop = asyncio.new_event_loop()
    loop.create_task(asyncio.sleep(60))
    loop.run_until_complete(asyncio.sleep(0))
    print("ready", flush=True)
    time.sleep(300)

entry.cli.get_command = lambda ctx, name: wait
sys.argv = ["scleraforce", "wait"]
entry.main()
"""
    child = subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None

    with ends(child.stdout, FUSE_S):
        assert child.stdout.readline() == "ready\n"

    child.send_signal(signal.SIGINT)
    _, err = child.communicate(timeout=FUSE_S)
    assert child.returncode == 130
    # click puts a line feed before, to leave the terminal's ^C alone
    assert err.strip() == "error: interrupted"


def test_a_reader_that_leaves_early_gets_no_traceback() -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [*SCLERAFORCE, "--help"],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=FUSE_S,
    )
    os.close(write)
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


@pytest.mark.slow
def test_an_import_that_is_ended_leaves_nothing(tmp_path: Path) -> None:
    # of noise: to write them takes seven times as long as to begin
    many = (100, 512, 512)
    noise = np.random.default_rng(0).integers(0, 2**16, many, np.uint16)
    np.save(tmp_path / "a.npy", noise)
    given = f"{STATED} --axes frame,depth,lateral --rate-hz 1"
    command = f"import {tmp_path}/a.npy --out {tmp_path}/r {given}".split()
    child = subprocess.Popen(
        [*SCLERAFORCE, *command], stderr=subprocess.PIPE, text=True
    )

    wait_until(
        lambda: child.poll() is not None or any(tmp_path.glob(".scleraforce-*.part"))
    )
    child.send_signal(signal.SIGTERM)
    _, error = child.communicate(timeout=FUSE_S)
    assert (child.returncode, error.strip()) == (130, "error: interrupted")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]


STATED = (
    "--eye eye-1 --gauge 22 --gap-mm 0.6 --refractive-index 1.38 --bits 16"
    " --width-mm 10 --depth-mm 4"
)


def test_an_interruption_inside_a_library_is_not_an_internal_fault(
    monkeypatch, capsys
) -> None:
    def compile_(*_: object, **__: object) -> None:
        # as Numba does when LLVM's callback was interrupted
        entry._note_interruption(SimpleNamespace(exc_type=KeyboardInterrupt))
        raise RuntimeError("no compiled object yet")

    monkeypatch.setattr(entry, "interrupted", Event())
    monkeypatch.setattr(entry.cli, "main", compile_)
    assert entry.run(["doctor"]) == 130
    assert capsys.readouterr().err == "error: interrupted\n"


def test_bash_completes_commands_and_choices(tmp_path: Path) -> None:
    command = tmp_path / "scleraforce"
    script = tmp_path / "completion"
    command.write_text(
        f"#!{sys.executable}\nfrom scleraforce.front.cli.main import main\nmain()\n"
    )
    command.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}"}

    def said(*call: str, **more: str) -> str:
        given = {"env": environment | more, "timeout": FUSE_S}
        return subprocess.run(
            call, capture_output=True, text=True, check=True, **given
        ).stdout

    script.write_text(said("scleraforce", _SCLERAFORCE_COMPLETE="bash_source"))
    for line, offered in (
        ("scleraforce mon", {"monitor", "monitor-reset"}),
        ("scleraforce init --preset l", {"living"}),
    ):
        asked = f"""source {script}; COMP_WORDS=({line}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
            _scleraforce_completion scleraforce; echo "${{COMPREPLY[@]}}\""""
        assert offered <= set(said("bash", "-c", asked).split())


def test_a_failed_finding_ends_doctor_with_code_1(
    monkeypatch: pytest.MonkeyPatch, shell
) -> None:
    found = [
        Finding("packages", "ok", "numpy 2.4.6"),
        Finding("a solve", "failed", "wrong", "report"),
    ]
    monkeypatch.setattr(installation_checks, "packages", lambda: found)
    monkeypatch.setattr(installation_checks, "machine", list)
    monkeypatch.setattr(installation_checks, "TRIALS", ())
    result = shell.json("doctor", code=1)
    assert not result["ok"]
    assert result["findings"][-1] == vars(found[-1])
    assert {"scleraforce", "python", "system", "seconds"} <= result.keys()


ESCAPES = "\x1b]0;owned\x07\x9b2J\x7f\u202e.png"


@pytest.mark.skipif(os.name != "posix", reason="a name that Windows does not allow")
@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0, f"read default {ESCAPES} --width-mm 15 --depth-mm 4"),
        (2, f"read default broken{ESCAPES}"),
        (2, f"read default missing{ESCAPES}"),
        (0, f"segment {ESCAPES} --out masks"),
        (2, f"show {ESCAPES}"),
        (2, f"show {ESCAPES}/{ESCAPES}"),
        (2, f"read ./{ESCAPES} frame.png"),
        (2, f"import broken{ESCAPES} --out new"),
        (2, f"evaluate default {ESCAPES}"),
        (2, ESCAPES),
        (2, f"read --{ESCAPES}"),
        (2, "read default " + os.fsdecode(b"\xff.png")),
    ],
)
def test_no_name_reaches_the_terminal_as_an_escape_sequence(
    tmp_path: Path, shell, monkeypatch: pytest.MonkeyPatch, code: int, words: str
) -> None:
    """Of operands, of files in a folder, of eyes, of commands; with and without a
    fault.
    """
    frame = write_one_frame(tmp_path / "r", recording_toml("a"))
    monkeypatch.chdir(tmp_path / "r")
    for name in (ESCAPES, "frame.png"):
        shutil.copy(frame, name)
    Path("broken" + ESCAPES).write_bytes(b"no picture")
    printed = "".join(shell.run(words, code=code))
    assert printed.replace("\n", "").isprintable()
    assert r"\x1b]0;owned\x07\x9b2J\x7f\u202e" in printed or r"\udcff" in printed


@pytest.mark.slow
def test_this_installation_is_well(shell):
    states = {
        finding["name"]: finding["state"]
        for finding in shell.json("doctor")["findings"]
    }
    assert states["packages"] == states["a solve"] == states["a reading"] == "ok"
