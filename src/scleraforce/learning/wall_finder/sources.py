"""The sources that decide a wall finder's weights: a shipped one that was trained with others is out of date.

They are listed, not followed through their imports: a change elsewhere in a module that they share with other rooms
would make the shipped network old for nothing. Of such modules the functions that they call count.
"""

import hashlib
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scleraforce.laboratory import speckle
from scleraforce.laboratory.bscan import column_crossings
from scleraforce.laboratory.optics import Pose, Shadow
from scleraforce.laboratory.scenes import (
    inside,
    light,
    over,
    picture,
    rays,
    scanner,
    scene,
    tissue,
    visible,
    wall,
    window,
)
from scleraforce.learning.classifier.training import learning_rate, repeatable
from scleraforce.learning.wall_finder import graph, network, samples, training
from scleraforce.segmentation import reduced
from scleraforce.source_hash import hash_files
from scleraforce.study import sampled, scenes, wall_finder

MODULES = (
    inside, light, over, picture, rays, scanner, scene, tissue, visible, wall, window,
    speckle, graph, network, samples, training, reduced, sampled, scenes, wall_finder,
)  # fmt: skip
SHARED: tuple[Callable[..., Any], ...] = (column_crossings, Pose, Shadow, learning_rate, repeatable)


def finder_sources_hash() -> str:
    """Return the SHA-256, in hexadecimal, of the sources that decide a wall finder's weights."""
    digest = hashlib.sha256(hash_files(Path(str(module.__file__)) for module in MODULES).encode())
    for shared in SHARED:
        digest.update(inspect.getsource(shared).encode())
    return digest.hexdigest()
