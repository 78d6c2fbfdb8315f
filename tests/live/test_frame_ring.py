"""The ring of frames, and the memory that is left for it."""

import errno
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scleraforce.base.errors import InputError
from scleraforce.live.companions.shared_frames import FrameRing, available_bytes


def frame(number, rows=3, columns=5):
    return (
        np.random.default_rng(number)
        .integers(0, 2**16, (rows, columns))
        .astype(np.uint16)
    )


def test_the_last_frames_are_there_and_no_others():
    ring = FrameRing.create(4, 3, 5)
    ring.put(1, frame(1))
    copied = ring.get(1)

    for latest in range(1, 14):
        ring.put(latest, frame(latest))
        assert (copied == frame(1)).all()

        for number in range(-5, 20):
            found = ring.get(number)
            if max(latest - 3, 1) <= number <= latest:
                assert (found == frame(number)).all()
            else:
                assert found is None


def test_more_than_there_is_is_refused_before_any_is_taken(monkeypatch):
    monkeypatch.setattr(os, "memfd_create", lambda _: pytest.fail("it was taken"))
    with pytest.raises(
        InputError,
        match=r"1200 frames of 16384 x 16384 pixels take 644,245 MB .* MB are there",
    ):
        FrameRing.create(1200, 16384, 16384)


def test_another_process_with_the_descriptor_sees_the_same_frames():
    ring = FrameRing.create(4, 3, 5)
    ring.put(1, frame(1))
    place = replace(ring.place, descriptor=os.dup(ring.place.descriptor))
    other = FrameRing(place)
    ring.put(2, frame(2))
    assert (other.get(1) == frame(1)).all()
    assert (other.get(2) == frame(2)).all()
    assert other.shape == (3, 5)


def test_a_frame_that_is_overwritten_during_its_copy_is_gone(monkeypatch):
    ring = FrameRing.create(2, 3, 5)
    preadv = os.preadv
    ring.put(1, frame(1))

    def slow(*place):
        ring.put(3, frame(3))  # the writer went round
        return preadv(*place)

    monkeypatch.setattr(os, "preadv", slow)
    assert ring.get(1) is None


def test_frames_of_8_bits_keep_their_values_and_a_frame_of_another_size_is_refused():
    ring = FrameRing.create(2, 3, 5)
    ring.put(1, np.full((3, 5), 200, dtype=np.uint8))
    assert ring.get(1).dtype == np.uint16
    assert (ring.get(1) == 200).all()

    for shape in ((1, 5), (5,), (3, 4), (5, 3)):
        with pytest.raises(ValueError, match="the ring has frames of"):
            ring.put(2, np.zeros(shape, dtype=np.uint16))

    assert (ring.get(1) == 200).all()


def test_too_little_memory_is_said_before_the_first_frame(monkeypatch):
    def none_left(*_):
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    monkeypatch.setattr(os, "posix_fallocate", none_left)
    with pytest.raises(
        InputError,
        match=r"memory: Cannot allocate memory for the last 1200 frames .* 630 MB; end",
    ):
        FrameRing.create(1200, 512, 513)


MB = 2**20


def group(
    folder: Path, names: tuple[str, str], most: object, used: int, cache: str = ""
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / names[0]).write_text(f"{most}\n")
    (folder / names[1]).write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 1\n{cache}\n")


def test_of_machine_and_control_groups_of_either_version_the_least_memory_counts(
    tmp_path,
):
    proc = tmp_path / "proc"
    groups = tmp_path / "groups"
    assert available_bytes(proc, groups) is None
    (proc / "self").mkdir(parents=True)
    (proc / "meminfo").write_text(
        "MemTotal: 9000 kB\nMemAvailable:    8192000 kB\nSwapFree: 0 kB\n"
    )
    assert available_bytes(proc, groups) == 8000 * MB
    names = "memory.max", "memory.current"
    (proc / "self" / "cgroup").write_text("0::/user.slice/app\n")
    group(groups / "user.slice" / "app", names, "max", 50 * MB)
    group(groups / "user.slice", names, 300 * MB, 200 * MB, f"inactive_file {30 * MB}")
    group(groups / "another", names, MB, 0)
    assert available_bytes(proc, groups) == 130 * MB
    group(groups / "user.slice", names, 300 * MB, 400 * MB)
    assert available_bytes(proc, groups) == 0
    (proc / "self" / "cgroup").write_text("5:cpu:/x\n4:memory:/docker/abc\n0::/\n")
    names = "memory.limit_in_bytes", "memory.usage_in_bytes"
    group(
        groups / "memory" / "docker" / "abc",
        names,
        500 * MB,
        100 * MB,
        f"total_inactive_file {10 * MB}",
    )
    group(groups / "memory", names, 2**63 - 4096, 0)
    assert available_bytes(proc, groups) == 410 * MB
