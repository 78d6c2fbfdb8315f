"""The `[wall_finder]` section of a study: the network that finds the wall in a raw frame, and its descent."""

from dataclasses import dataclass

from scleraforce.errors import StudyError
from scleraforce.study.fields import check_fields, quantity


@dataclass(frozen=True, kw_only=True)
class WallFinderStudy:
    """Frames are reduced to `rows` x `columns`; `channels` are those of the levels, each of half the resolution.

    The first level already has half the frame's rows and columns, so both are multiples of two to the power of the
    number of levels. Every batch is of scenes that no other has. `target_rows` is the standard deviation that the
    truth is blurred with, in rows of the reduced frame.
    """

    rows: int = quantity(128, None, 16, 1024)
    columns: int = quantity(176, None, 16, 1024)
    channels: tuple[int, ...] = quantity((12, 20, 32, 48), None, 1, 512)
    target_rows: float = quantity(0.6, None, 0.05, 10.0)
    learning_rate: float = quantity(0.003, None, 1e-8, 10.0)
    warmup: float = quantity(0.05, None, 0.0, 0.9)
    weight_decay: float = quantity(1e-4, None, 0.0, 1.0)
    max_gradient_norm: float = quantity(5.0, None, 1e-6, 1e6)
    batch_size: int = quantity(8, None, 1, 10_000)
    batches: int = quantity(2000, None, 1, 10_000_000)
    validation_scenes: int = quantity(400, None, 1, 1_000_000)
    seed: int = quantity(0, None, 0, 2**31 - 1)

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.channels:
            raise StudyError("channels: an empty list; give at least one value")
        least = 2 ** len(self.channels)
        for key in ("rows", "columns"):
            if getattr(self, key) % least:
                raise StudyError(
                    f"{key}: {getattr(self, key)} is not a multiple of {least}, as {len(self.channels)} levels need"
                )
