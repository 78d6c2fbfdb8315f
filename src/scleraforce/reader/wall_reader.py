"""A model of kind "reader": a network that reads the force from a slice, and the response library for the fit."""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scleraforce.known.eye import Known
from scleraforce.library.responses import Library
from scleraforce.reader.readings import METHODS, Reading
from scleraforce.study import Study

__all__ = ["SHIFTS", "SliceNetwork", "WallReader"]


CONTACTS = 32  # polar angles whose libraries are kept
# Of the slices that the network reads of one frame, in rows: the first is the slice itself. A slice of black and white
# says nothing of where in its pixels a boundary lies; a reading of one jumps when a drifting eye crosses a row.
SHIFTS = (0.0, 0.5)


class SliceNetwork(Protocol):
    """What reads slices: see `WallReader.read`."""

    @property
    def provenance(self) -> Mapping[str, str]: ...  # noqa: D102 - described by the class
    def read(self, cuts: NDArray[np.uint8], known: Known) -> Reading: ...  # noqa: D102


class WallReader:
    """Reads force, interval and contact from a wall. Made by `load_model`; all of it belongs together.

    `default` names the method whose reading is the answer, "network" or "fit"; the other one checks it.
    """

    kind = "reader"

    def __init__(
        self, path: Path, study: Study, record: Mapping[str, Any], network: SliceNetwork, library: Library, default: str
    ) -> None:
        if default not in METHODS:
            raise ValueError(f"default: found {default!r}, expected {' or '.join(METHODS)}")
        self.path = path
        self.study = study
        self.record = record
        self.library = library
        self.default = default
        self._network = network
        self._library_of = lru_cache(maxsize=CONTACTS)(library.for_contact)

    @property
    def classes(self) -> int:
        """Number of force classes."""
        return len(self.study.classes.bounds_n) + 1

    @property
    def other(self) -> str:
        """The method that checks the default."""
        return METHODS[1 - METHODS.index(self.default)]

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making."""
        return self._network.provenance

    def library_at(self, polar_rad: float | None) -> Library:
        """Return the library for a contact's polar angle; that in the middle of the study's where it is not known.

        Angles beyond the library's count as its largest.
        """
        if polar_rad is None:
            return self.library
        return self._library_of(min(max(polar_rad, 0.0), float(self.library.polar_rad[-1])))

    def read(self, cuts: NDArray[np.uint8], known: Known) -> Reading:
        """Return what the network reads.

        Args:
            cuts: slices of one wall, of the study's size (slice, row, column), 255 where wall is, 0 elsewhere.
            known: of the eye.
        """
        return self._network.read(cuts, known)
