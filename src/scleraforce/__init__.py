"""scleraforce: the force of a needle on the eye, read from a single OCT slice.

`import scleraforce as sf` offers what docs/python.md describes; all else is private and may change. Each name is
imported when it is first used: PyTorch, SciPy, OpenCV and ONNX Runtime come with what needs them.
"""

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scleraforce.errors import InputError
    from scleraforce.learning.dataset import open_dataset
    from scleraforce.library.store import open_library
    from scleraforce.notebook.calibrating import calibrate
    from scleraforce.notebook.evaluating import evaluate
    from scleraforce.notebook.frames import load_model, read, segment
    from scleraforce.notebook.importing import import_recording
    from scleraforce.notebook.training import generate, library_of, train
    from scleraforce.notebook.virtual import phantom, simulate
    from scleraforce.recording.folder import read_recording
    from scleraforce.recording.images import read_frame
    from scleraforce.study.records import Study
    from scleraforce.study.toml import parse_study, read_study

    __version__: str

__all__ = [
    "InputError",
    "Study",
    "__version__",
    "calibrate",
    "evaluate",
    "generate",
    "import_recording",
    "library_of",
    "load_model",
    "open_dataset",
    "open_library",
    "parse_study",
    "phantom",
    "read",
    "read_frame",
    "read_recording",
    "read_study",
    "segment",
    "simulate",
    "train",
]

# ONNX Runtime keeps a device id and a queue of events in the user's cache and sends them over the network. It reads
# this when it is imported, and only then. Every module of ours comes after it, and processes that we start inherit it.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

_MODULES = {
    "InputError": "errors",
    "Study": "study.records",
    "calibrate": "notebook.calibrating",
    "evaluate": "notebook.evaluating",
    "generate": "notebook.training",
    "import_recording": "notebook.importing",
    "library_of": "notebook.training",
    "load_model": "notebook.frames",
    "open_dataset": "learning.dataset",
    "open_library": "library.store",
    "parse_study": "study.toml",
    "phantom": "notebook.virtual",
    "read": "notebook.frames",
    "read_frame": "recording.images",
    "read_recording": "recording.folder",
    "read_study": "study.toml",
    "segment": "notebook.frames",
    "simulate": "notebook.virtual",
    "train": "notebook.training",
}

# Hidden from type checkers, to which it would make every name valid.
if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        """Import what is asked for (PEP 562), once."""
        if name == "__version__":
            from importlib.metadata import version  # a tenth of a second, with all that it imports

            value = version("scleraforce")
        elif name in _MODULES:
            from importlib import import_module

            value = getattr(import_module(f"scleraforce.{_MODULES[name]}"), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}; docs/python.md lists what it offers")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Return what is offered."""
    return list(__all__)
