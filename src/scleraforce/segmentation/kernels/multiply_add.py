"""a * b + c, rounded once to single precision: what OpenCV's loops do on every processor that can."""

from collections.abc import Callable
from typing import Any

import numpy as np

from scleraforce.compiled import can_compile


def _compiled() -> Callable[..., Any]:
    """Return the instruction of the processor, for use in compiled loops."""
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def multiply_add(typing: Any, a: Any, b: Any, c: Any) -> Any:  # noqa: ARG001 - as Numba calls it
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
            return builder.fma(*arguments)

        return types.float32(types.float32, types.float32, types.float32), code

    return multiply_add


def _plain(a: np.float32, b: np.float32, c: np.float32) -> np.float32:
    return np.float32(np.float64(a) * np.float64(b) + np.float64(c))


multiply_add = _compiled() if can_compile() else _plain
