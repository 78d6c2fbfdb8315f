"""Checks before a monitor serves: addresses, folders, open files."""

import re
import resource
import socket
from pathlib import Path

import pytest

from scleraforce.errors import InputError
from scleraforce.service.black_box.decision_log import DecisionLog
from scleraforce.service.startup import allow_files, listen, try_folders


@pytest.mark.parametrize("host", ["", " ", "no-such-host.invalid", "x" * 64 + ".example", "203.0.113.7", "a\nb"])
def test_a_host_that_is_no_address_of_this_machine_is_refused_in_one_line(host: str) -> None:
    with pytest.raises(InputError) as refused:
        listen(host, 0)
    assert str(refused.value).startswith(f"--host {host!r}" if host.strip() else "--host: empty")
    assert "\n" not in str(refused.value)


def test_a_port_that_is_taken_is_named_with_its_option() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        words = f"127.0.0.1:{port}: Address already in use; give another --web-port, or end what listens there"
        with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
            listen("127.0.0.1", port, "web-")


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this machine has no IPv6")
def test_an_address_of_ipv6_is_listened_on() -> None:
    with listen("::1", 0) as listener, socket.create_connection(listener.getsockname()[:2]):
        pass


def refusal(black_box: Path, record: Path | None = None) -> str:
    with pytest.raises(InputError) as refused:
        try_folders(black_box, record)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_folders_that_can_be_written_are_left_as_the_black_box_finds_them(tmp_path: Path) -> None:
    for _ in range(2):
        try_folders(tmp_path / "a" / "box", tmp_path / "b" / "session")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "box", "decisions-000001.jsonl", "log"]


def test_a_black_box_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert "Not a directory" in refusal(tmp_path / "file" / "box")
    assert "File name too long" in refusal(tmp_path / ("x" * 300))
    assert "/proc/box" in refusal(Path("/proc/box"))
    assert (tmp_path / "file").read_text() == "mine"


def test_a_black_box_of_another_monitor_is_refused(tmp_path: Path) -> None:
    other = DecisionLog(tmp_path / "log")
    assert "in use by another monitor" in refusal(tmp_path)
    other.close()


def test_a_recording_that_could_not_be_made_is_refused_before_anything_is(tmp_path: Path) -> None:
    box = tmp_path / "box"
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    assert "exists already" in refusal(box, tmp_path / "there")
    assert "exists already" in refusal(box, tmp_path / "link")
    assert "Not a directory" in refusal(box, tmp_path / "file" / "session")
    assert "File name too long" in refusal(box, tmp_path / ("x" * 300))
    assert "--record /proc/session" in refusal(box, Path("/proc/session"))
    assert "the folder of the black box is there" in refusal(box, box)
    assert "the folder of the black box is there" in refusal(box / "inside", box)
    assert not box.exists()


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The limits of a process; the last ones count."""
    found = [(256, 1024)]
    monkeypatch.setattr(resource, "getrlimit", lambda _: found[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, both: found.append(both))
    return found


def test_a_low_limit_is_raised_and_a_high_one_is_left_alone(limits: list[tuple[int, int]]) -> None:
    allow_files(200)
    assert limits == [(256, 1024)]
    allow_files(384)
    assert limits[-1] == (384, 1024)


def test_a_hard_limit_below_the_need_is_refused_with_both_numbers(limits: list[tuple[int, int]]) -> None:
    with pytest.raises(InputError, match=r"at most 1024 .* needs 1025"):
        allow_files(1025)
    assert limits == [(256, 1024)]
