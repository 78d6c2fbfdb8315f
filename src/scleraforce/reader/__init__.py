"""Read the force class from slices with a trained model: NumPy, OpenCV and ONNX Runtime only.

`evaluate` needs the recording room too, and is imported by name where it is wanted.
"""

from scleraforce.reader.model import ForceReader, load_model

__all__ = ["ForceReader", "load_model"]
