"""Read force class and force from frames with a trained model: NumPy, OpenCV and ONNX Runtime only.

`evaluate` needs the recording room too, and is imported by name where it is wanted.
"""

from scleraforce.reader.model import ForceReader, load_classifier, load_model
from scleraforce.reader.wall_reader import WallReader

__all__ = ["ForceReader", "WallReader", "load_classifier", "load_model"]
