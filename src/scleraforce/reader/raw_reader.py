"""A model of kind "raw-reader": a network that reads the force from the raw frame, without a binary slice."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, final

from scleraforce.known.eye import NOTHING_KNOWN, Known
from scleraforce.reader.answers import Answer, LiveReading, unusable
from scleraforce.reader.judged import judged_answer
from scleraforce.reader.limits import other_index, outside_training, raw_limits
from scleraforce.reader.look import Look, can_calibrate, look
from scleraforce.reader.needle_gap import needle_elsewhere, read_by_fit
from scleraforce.reader.raw_network import OnnxRawNetwork
from scleraforce.reader.verdicts import dent_leaves, too_little_wall
from scleraforce.recording.folder import OctInfo
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.frame_window import FrameWindow
from scleraforce.segmentation.observed import segmented_boundaries, surface
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import Study


@final
class RawReader:
    """Reads force, interval and contact from a raw frame; see `Reader`. Made by `load_model`.

    The frame is segmented as for every model: that says whether it shows the wall of an eye at all, whether the dent
    leaves the window and what else is seen. The force is the network's, which sees the frame itself. Nothing checks it.
    """

    kind = "raw-reader"
    reads_force = True
    serves_loop = False  # its own second opinion would be that of the same network
    fixed_modulus_pa = None

    def __init__(
        self,
        path: Path,
        study: Study,
        record: Mapping[str, Any],
        network: OnnxRawNetwork,
        finder: WallFinder | None = None,
    ) -> None:
        self.path = path
        self.study = study
        self.record = record
        self._network = network
        self._finder = finder
        self._window = FrameWindow.of(study.raw_reader)

    @property
    def classes(self) -> int:
        """Number of force classes."""
        return len(self.study.classes.bounds_n) + 1

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making."""
        return self._network.provenance

    def read(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> Answer:
        """Read one raw frame; see `Reader.read`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m, finder=self._finder)
        answer = seen.told(self._read(seen, frame, scale, known))
        if seen.reason:
            return answer
        return replace(answer, can_calibrate=can_calibrate(seen, segmented_boundaries(seen.segmentation, scale)))

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame in the control loop; see `Reader.read_live`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m)
        answer = seen.told(self._read(seen, frame, scale, known))
        return LiveReading(answer, seen.segmentation.outer_row, seen.segmentation.inner_row)

    def refusal(self, known: Known) -> str | None:
        """Return why the model cannot read an eye; see `Reader.refusal`."""
        return outside_training(known, read_by_fit(self.study.reader), self.study.library)

    def limits(self, known: Known, scan: OctInfo, gauge: int | None = None) -> tuple[str, ...]:
        """Return where an eye and its B-scans lie outside the training; see `Reader.limits`."""
        return raw_limits(self.study, known, scan, gauge)

    def _read(self, seen: Look, frame: Pixels, scale: PixelScale, known: Known) -> Answer:
        """Return the answer to a frame in which a wall was seen, or why there is none."""
        reason = (
            seen.reason
            or other_index(self.study, scale.refractive_index)
            or self.refusal(known)
            or needle_elsewhere(seen.needle, known, self.study.needle.outer_diameter_m / 2)
            or too_little_wall(*surface(seen.segmentation, scale), self.study.slice)
        )
        if reason:
            return unusable(self.classes, reason)
        reading = self._network.read(self._window.reduced(frame, scale), known)
        answer = judged_answer(reading, "network", dent_leaves(seen.cut), self.study)
        return replace(answer, readings=(("network", reading),))
