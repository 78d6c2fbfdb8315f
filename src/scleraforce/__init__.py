"""scleraforce: the force of a needle on the eye, read from a single OCT slice."""

import os
from importlib.metadata import version

__all__ = ["__version__"]
__version__ = version("scleraforce")

# ONNX Runtime keeps a device id and a queue of events in the user's cache and sends them over the network. It reads
# this when it is imported, and only then. Every module of ours comes after it, and processes that we start inherit it.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"
