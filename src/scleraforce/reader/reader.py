"""What every trained model offers, whatever its kind."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from scleraforce.known.eye import NOTHING_KNOWN, Known
from scleraforce.reader.answers import Answer, LiveReading
from scleraforce.recording.folder import OctInfo
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.study import Study


class Reader(Protocol):
    """A trained model that answers to raw frames: `Classifier`, `ForceReader`, `RawReader`. Made by `load_model`."""

    @property
    def kind(self) -> str:
        """What the model's folder calls it: "classifier", "reader" or "raw-reader"."""

    @property
    def path(self) -> Path:
        """The model's folder."""

    @property
    def study(self) -> Study:
        """What it was trained with."""

    @property
    def record(self) -> Mapping[str, Any]:
        """The content of `model.json`."""

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making."""

    @property
    def classes(self) -> int:
        """Number of force classes."""

    @property
    def reads_force(self) -> bool:
        """Whether its answers have a force with its interval, not the class alone."""

    @property
    def serves_loop(self) -> bool:
        """Whether it may serve the control loop."""

    @property
    def fixed_modulus_pa(self) -> float | None:
        """Young's modulus that it reads every eye with; None: it takes each eye's own."""

    def read(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> Answer:
        """Read one raw frame with all that the model has.

        Args:
            frame: raw B-scan (row, column).
            scale: size of a pixel as stored, with the refractive index.
            known: of the eye; a model with a fixed modulus takes no notice of it.

        Raises:
            ValueError: no such frame (see `find_wall`).
            ModelError: the network cannot be run.
        """

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame within a millisecond or two: without the fit, and not asking `can_calibrate`.

        Arguments and errors are those of `read`.
        """

    def refusal(self, known: Known) -> str | None:
        """Return why the model cannot read an eye of which so much is known; None where it can."""

    def limits(self, known: Known, scan: OctInfo, gauge: int | None = None) -> tuple[str, ...]:
        """Return a sentence for each known quantity of an eye, its B-scans and its needle that the training lacked."""
