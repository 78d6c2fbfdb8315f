"""The places at which the counts reach behind the public doors; a restructuring has to
mend this file alone.

- How often the code solves and passes over a frame shows nowhere. `count_solves` wraps
  rslab's factorizations and LAPACK's banded ones, `count_passes` OpenCV's functions and
  the package's compiled loops, before they are called.
- Load paths of the library are solved in processes of their own; `solve_load_path`
  solves one here.
"""

import sys
from collections import Counter
from collections.abc import Callable
from functools import partial
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
    for module_name, module in list(sys.modules.items()):
        if not module_name.startswith("scleraforce"):
            continue
        for name, value in list(vars(module).items()):
            if isinstance(value, CPUDispatcher):
                wrapper = wrappers.setdefault(
                    id(value),
                    _counting(value, taking_frames("calls of compiled loops"), calls),
                )
                setattr(module, name, wrapper)
    for name, value in list(vars(cv2).items()):
        if type(value).__name__ == "builtin_function_or_method":
            setattr(
                cv2, name, _counting(value, taking_frames("calls of OpenCV"), calls)
            )


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
