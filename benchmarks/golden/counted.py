"""One piece of work in a process of its own, and what it took: modules, loops, files,
solves, passes, memory. Prints JSON.

python -m golden.counted import | command WORD... | read FRAME | segment FRAME
                         | monitor FRAME... | solves WHAT
"""

import json
import os
import runpy
import sys
import tracemalloc
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

SCLERAFORCE = Path(sys.executable).with_name("scleraforce")
# Code is no input; machine code and fonts are cached by an earlier run; Numba looks at
# each installed package.
CODE = ".py", ".pyc", ".so", ".pth", ".pyi", ".zip", ".cfg"
SYSTEM = "/proc", "/sys", "/dev", "/etc", "/usr/lib", "/usr/share"


def _modules() -> dict[str, int]:
    """Count the modules that are imported by now, and the compiled loops."""
    ours = sum(name.partition(".")[0] == "scleraforce" for name in sys.modules)
    modules = {"modules": len(sys.modules), "modules of scleraforce": ours}

    # imports more
    from golden.hooks import loops_so_far

    return modules | loops_so_far()


def _peak_kib(work: Callable[[], object]) -> int:
    """Return the memory that a piece of work takes at once, in whole KiB."""
    tracemalloc.start()
    try:
        work()
        return round(tracemalloc.get_traced_memory()[1] / 1024)
    finally:
        tracemalloc.stop()


class OpenedFiles:
    """The files that Python opens from now on, but for code, caches and the system's
    own.
    """

    def __init__(self) -> None:
        self._opened: Counter[str] = Counter()
        caches = os.environ.get("XDG_CACHE_HOME", "~/.cache")
        self._left_out = (*SYSTEM, str(Path(caches).expanduser()))
        sys.addaudithook(self._hear)

    def _hear(self, event: str, arguments: tuple[object, ...]) -> None:
        if event != "open" or not isinstance(arguments[0], str | bytes):
            return
        path = os.path.abspath(os.fsdecode(arguments[0]))
        is_package = ".dist-info/" in path
        if not (is_package or path.endswith(CODE) or path.startswith(self._left_out)):
            self._opened[path] += 1

    def counts(self) -> dict[str, int]:
        """Return how many files were opened, and how often."""
        return {"files": len(self._opened), "openings": self._opened.total()}


def command(words: list[str]) -> dict[str, int]:
    """Run a command of scleraforce; its output goes to standard error."""
    opened = OpenedFiles()
    sys.argv = [str(SCLERAFORCE), *words]
    output = sys.stdout
    sys.stdout = sys.stderr
    try:
        runpy.run_path(str(SCLERAFORCE), run_name="__main__")
    except SystemExit as end:
        if end.code:
            raise
    finally:
        sys.stdout = output
    return _modules() | opened.counts()


def read(frames: Sequence[str]) -> dict[str, int]:
    """Read a frame a second time, and count what goes over it."""
    import scleraforce as sf
    from golden.hooks import count_passes

    (frame,) = frames
    calls: Counter[str] = Counter()
    model = sf.load_model("default")

    def work() -> object:
        return sf.read(model, frame, youngs_modulus_pa=0.3e6)

    work()
    peak_kib = _peak_kib(work)
    opened = OpenedFiles()
    count_passes(calls, sf.read_frame(frame).size)
    work()
    return dict(calls) | opened.counts() | {"peak_kib": peak_kib}


def segment(frames: Sequence[str]) -> dict[str, int]:
    """Find the wall of a frame a second time, and count what goes over it."""
    import scleraforce as sf
    from golden.hooks import count_passes

    (frame,) = frames
    calls: Counter[str] = Counter()
    sf.segment(frame)
    peak_kib = _peak_kib(lambda: sf.segment(frame))
    count_passes(calls, sf.read_frame(frame).size)
    sf.segment(frame)
    return dict(calls) | {"peak_kib": peak_kib}


def monitor(frames: Sequence[str]) -> dict[str, int]:
    """Let a session of the monitor read frames, and count what goes over the last
    one.
    """
    import scleraforce as sf
    from golden.hooks import count_passes, monitored

    calls: Counter[str] = Counter()
    take = monitored([sf.read_frame(frame) for frame in frames])
    for _ in frames[:-2]:
        take()
    peak_kib = _peak_kib(take)
    count_passes(calls, sf.read_frame(frames[-1]).size)
    take()
    return dict(calls) | {"peak_kib": peak_kib}


def solves(whats: Sequence[str]) -> dict[str, int]:
    """Bend an eye, or solve a load path of the library, and count factorizations and
    solves.
    """
    from golden.hooks import count_solves, solve_load_path

    (what,) = whats
    calls: Counter[str] = Counter()
    count_solves(calls)

    import scleraforce as sf
    from golden.inputs import COARSE

    study = sf.parse_study(COARSE)
    if what == "load path":
        solve_load_path(sf.parse_study(SMALL_LIBRARY), 1)
    elif what == "sealed":
        sf.simulate(
            study,
            thickness_m=600e-6,
            force_n=0.03,
            mechanics="finite-strain",
            globe="sealed",
        )
    else:
        sf.simulate(study, thickness_m=600e-6, force_n=0.03, mechanics=what)
    return dict(calls)


SMALL_LIBRARY = """
[library]
thicknesses = 4
tension = { min = 1e-3, max = 0.21 }
tensions = 4
tips = 12
elements = 16
"""


def main() -> None:
    """Do what the words ask for."""
    kind, *words = sys.argv[1:]
    if kind == "import":
        import scleraforce  # noqa: F401 - counted

        counts = _modules()
    elif kind == "command":
        counts = command(words)
    else:
        counts = {
            "read": read,
            "segment": segment,
            "monitor": monitor,
            "solves": solves,
        }[kind](words)
    print(json.dumps(counts))


if __name__ == "__main__":
    main()
