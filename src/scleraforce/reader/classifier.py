"""A model of kind "classifier": the paper's network, which reads the force class from a slice."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, final

import numpy as np
import onnxruntime  # type: ignore[import-untyped]  # it ships no types
from numpy.typing import NDArray

from scleraforce.errors import ModelError
from scleraforce.known.eye import NOTHING_KNOWN, Known
from scleraforce.models.folder import NETWORK_FILE, STUDY_FILE
from scleraforce.models.session import run_network
from scleraforce.reader.answers import Answer, LiveReading, unusable
from scleraforce.reader.limits import slice_limits
from scleraforce.reader.look import NEEDLE_SEEN, Look, can_calibrate, look
from scleraforce.reader.verdicts import dent_leaves
from scleraforce.recording.folder import OctInfo
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.observed import segmented_boundaries
from scleraforce.segmentation.wall_finder import WallFinder
from scleraforce.study import Study

INPUT, OUTPUT = "slices", "probabilities"


@final
class Classifier:
    """Reads the force class from slices; see `Reader`. Made by `load_model`; all of it belongs together.

    The same slices give the same answer: the session runs on the CPU with a fixed number of threads. It knows the
    modulus of its training only, and of what is known of an eye takes notice of the thickness alone (see `look`).

    Raises:
        ModelError: the network has other inputs or outputs than its study asks for.
    """

    kind = "classifier"
    reads_force = False
    serves_loop = True

    def __init__(
        self,
        path: Path,
        study: Study,
        record: Mapping[str, Any],
        session: onnxruntime.InferenceSession,
        finder: WallFinder | None = None,
    ) -> None:
        self.path = path
        self.study = study
        self.record = record
        self._session = session
        self._finder = finder
        self._check()

    @property
    def classes(self) -> int:
        """Number of force classes."""
        return len(self.study.classes.bounds_n) + 1

    @property
    def fixed_modulus_pa(self) -> float:
        """Young's modulus that it was trained for, and reads every eye with."""
        return self.study.eye.youngs_modulus_pa

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making: hashes of study and data set, seed, versions, class bounds."""
        metadata: Mapping[str, str] = self._session.get_modelmeta().custom_metadata_map
        return metadata

    def read(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> Answer:
        """Read one raw frame; see `Reader.read`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m, finder=self._finder)
        answer = self._seen(seen)
        if seen.reason:
            return answer
        return replace(answer, can_calibrate=can_calibrate(seen, segmented_boundaries(seen.segmentation, scale)))

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame in the control loop; see `Reader.read_live`."""
        seen = look(frame, scale, self.study.slice, thickness_m=known.thickness_m)
        return LiveReading(self._seen(seen), seen.segmentation.outer_row, seen.segmentation.inner_row)

    def refusal(self, known: Known) -> None:
        """Return None: it reads every eye as the one that it was trained for."""

    def limits(self, known: Known, scan: OctInfo, gauge: int | None = None) -> tuple[str, ...]:
        """Return where an eye and its B-scans lie outside the training; see `Reader.limits`."""
        return slice_limits(self.study, known, scan, gauge)

    def probabilities(self, slices: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return the probability of each force class.

        Args:
            slices: uint8, shape (slice, row, column) of the study; 255 where wall is, 0 elsewhere.

        Returns:
            Shape (slice, class); rows sum to 1.

        Raises:
            ModelError: another shape or type, or values other than 0 and 255.
        """
        expected = (self.study.slice.rows, self.study.slice.columns)
        if slices.dtype != np.uint8 or slices.ndim != 3 or slices.shape[1:] != expected:
            raise ModelError(
                f"{self.path}: slices: found {slices.dtype} of shape {slices.shape}, this model reads uint8 of shape "
                f"(n, {expected[0]}, {expected[1]})"
            )
        if np.any((slices != 0) & (slices != 255)):
            raise ModelError(f"{self.path}: slices: a value other than 0 (no wall) and 255 (wall)")
        if not len(slices):
            return np.empty((0, self.classes))
        (answer,) = run_network(self._session, [OUTPUT], {INPUT: np.ascontiguousarray(slices)}, str(self.path))
        if answer.shape != (len(slices), self.classes):
            raise ModelError(f"{self.path}: the network answers {answer.shape} to {len(slices)} slices")
        # float32 leaves the sum at 1 to some 1e-7; double makes it exact to the last digits that are printed.
        result: NDArray[np.float64] = answer.astype(np.float64)
        result /= result.sum(axis=1, keepdims=True)

        return result

    def _seen(self, seen: Look) -> Answer:
        """Return the answer to what is seen in a frame; a slice that a needle hides in part was never trained on."""
        reason = seen.reason or (NEEDLE_SEEN if seen.needle else None)
        answer = unusable(self.classes, reason) if reason else self._answer(seen.cut)
        return seen.told(answer)

    def _answer(self, cut: NDArray[np.uint8]) -> Answer:
        """Ask the network.

        One that met few dents leaving the window takes what is left for a wall without force: the most dangerous
        frames would be read as the least. They are withdrawn from instead.
        """
        if dent_leaves(cut):
            return unusable(self.classes, "the dent leaves the window of the slice")
        probabilities = self.probabilities(cut[np.newaxis])[0]
        if not np.isfinite(probabilities).all():
            return unusable(self.classes, "the network's answer is no number")
        return Answer(
            predicted=int(probabilities.argmax()), probabilities=tuple(probabilities.tolist()), usable=True, reason=None
        )

    def _check(self) -> None:
        """Check that network and study fit each other."""
        place, rows, columns = self.path / NETWORK_FILE, self.study.slice.rows, self.study.slice.columns
        inputs = {item.name: (item.type, item.shape[1:]) for item in self._session.get_inputs()}
        outputs = {item.name: (item.type, item.shape[1:]) for item in self._session.get_outputs()}
        if inputs != {INPUT: ("tensor(uint8)", [rows, columns])}:
            raise ModelError(
                f"{place}: input: found {inputs}, {STUDY_FILE} asks for {rows} x {columns} uint8 '{INPUT}'"
            )
        if outputs != {OUTPUT: ("tensor(float)", [self.classes])}:
            raise ModelError(f"{place}: output: found {outputs}, expected {self.classes} floats '{OUTPUT}'")
