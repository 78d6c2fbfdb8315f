"""Types of NumPy arrays by their elements; docstrings and the endings of names state
shapes, axes and units.
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Reals = NDArray[np.floating[Any]]  # of any precision
Integers = NDArray[np.int64]
Places = NDArray[np.intp]
Indices = NDArray[np.uintp]  # not negative: Numba need not ask
Flags = NDArray[np.bool_]
Counts = NDArray[np.uint16]
Bytes = NDArray[np.uint8]
# a formula of numbers and of arrays; Numba compiles it for numbers
Number = TypeVar("Number", float, Floats)
