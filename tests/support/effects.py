"""Effects of running code: files in a folder, memory, addresses and opened files."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from platformdirs import user_cache_path
from waiting import FUSE_S, ends


def contents(folder: Path) -> dict[str, bytes]:
    """The bytes of each file below a folder, by its path there."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@contextmanager
def less_than(limit_bytes: float) -> Iterator[None]:
    """Check that at no time in between more memory is taken than this."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit_bytes
    finally:
        tracemalloc.stop()


STRACE = shutil.which("strace")
SCLERAFORCE = (
    sys.executable,
    "-c",
    "from scleraforce.front.cli.main import main; main()",
)
# Of the calls that name another host, or a file: what they were given is shown in full,
# descriptors with their paths.
CALLS = "connect,bind,sendto,sendmsg,sendmmsg,open,openat,creat,mkdir,mkdirat,rename,renameat,renameat2,link,symlink"
ADDRESS = re.compile(r'sin6?_addr=inet_(?:addr|pton)\((?:AF_INET6, )?"([^"]+)"')
OPENED = re.compile(
    r'\bopenat\((?:AT_FDCWD|\d+)<([^>]*)>, "([^"]*)", ([A-Z_|]+)[^)]*\)\s*= \d'
)


@dataclass(frozen=True)
class Traced:
    """Effects of a command: exit code, error output, addresses (IP) that it named,
    files that it opened to write.
    """

    code: int
    err: str
    addresses: frozenset[str]
    written: frozenset[Path]


def cache_of_its_own(folder: Path) -> dict[str, str]:
    """Return the environment of commands whose cache is a folder; it shares the
    compiled loops, which take a minute.
    """
    shared = user_cache_path("scleraforce") / "compiled"
    shared.mkdir(parents=True, exist_ok=True)
    (folder / "scleraforce").mkdir(parents=True, exist_ok=True)
    (folder / "scleraforce" / "compiled").symlink_to(shared)
    return {"XDG_CACHE_HOME": str(folder)}


def fresh_home(folder: Path) -> dict[str, str]:
    """Return an environment whose home, caches and temporary files are below a
    folder.
    """
    places = {"HOME": folder / "home", "TMPDIR": folder / "temporary"}
    for place in places.values():
        place.mkdir(parents=True, exist_ok=True)

    if not (places["HOME"] / ".cache").exists():
        cache_of_its_own(places["HOME"] / ".cache")

    kept = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("XDG_", "ORT_", "MPL"))
    }
    return (
        kept
        | {name: str(place) for name, place in places.items()}
        | {"PYTHONDONTWRITEBYTECODE": "1"}
    )


def traced(
    folder: Path, *arguments: object, until: Callable[[str], bool] | None = None
) -> Traced:
    """Run a command of scleraforce in a folder; with `until`, Ctrl-C ends it after that
    line on standard error.
    """
    assert STRACE
    log = folder / "strace.log"
    command = [
        STRACE,
        "-f",
        "--seccomp-bpf",
        "-qq",
        "-y",
        "-s",
        "4096",
        "-e",
        f"trace={CALLS}",
        "-o",
        str(log),
    ]
    process = subprocess.Popen(
        [*command, *SCLERAFORCE, *map(str, arguments)],
        cwd=folder,
        env=fresh_home(folder),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stderr

    with process.stderr, ends(process.stderr):
        lines = []
        while until and not (lines and until(lines[-1])):
            lines.append(process.stderr.readline())
            assert lines[-1], lines

        if until:
            # what sends things in the background begins after some seconds; a sleep,
            # since nothing tells that it will not begin
            time.sleep(5.0)
            os.killpg(process.pid, signal.SIGINT)

        lines.append(process.stderr.read())

    text = log.read_text()
    log.unlink()
    files = {
        Path(base, name)
        for base, name, flags in OPENED.findall(text)
        if {"O_WRONLY", "O_RDWR", "O_CREAT"} & set(flags.split("|"))
    }

    return Traced(
        process.wait(FUSE_S),
        "".join(lines),
        frozenset(ADDRESS.findall(text)),
        frozenset(files),
    )
