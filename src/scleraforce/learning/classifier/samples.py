"""What a network learns from: slices with their classes, in memory as bytes."""

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.study import ClassesStudy


@dataclass(frozen=True)
class Samples:
    """Slices, uint8 of shape (sample, row, column) with 0 or 255, and their classes, shape (sample,)."""

    slices: NDArray[np.uint8]
    target: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.target)

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """The slices as a view, one row a sample, shape (sample, row * column)."""
        return self.slices.reshape(len(self.slices), -1)


def classes_at_modulus(force_n: NDArray[np.float64], ratio: float, classes: ClassesStudy) -> NDArray[np.int64]:
    """Return the class of each slice, shape (slice,), if the wall were `ratio` times as stiff.

    In linear mechanics the slice of a force F on a wall of modulus E is that of F E'/E on a wall of E' (under pressure
    and weight that scale alike, which bend the wall far less than the needle).

    >>> classes_at_modulus(np.array([0.028]), 1.1, ClassesStudy()).tolist()
    [2]
    """
    return np.array([classes.classify(force) for force in ratio * force_n], dtype=np.int64)


@dataclass(frozen=True)
class Normalisation:
    """How pixels enter the network: share of training slices with wall at each pixel, and which pixels vary at all.

    Both of shape (row * column,). Centred inputs condition the gradient descent far better than 0 and 1 (LeCun et al.,
    "Efficient BackProp", 1998, sec. 4.3). A pixel that never varies says nothing in training; its weights are zero.
    """

    mean: NDArray[np.float32]
    varies: NDArray[np.bool_]


def normalisation(training: Samples, mirror: bool = False) -> Normalisation:
    """Measure the mean of each pixel (as 0 to 1) over the training slices, and over their mirror images if asked.

    >>> slices = np.array([[[0, 255]], [[0, 0]]], dtype=np.uint8)
    >>> normalisation(Samples(slices, np.array([0, 1]))).mean.tolist()
    [0.0, 0.5]
    """
    wall, count = np.count_nonzero(training.slices, axis=0), len(training)
    if mirror:
        wall, count = wall + wall[:, ::-1], 2 * count
    mean = (wall / count).astype(np.float32)
    return Normalisation(mean.ravel(), ((wall > 0) & (wall < count)).ravel())


def mirrored_pixels(norm: Normalisation, columns: int) -> NDArray[np.intp]:
    """Return, for each varying pixel, the number of the varying pixel on the other side of the slice.

    Args:
        norm: of samples and their mirror images.
        columns: of a slice.
    """
    number = np.full(norm.varies.size, -1)
    number[norm.varies] = np.arange(np.count_nonzero(norm.varies))
    across: NDArray[np.intp] = number.reshape(-1, columns)[:, ::-1].ravel()[norm.varies]
    return across


def content_hash(*parts: Samples) -> str:
    """Return the SHA-256 of slices and classes, in hexadecimal: the identity of a data set whatever its storage."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(np.ascontiguousarray(part.slices).data)
        digest.update(np.ascontiguousarray(part.target, dtype="<i8").data)
    return digest.hexdigest()
