"""The sources that decide a reader: its library, its weights, its intervals. One of others is out of date.

They are what the build of a library and the training import, within the rooms that compute: frames, folders and
messages decide nothing. Of modules that also serve the reading of frames, the functions that the training calls count.
"""

import hashlib
import inspect
from collections.abc import Callable
from typing import Any

from scleraforce.reader.interval_factors import IntervalFactors
from scleraforce.reader.readings import fit_reading
from scleraforce.segmentation.observations import observe_points
from scleraforce.source_hash import PACKAGE, hash_files, sources_in_rooms

STEPS = (
    "scleraforce.library.build", "scleraforce.library.base_plane", "scleraforce.learning.reader.training",
    "scleraforce.learning.reader.graph", "scleraforce.learning.reader.intervals",
)  # fmt: skip
# Imported on the way, and not run: linear eyes, stores, whole models, what only the classifier needs.
NOT_RUN = (
    "scleraforce.calibration.linear_eye", "scleraforce.library.store",
    "scleraforce.known.calibration_file", "scleraforce.reader.force_reader", "scleraforce.reader.model",
    "scleraforce.learning.classifier.network", "scleraforce.learning.classifier.samples",
)  # fmt: skip
ROOMS = ("calibration", "eye", "fitting", "known", "learning", "library", "mechanics", "section")
MODULES = (
    "reader/force_distribution.py", "reader/given.py", "reader/interval_scores.py", "reader/interval_traits.py",
    "reader/slice_network.py", "reader/told_network.py", "study/sampled.py", "compiled.py",
)  # fmt: skip
SHARED: tuple[Callable[..., Any], ...] = (
    IntervalFactors.of_network, IntervalFactors.of_fit, fit_reading, observe_points,
)  # fmt: skip


def reader_files() -> list[str]:
    """Return the files that count as a whole, as places in the package."""
    return sources_in_rooms(*STEPS, rooms=ROOMS, beside=MODULES, apart_from=NOT_RUN)


def reader_sources_hash() -> str:
    """Return the SHA-256, in hexadecimal, of the sources that decide a reader."""
    digest = hashlib.sha256(hash_files(PACKAGE / name for name in reader_files()).encode())
    for shared in SHARED:
        digest.update(inspect.getsource(shared).encode())
    return digest.hexdigest()
