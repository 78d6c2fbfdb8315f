"""scleraforce: the force of a needle on the eye, read from a single OCT slice.

`import scleraforce as sf` offers the names that docs/python.md describes; all else is
private and may change. Each name is imported when it is first used: PyTorch, SciPy,
OpenCV and ONNX Runtime are imported lazily.
"""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scleraforce.errors import InputError
    from scleraforce.learning.dataset import open_dataset
    from scleraforce.library.store import open_library
    from scleraforce.notebook.calibrating import calibrate
    from scleraforce.notebook.exporting import export
    from scleraforce.notebook.frames import (
        evaluate,
        load_model,
        read,
        save_wall,
        segment,
    )
    from scleraforce.notebook.importing import import_recording
    from scleraforce.notebook.monitoring import monitor
    from scleraforce.notebook.training import generate, library_of, train
    from scleraforce.notebook.virtual import phantom, simulate
    from scleraforce.recording.folder import Plane, read_recording
    from scleraforce.recording.images import read_frame
    from scleraforce.study import Study, parse_study, read_study

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
    "learning.dataset": ("open_dataset",),
    "errors": ("InputError",),
    "library.store": ("open_library",),
    "notebook.calibrating": ("calibrate",),
    "notebook.exporting": ("export",),
    "notebook.frames": ("evaluate", "load_model", "read", "save_wall", "segment"),
    "notebook.importing": ("import_recording",),
    "notebook.monitoring": ("monitor",),
    "notebook.training": ("generate", "library_of", "train"),
    "notebook.virtual": ("phantom", "simulate"),
    "recording.folder": ("Plane", "read_recording"),
    "recording.images": ("read_frame",),
    "study": ("Study", "parse_study", "read_study"),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

# Hidden from type checkers, to which it would make every name valid.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Import a public name (PEP 562), once."""
        if name == "__version__":
            # its imports take a tenth of a second
            from importlib.metadata import version

            value = version("scleraforce")
        elif name in _MODULE_OF:
            from importlib import import_module

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
