"""scleraforce: the force of a needle on the eye, read from a single OCT slice.

`import scleraforce as sf` offers the names that docs/python.md describes; all else is
private and may change. Each name is imported when it is first used: PyTorch, SciPy,
OpenCV and ONNX Runtime are imported lazily.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scleraforce.base.errors import InputError
    from scleraforce.front.api.calibrating import calibrate
    from scleraforce.front.api.exporting import export
    from scleraforce.front.api.importing import import_recording
    from scleraforce.front.api.monitoring import monitor
    from scleraforce.front.api.reading_frames import (
        evaluate,
        load_model,
        read,
        save_wall,
        segment,
    )
    from scleraforce.front.api.simulating import phantom, simulate
    from scleraforce.front.api.training import generate, library_of, train
    from scleraforce.lab.training.slice_dataset import open_dataset
    from scleraforce.library.library_store import open_library
    from scleraforce.recordings.formats.image_files import read_frame
    from scleraforce.recordings.recording_folder import read_recording
    from scleraforce.records.scan import Plane
    from scleraforce.records.study import Study, parse_study, read_study

    __version__: str

__all__ = [
    "InputError",
    "Plane",
    "Study",
    "__version__",
    "calibrate",
    "evaluate",
    "export",
    "generate",
    "import_recording",
    "library_of",
    "load_model",
    "monitor",
    "open_dataset",
    "open_library",
    "parse_study",
    "phantom",
    "read",
    "read_frame",
    "read_recording",
    "read_study",
    "save_wall",
    "segment",
    "simulate",
    "train",
]

# ONNX Runtime keeps a device id and a queue of events in the user's cache and sends
# them over the network. It reads this when it is imported, and only then. This line
# precedes that import, and child processes inherit it.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

_MODULES = {
    "lab.training.slice_dataset": ("open_dataset",),
    "base.errors": ("InputError",),
    "library.library_store": ("open_library",),
    "front.api.calibrating": ("calibrate",),
    "front.api.exporting": ("export",),
    "front.api.reading_frames": (
        "evaluate",
        "load_model",
        "read",
        "save_wall",
        "segment",
    ),
    "front.api.importing": ("import_recording",),
    "front.api.monitoring": ("monitor",),
    "front.api.training": ("generate", "library_of", "train"),
    "front.api.simulating": ("phantom", "simulate"),
    "records.scan": ("Plane",),
    "recordings.recording_folder": ("read_recording",),
    "recordings.formats.image_files": ("read_frame",),
    "records.study": ("Study", "parse_study", "read_study"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

# Hidden from type checkers, to which it would make every name valid.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Import a public name (PEP 562), once."""
        if name == "__version__":
            # 21 ms: not for those who ask for no version
            from importlib.metadata import version

            value = version("scleraforce")
        elif name in _MODULE_OF:
            value = getattr(import_module(f"scleraforce.{_MODULE_OF[name]}"), name)
        else:
            raise AttributeError(
                f"module {__name__!r} has no attribute {name!r}; docs/python.md lists"
                " what it offers"
            )

        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Return the public names."""
    return list(__all__)
