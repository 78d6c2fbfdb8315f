"""scleraforce: the force of a needle on the eye, read from a single OCT slice.

`import scleraforce as sf` offers the names that docs/python.md describes; all else is
private and may change. Each name is imported when it is first used: PyTorch, SciPy,
OpenCV and ONNX Runtime are imported lazily. Type checkers read `__init__.pyi`.
"""

import os

from scleraforce.front.api.public_names import MODULE_OF, names_on_demand

# ONNX Runtime keeps a device id and a queue of events in the user's cache and sends
# them over the network. It reads this when it is imported, and only then. This line
# precedes that import, and child processes inherit it.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

__all__ = sorted(MODULE_OF)  # the stub lists them
__getattr__, __dir__ = names_on_demand(globals())
