"""Read force class and force from frames with a trained model: NumPy, OpenCV and ONNX Runtime only."""

from scleraforce.reader.kinds import (
    Classifier as Classifier,
    ForceReader as ForceReader,
    RawReader as RawReader,
    Reader as Reader,
)
from scleraforce.reader.model import (
    load_classifier as load_classifier,
    load_force_reader as load_force_reader,
    load_model as load_model,
    suited as suited,
)
