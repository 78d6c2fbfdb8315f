"""Read force class and force from frames with a trained model: NumPy, OpenCV and ONNX Runtime only.

`evaluate` needs the recording room too, and is imported by name where it is wanted.
"""

from scleraforce.reader.classifier import Classifier as Classifier
from scleraforce.reader.force_reader import ForceReader as ForceReader
from scleraforce.reader.model import (
    load_classifier as load_classifier,
    load_force_reader as load_force_reader,
    load_model as load_model,
)
from scleraforce.reader.raw_reader import RawReader as RawReader
from scleraforce.reader.reader import Reader as Reader
