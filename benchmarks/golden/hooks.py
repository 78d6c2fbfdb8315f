"""The places at which the counts reach behind the public doors; a restructuring has to
mend this file alone.

- How often the code solves and passes over a frame shows nowhere. `count_solves` wraps
  rslab's factorizations and LAPACK's banded ones, `count_passes` OpenCV's functions and
  the package's compiled loops, before they are called.
- Which compiled loops a process loaded, and which it had to compile, only Numba's own
  statistics say (`loops_so_far`).
- Load paths of the library are solved in processes of their own; `solve_load_path`
  solves one here. The monitor decides behind a socket; `monitored` feeds its session.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

Calls = Counter[str]


def count_solves(calls: Calls) -> None:
    """Count sparse and banded factorizations and solves, from now on; before the
    mechanics are imported.
    """
    import rslab
    import scipy.linalg.lapack as lapack

    analyze = rslab.analyze

    class Analysed:
        """An analysis that counts its factorizations."""

        def __init__(self, *arguments: Any, **options: Any) -> None:
            self._analysed = analyze(*arguments, **options)

        def factor(self, data: Any) -> "Factor":
            calls["sparse factorizations"] += 1
            return Factor(self._analysed.factor(data))

    class Factor:
        """A factorization that counts its solves."""

        def __init__(self, factor: Any) -> None:
            self._factor = factor

        def solve(self, load: Any) -> Any:
            calls["sparse solves"] += 1
            calls["sparse right-hand sides"] += 1
            return self._factor.solve(load)

        def solve_many(self, loads: Any) -> Any:
            calls["sparse solves"] += 1
            calls["sparse right-hand sides"] += loads.shape[1]
            return self._factor.solve_many(loads)

    rslab.analyze = Analysed
    for name, words in {
        "dgbtrf": "banded factorizations",
        "dpbtrf": "banded factorizations",
        "dgbtrs": "banded solves",
        "dpbtrs": "banded solves",
    }.items():
        function = getattr(lapack, name)
        setattr(lapack, name, _counting(function, partial(_always, words), calls))


def count_passes(calls: Calls, frame_pixels: int) -> None:
    """Count the calls of compiled loops and of OpenCV that take a whole frame, and all
    calls of compiled loops.

    The loops must have been called before: machine code that is not loaded yet would be
    compiled with the wrappers.
    """
    import cv2
    from numba.core.registry import CPUDispatcher

    def taking_frames(kind: str) -> Callable[[tuple[Any, ...]], str]:
        def name_of(arguments: tuple[Any, ...]) -> str:
            whole = any(
                isinstance(each, np.ndarray) and each.size >= frame_pixels
                for each in arguments
            )
            return f"{kind} over a frame" if whole else f"other {kind}"

        return name_of

    wrappers: dict[int, Any] = {}
    for module, name, loops in _loops_of_modules(CPUDispatcher):
        wrapper = wrappers.setdefault(
            id(loops),
            _counting(loops, taking_frames("calls of compiled loops"), calls),
        )
        setattr(module, name, wrapper)
    for name, value in list(vars(cv2).items()):
        if type(value).__name__ == "builtin_function_or_method":
            setattr(
                cv2, name, _counting(value, taking_frames("calls of OpenCV"), calls)
            )


def loops_so_far() -> dict[str, int]:
    """Count the compiled loops that this process has loaded from the cache, and those
    that it has compiled.
    """
    # without Numba there are none, and importing it would count
    registry = sys.modules.get("numba.core.registry")
    if registry is None:
        return {"loops loaded": 0, "loops compiled": 0}

    found = {id(one): one for *_, one in _loops_of_modules(registry.CPUDispatcher)}
    statistics = [loops.stats for loops in found.values()]
    return {
        "loops loaded": sum(sum(one.cache_hits.values()) for one in statistics),
        "loops compiled": sum(sum(one.cache_misses.values()) for one in statistics),
    }


def _loops_of_modules(kind: type) -> Iterator[tuple[ModuleType, str, Any]]:
    """Yield each module of the package, and the name and the dispatcher of each of its
    compiled loops.
    """
    for module_name, module in list(sys.modules.items()):
        if module_name.startswith("scleraforce"):
            for name, value in list(vars(module).items()):
                if isinstance(value, kind):
                    yield module, name, value


def _always(words: str, _arguments: tuple[Any, ...]) -> str:
    return words


def _counting(
    function: Callable[..., Any],
    name_of: Callable[[tuple[Any, ...]], str],
    calls: Calls,
) -> Callable[..., Any]:
    def counted(*arguments: Any, **options: Any) -> Any:
        calls[name_of(arguments)] += 1
        return function(*arguments, **options)

    return counted


def solve_load_path(study: Any, unit: int) -> None:
    """Solve a load path of a study's library in this process."""
    from scleraforce.library.library_plan import plan_library
    from scleraforce.library.library_store import solve_path

    solve_path(plan_library(study), unit)


def monitored(frames: Sequence[Any]) -> Callable[[], None]:
    """Return what lets a monitor's session take the next one of some frames."""
    from monitor.watch import limits_of
    from scleraforce.live.monitor_session import MonitorSession
    from scleraforce.live.network.scanner_frame import ScannerFrame
    from scleraforce.reading.eye_reader import EyeReader
    from scleraforce.reading.load_model import load_force_reader
    from scleraforce.records.model_folder import SHIPPED_READER
    from scleraforce.records.scan import PixelScale
    from scleraforce.records.setup import Setup

    model = load_force_reader(SHIPPED_READER)
    reader = EyeReader(model, Setup(), by="network")
    session = MonitorSession(reader, limits_of(model))
    scale = PixelScale.of(model.study.oct)
    coming = enumerate(frames, start=1)

    def take() -> None:
        number, pixels = next(coming)
        image = ScannerFrame(pixels, lateral_m=scale.lateral_m, depth_m=scale.depth_m)
        session.take_frame(session.frame(image, number, 1, 0.01 * number))

    return take
