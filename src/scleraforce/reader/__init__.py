"""Read force class and force from frames with a trained model: NumPy, OpenCV and ONNX Runtime only.

`evaluate` needs the recording room too, and is imported by name where it is wanted.
"""

from scleraforce.reader.classifier import Classifier
from scleraforce.reader.force_reader import ForceReader
from scleraforce.reader.model import load_classifier, load_force_reader, load_model
from scleraforce.reader.raw_reader import RawReader
from scleraforce.reader.reader import Reader

__all__ = ["Classifier", "ForceReader", "RawReader", "Reader", "load_classifier", "load_force_reader", "load_model"]
