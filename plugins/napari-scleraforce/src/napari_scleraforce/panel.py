"""The dock widget: wall and force of the shown frame, corrections, and forces over
time.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from magicgui.widgets import ComboBox, Container, FileEdit, PushButton, Widget
from matplotlib.backends.backend_qtagg import FigureCanvasQTAgg
from matplotlib.figure import Figure
from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.utils import progress
from napari.utils.notifications import show_error

import scleraforce as sf
from napari_scleraforce.recordings import RECORDING
from napari_scleraforce.walls import LOWER, UPPER, Points, mask_of, paths_of

if TYPE_CHECKING:
    from scleraforce.reading.answer import Answer
    from scleraforce.recordings.recording_folder import Recording

MN = 1e3  # per N
COLOURS = {UPPER: "#E69F00", LOWER: "#56B4E9"}
WALLS = "walls"
BOUNDARY = "boundary"
WIDTH_ROWS = 3  # of the paths


def reported(action: Callable[["Panel"], None]) -> Callable[["Panel"], None]:
    """Return an action of the panel that shows bad input to the user instead of raising
    it.
    """

    def act(panel: "Panel") -> None:
        try:
            action(panel)
        except sf.InputError as fault:
            show_error(str(fault))

    return act


class Panel(Container[Widget]):
    """Reads the frame that the slider selects: its wall as paths of the layer `walls`,
    its force as text and in a plot.

    The recording is that of the topmost image layer that has one.
    """

    def __init__(self, napari_viewer: ViewerModel) -> None:
        self.calibration = FileEdit(label="calibration", filter="*.json", nullable=True)
        self.drawn_as = ComboBox(
            label="new paths are", choices=[UPPER, LOWER], value=UPPER
        )
        actions = {
            "Save wall": self.save,
            "Restore wall": self.restore,
            "Read all frames": self.read_all,
        }
        buttons = [PushButton(text=text) for text in actions]
        super().__init__(widgets=[self.calibration, self.drawn_as, *buttons])

        for button, action in zip(buttons, actions.values(), strict=True):
            button.changed.connect(lambda _, action=action: action())

        self.calibration.changed.connect(lambda _: self.read_again())
        self.drawn_as.changed.connect(lambda name: self._default(name))
        self.figure = Figure(figsize=(4, 2.5), layout="constrained")
        self._canvas = FigureCanvasQTAgg(self.figure)
        self.native.layout().addWidget(self._canvas)
        self._viewer = napari_viewer
        self._opened: tuple[str, Recording] | None = None
        self._answers: dict[str, Answer] = {}  # by the file of the frame
        self._measured: dict[float, float] = {}  # force in N by time
        self._model = sf.load_model("default")
        napari_viewer.dims.events.current_step.connect(lambda: self.show_frame())
        napari_viewer.layers.events.inserted.connect(lambda: self.show_frame())
        self.show_frame()

    @property
    def recording(self) -> "Recording | None":
        """The recording of the topmost image layer that has one."""
        image = self._image()
        if image is None:
            return None

        path = image.metadata[RECORDING]
        if self._opened is None or self._opened[0] != path:
            self._opened = path, sf.read_recording(path)
            self._answers = {}
            self._measured = {}

        return self._opened[1]

    @property
    def _modulus(self) -> Path | None:
        return (
            self.calibration.value if isinstance(self.calibration.value, Path) else None
        )

    @property
    def frame(self) -> int:
        """The place of the shown frame in the recording."""
        return int(self._viewer.dims.current_step[0])

    @reported
    def show_frame(self) -> None:
        """Show wall, force and plot of the frame that the slider selects."""
        recording = self.recording
        if recording is None or self.frame >= len(recording.frames):
            return

        file = recording.frames[self.frame].file
        if file not in self._answers:
            self._answers[file] = self._read(recording)

        self._draw_wall(self._answers[file])
        self._viewer.text_overlay.visible = True
        self._viewer.text_overlay.text = sentence(self._answers[file])
        self._plot(recording)

    def read_again(self) -> None:
        """Forget all answers, as with another calibration, and read the shown frame."""
        self._answers = {}
        self._measured = {}
        self.show_frame()

    @reported
    def save(self) -> None:
        """Save the paths of the shown frame as its corrected wall, and read it
        again.
        """
        recording = self.recording
        if recording is None:
            return

        mask = mask_of(self.paths(), recording.info.scan.shape)
        file = recording.frames[self.frame].file
        sf.save_wall(recording, file, mask)

        for each in next(
            moment
            for moment in recording.moments
            if file in {entry.file for entry in moment}
        ):
            self._answers.pop(each.file, None)

        self.restore()

    def restore(self) -> None:
        """Show the wall that is read, without changes that were not saved."""
        walls = self._walls()
        walls.selected_data = {
            number for number, data in enumerate(walls.data) if self._is_shown(data)
        }
        walls.remove_selected()
        walls.metadata["drawn"].discard(self.frame)
        self.show_frame()

    @reported
    def read_all(self) -> None:
        """Read all frames, with the force log if there is one."""
        recording = self.recording
        if recording is None:
            return

        with progress(total=len(recording.frames), desc="reading") as bar:
            found = sf.evaluate(
                self._model, recording.path, self._modulus, progress=bar.update
            )

        self._answers = {each.file: each.answer for each in found.frames}
        self._measured = {
            each.time_s: each.measured_force_n
            for each in found.frames
            if each.time_s is not None and each.measured_force_n is not None
        }
        self.show_frame()

    def paths(self) -> list[tuple[str, Points]]:
        """Return the paths (point, 3) of the shown frame, with the names of their
        boundaries.
        """
        walls = self._walls()
        named = zip(walls.features[BOUNDARY], walls.data, strict=True)
        return [
            (str(name), np.asarray(data))
            for name, data in named
            if self._is_shown(data)
        ]

    def _image(self) -> Image | None:
        found = [
            layer
            for layer in self._viewer.layers
            if isinstance(layer, Image) and RECORDING in layer.metadata
        ]
        return found[-1] if found else None

    def _is_shown(self, data: Any) -> bool:
        return bool(round(float(data[0][0])) == self.frame)

    def _read(self, recording: "Recording") -> "Answer":
        entry = recording.frames[self.frame]
        moment = next(moment for moment in recording.moments if entry in moment)
        frames = [
            recording.frame_path(each)
            for each in (entry, *(each for each in moment if each is not entry))
        ]

        return sf.read(self._model, list(frames), calibration=self._modulus)

    def _walls(self) -> Shapes:
        """Return the layer of the walls, which is made on first use."""
        image = self._image()
        assert image is not None

        for layer in self._viewer.layers:
            if (
                isinstance(layer, Shapes)
                and layer.metadata.get(RECORDING) == image.metadata[RECORDING]
            ):
                return layer

        layer = Shapes(
            ndim=3,
            name=WALLS,
            scale=image.scale,
            units=image.units,
            axis_labels=image.axis_labels,
            metadata={RECORDING: image.metadata[RECORDING], "drawn": set()},
            features={BOUNDARY: np.empty(0, object)},
        )
        self._viewer.add_layer(layer)
        self._default(str(self.drawn_as.value))

        return layer

    def _default(self, name: str) -> None:
        walls = self._walls()
        walls.feature_defaults = {BOUNDARY: [name]}
        walls.current_edge_color = COLOURS[name]

    def _draw_wall(self, answer: "Answer") -> None:
        walls = self._walls()
        found = answer.segmentation
        if self.frame in walls.metadata["drawn"] or found is None:
            return

        walls.metadata["drawn"].add(self.frame)
        for name, points in paths_of(
            self.frame, found.outer_row, found.inner_row if found.inner_found else None
        ):
            self._default(name)
            walls.add_paths([points], edge_color=COLOURS[name], edge_width=WIDTH_ROWS)

        self._default(str(self.drawn_as.value))

    def _plot(self, recording: "Recording") -> None:
        self.figure.clear()
        axes = self.figure.add_subplot(xlabel="time (s)", ylabel="force (mN)")

        read = [
            (entry.time_s, answer.force_n, *answer.interval_n)
            for entry in recording.frames
            if (answer := self._answers.get(entry.file))
            and answer.force_n is not None
            and answer.interval_n
        ]
        if read:
            time_s, force_n, low_n, high_n = np.array(read).T
            errors = MN * np.array([force_n - low_n, high_n - force_n])
            axes.errorbar(
                time_s,
                MN * force_n,
                errors,
                fmt="o",
                color=COLOURS[LOWER],
                label="read, 90 % interval",
            )

        if self._measured:
            measured_mn = MN * np.array(list(self._measured.values()))
            axes.plot(
                list(self._measured),
                measured_mn,
                ".",
                color=COLOURS[UPPER],
                label="measured",
            )

        axes.axvline(recording.frames[self.frame].time_s, color="grey", linewidth=1)
        if read or self._measured:
            axes.legend()

        self._canvas.draw_idle()


def sentence(answer: "Answer") -> str:
    """Return force, interval, class and the source of the wall of an answer."""
    source = (
        "" if answer.segmentation is None else f", wall: {answer.segmentation.source}"
    )
    if answer.force_n is None or answer.interval_n is None:
        return f"not usable: {answer.reason}{source}"

    force, low, high = (
        f"{MN * value:.1f}" for value in (answer.force_n, *answer.interval_n)
    )
    return f"{force} mN ({low} to {high}), class {answer.predicted}{source}"
