"""The folder of the figures' results, which a later run of the same code reuses."""

from dataclasses import dataclass
from pathlib import Path

from figures.eyes import FigureEye


@dataclass(frozen=True)
class FiguresFolder:
    """One folder of figures."""

    path: Path

    def recording(self, eye: FigureEye) -> Path:
        """The eye's recording: raw frames, force log, truth.json. It appears last, and
        whole.
        """
        return self.path / "recordings" / eye.name

    def made(self, eye: FigureEye) -> Path:
        """The computed eye's own values, beside its recording."""
        return self.path / "eyes" / f"{eye.name}.npz"

    def work(self, name: str) -> Path:
        """A result that the commands leave: calibrations, answers, data set, models."""
        return self.path / name
