"""Figures of frames: slices and walls, read over measured forces, an evaluation in one
picture, a sheet of frames.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from math import isnan
from operator import itemgetter
from textwrap import shorten, wrap
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from scleraforce.base.arrays import Bytes, Floats, Integers
from scleraforce.base.units import from_si
from scleraforce.calibration.answer_metrics import SDS_OF_INTERVAL, agreement, dice
from scleraforce.calibration.evaluation import Evaluation, FrameAnswer
from scleraforce.front.report import figure_files
from scleraforce.front.report.recording_figures import DASHED, mark_bounds
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.frame import OpenedFrame, Pixels
from scleraforce.records.study import SliceStudy
from scleraforce.wall.wall import Segmentation, draw_overlay, without_wall
from scleraforce.wall.wall_in_metres import boundary_slice

if TYPE_CHECKING:
    from scleraforce.lab.training.slice_dataset import Dataset

# colours of two overlaid slices
PARTS = {
    "in the frame only": figure_files.SKY,
    "simulated only": figure_files.RED,
    "both": figure_files.GREY,
}
# lateral, to either side of the frame's middle
SHIFTS_M = np.linspace(-0.6e-3, 0.6e-3, 49)
WALLS: tuple[tuple[str, Literal["-", "--"]], ...] = (
    (figure_files.SKY, "-"),
    (figure_files.AMBER, "--"),
)
SLICE: dict[str, Any] = {"vmin": 0, "vmax": 255, "interpolation": "nearest"}

WIDTH_MM = 170.0  # of a figure
# pixels of a frame in a page: 3 side by side on a wide screen, one on a telephone, both
# sharp
WIDTH = 480


@dataclass(frozen=True)
class AnsweredFrame:
    """A raw frame (row, column) with its answer and its recording."""

    answer: FrameAnswer
    recording: Recording
    frame: Pixels

    @property
    def found(self) -> Segmentation:
        """The wall that was read."""
        if self.answer.answer.segmentation is None:
            raise ValueError(
                f"{self.answer.recording}: {self.answer.file}: the answer has no"
                " segmentation"
            )
        return self.answer.answer.segmentation

    @property
    def extent_m(self) -> tuple[float, float]:
        """Width and depth of the frame."""
        return self.recording.info.scan.extent_m

    def slice(self, study: SliceStudy) -> Bytes:
        """Return the slice that a network reads."""
        return boundary_slice(self.found, self.recording.info.scan.scale, study)


def answered_frames(answers: Iterable[FrameAnswer]) -> tuple[AnsweredFrame, ...]:
    """Read the pixels of answers' frames, each recording once; raises `RecordingError`
    or `FrameError`.
    """
    opened = cache(read_recording)
    shown_frames = []

    for answer in answers:
        recording = opened(answer.recording)
        entry = next(entry for entry in recording.frames if entry.file == answer.file)
        shown_frames.append(AnsweredFrame(answer, recording, recording.frame(entry)))

    return tuple(shown_frames)


@figure_files.styled
def draw_slice_pairs(
    pairs: Sequence[tuple[AnsweredFrame, Bytes, Bytes]], pixel_m: float
) -> Figure:
    """Draw for each pair, from top to bottom: the raw frame, its slice, the simulated
    slice, and both overlaid.

    A pair is a frame, its slice, and the slice simulated for the same force: 255 is
    wall, pixels of `pixel_m`.
    """
    figure = Figure(figsize=figure_files.inches(170, 100))
    grid = figure.subplots(4, len(pairs), squeeze=False)
    occurring = set[int]()

    for column, (answered, measured, simulated) in enumerate(pairs):
        answer = answered.answer
        extent_m = (measured.shape[1] * pixel_m, measured.shape[0] * pixel_m)
        force_mn = from_si(max(answer.measured_force_n or 0.0, 0.0), "mn")
        figure_files.show_image(grid[0, column], answered.frame, answered.extent_m)
        figure_files.show_image(grid[1, column], measured, extent_m, **SLICE)
        figure_files.show_image(grid[2, column], simulated, extent_m, **SLICE)
        overlaid = (measured > 0) + 2 * (simulated > 0)  # number of the part
        occurring |= set(np.unique(overlaid).tolist())
        colours = ListedColormap(["none", *PARTS.values()])
        figure_files.show_image(
            grid[3, column],
            overlaid,
            extent_m,
            cmap=colours,
            vmin=0,
            vmax=3,
            interpolation="nearest",
        )
        grid[3, column].set_title(
            f"Dice {dice(measured, simulated):.3f}", fontsize=7, pad=2
        )
        title = f"class {answer.target}: {answer.eye}, {force_mn:.0f} mN"
        grid[0, column].set_title(
            title, color=figure_files.CLASS_INKS[answer.target or 0], fontweight="bold"
        )
        grid[3, column].set_xlabel("lateral [mm]")

        for axes in grid[1:3, column]:
            axes.tick_params(labelbottom=False)

    for row, name in enumerate(("raw frame", "its slice", "simulated", "overlay")):
        grid[row, 0].set_ylabel(f"{name}\ndepth [mm]")

    parts = enumerate(PARTS.items(), start=1)
    handles = [
        Patch(color=colour, label=label)
        for number, (label, colour) in parts
        if number in occurring
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)

    return figure


@figure_files.styled
def draw_montage(dataset: "Dataset", chosen: Integers) -> Figure:
    """Draw the slices of chosen samples by force in six columns, each with force, class
    and wall thickness.
    """
    chosen = chosen[np.argsort(dataset.force_n[chosen])]
    rows = -(-len(chosen) // 6)
    figure = Figure(figsize=figure_files.inches(170, 14.5 * rows))
    grid = figure.subplots(rows, 6, squeeze=False).ravel()

    for axes in grid:
        axes.set_axis_off()

    thickness_um = from_si(dataset.read("thickness_m"), "um")
    for axes, sample in zip(grid, chosen, strict=False):
        axes.imshow(dataset.slices[sample], cmap="gray", **SLICE)
        title = (
            f"{from_si(dataset.force_n[sample], 'mn'):.1f} mN ·"
            f" {thickness_um[sample]:.0f} µm"
        )
        axes.set_title(
            title,
            fontsize=6.5,
            pad=2,
            color=figure_files.CLASS_INKS[dataset.target[sample]],
        )

    return figure


def draw_boundaries(axes: Axes, answered: AnsweredFrame) -> None:
    """Draw a frame and, over it, the boundaries that were found: surface orange, inner
    blue, as in the console.
    """
    width_mm, depth_mm = (from_si(extent_m, "mm") for extent_m in answered.extent_m)
    rows, columns = answered.frame.shape
    figure_files.show_image(axes, answered.frame, answered.extent_m)
    lateral_mm = (np.arange(columns) + 0.5) * width_mm / columns

    for row, colour in (
        (answered.found.outer_row, figure_files.AMBER),
        (answered.found.inner_row, figure_files.SKY),
    ):
        axes.plot(
            lateral_mm, (row + 0.5) * depth_mm / rows, color=colour, linewidth=0.9
        )

    axes.set(xlim=(0.0, width_mm), ylim=(depth_mm, 0.0))


@figure_files.styled
def draw_segmentation(answered: AnsweredFrame) -> Figure:
    """Draw a raw frame, the boundaries that were found, the mask of the wall, and the
    frame under the mask.
    """
    figure = Figure(figsize=figure_files.inches(170, 68))
    raw, found, mask, masked = panels = figure.subplots(
        2, 2, sharex=True, sharey=True
    ).ravel()
    titles = (
        "(a) raw frame",
        "(b) surface and inner boundary",
        "(c) mask of the wall",
        "(d) frame, masked",
    )

    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title)

    figure_files.show_image(raw, answered.frame, answered.extent_m)
    draw_boundaries(found, answered)
    figure_files.show_image(
        mask, answered.found.mask, answered.extent_m, interpolation="nearest"
    )
    figure_files.show_image(
        masked, np.where(answered.found.mask > 0, answered.frame, 0), answered.extent_m
    )

    for axes in (raw, mask):
        axes.set_ylabel("depth [mm]")

    for axes in (mask, masked):
        axes.set_xlabel("lateral [mm]")

    return figure


def laid_on_surface(
    section: WallSection, surface_m: Floats, width_m: float
) -> WallSection:
    """Return a section laid on a frame's surface (column,), m, NaN unseen: the shift of
    smallest mean distance wins.
    """
    columns = len(surface_m)
    lateral_m = (np.arange(columns) + 0.5) * width_m / columns
    ahead = np.concatenate(
        [[True], section.outer[1:, 0] > np.maximum.accumulate(section.outer[:, 0])[:-1]]
    )
    curve = section.outer[ahead]
    best = np.inf, width_m / 2, 0.0  # mean distance, and the place

    for middle_m in width_m / 2 + SHIFTS_M:
        depth_m = np.interp(
            lateral_m, curve[:, 0] + middle_m, curve[:, 1], left=np.nan, right=np.nan
        )
        away = (surface_m - depth_m)[np.isfinite(surface_m - depth_m)]
        if len(away):
            down_m = float(np.median(away))
            best = min(
                best,
                (float(np.mean(np.abs(away - down_m))), middle_m, down_m),
                key=itemgetter(0),
            )

    return section.shifted(*best[1:])


@figure_files.styled
def draw_computed_walls(
    shown_frames: Sequence[AnsweredFrame], computed: Mapping[str, Sequence[WallSection]]
) -> Figure:
    """Draw each frame bare and, below, with the sections that each mechanics computed
    for it, laid on its surface.
    """
    figure = Figure(figsize=figure_files.inches(170, 52))
    grid = figure.subplots(
        2, len(shown_frames), squeeze=False, sharex="col", sharey="col"
    )

    for column, answered in enumerate(shown_frames):
        width_m, depth_m = answered.extent_m
        for axes in grid[:, column]:
            figure_files.show_image(axes, answered.frame, answered.extent_m)
            axes.set(
                xlim=(0.0, from_si(width_m, "mm")), ylim=(from_si(depth_m, "mm"), 0.0)
            )

        surface_m = (answered.found.outer_row + 0.5) * depth_m / len(answered.frame)
        for sections, (colour, line) in zip(computed.values(), WALLS, strict=False):
            laid = laid_on_surface(sections[column], surface_m, width_m)
            for curve in (laid.outer, laid.inner):
                grid[1, column].plot(
                    *from_si(curve.T, "mm"), color=colour, linestyle=line, linewidth=0.9
                )

        force_mn = from_si(max(answered.answer.measured_force_n or 0.0, 0.0), "mn")
        grid[0, column].set_title(f"{answered.answer.file}, {force_mn:.0f} mN")
        grid[1, column].set_xlabel("lateral [mm]")

    for axes in grid[:, 0]:
        axes.set_ylabel("depth [mm]")

    handles = [
        Line2D([], [], color=colour, linestyle=line, label=name)
        for name, (colour, line) in zip(computed, WALLS, strict=False)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))

    return figure


BINS = 128
# heights: of the histograms, of the frames at most
HISTOGRAM_MM = 42.0
MOST_MM = 90.0


@figure_files.styled
def draw_scanner(
    real: Pixels, drawn: Pixels, extent_m: tuple[float, float], top: int
) -> Figure:
    """Draw a real frame and a simulated one (row, column) on one grey scale, up to
    `top`, and their histograms.
    """
    width_mm, depth_mm = (float(from_si(length, "mm")) for length in extent_m)
    frame_mm = min(MOST_MM, (WIDTH_MM / 2 - 8.0) * depth_mm / width_mm)
    figure = Figure(
        figsize=figure_files.inches(WIDTH_MM, frame_mm + 14.0 + HISTOGRAM_MM)
    )
    grid = figure.add_gridspec(2, 2, height_ratios=[frame_mm + 10.0, HISTOGRAM_MM])
    counts = figure.add_subplot(grid[1, :])
    edges = np.linspace(0, top + 1, min(BINS, top + 1) + 1)
    shown_frames = (
        ("Real", real, figure_files.BLACK, "-"),
        ("Drawn", drawn, figure_files.AMBER, "--"),
    )

    for column, (title, frame, colour, line) in enumerate(shown_frames):
        axes = figure.add_subplot(grid[0, column])
        figure_files.show_image(axes, frame, extent_m, vmin=0, vmax=top)
        axes.set(
            title=title, xlabel="lateral, mm", ylabel="" if column else "depth, mm"
        )
        share = from_si(np.histogram(frame, edges)[0] / frame.size, "percent")
        counts.plot(
            (edges[1:] + edges[:-1]) / 2,
            share,
            color=colour,
            linestyle=line,
            label=title.lower(),
        )

    counts.set(
        xlabel="count",
        ylabel="share of the pixels, %",
        title="Histograms",
        xlim=(0, top),
    )
    figure_files.log_scale(counts)
    counts.legend()

    return figure


LETTER_MM = 1.5  # wide
Place = tuple[float, float, FrameAnswer]  # of a trial in a figure


@figure_files.styled
def draw_trial_forces(evaluation: Evaluation) -> Figure:
    """Draw the measured force of every trial that counts with the class bounds; misread
    trials are ringed.
    """
    figure = Figure(figsize=figure_files.inches(WIDTH_MM, 70))
    _draw_trials(figure, evaluation)
    return figure


def _draw_trials(figure: FigureBase, evaluation: Evaluation) -> None:
    axes = figure.subplots()
    frames = evaluation.scored
    places = [
        (x, from_si(f.measured_force_n or 0.0, "mn"), f)
        for x, f in enumerate(frames, start=1)
    ]
    top_mn = max(
        [
            from_si(evaluation.max_force_n, "mn"),
            *(force_mn for _, force_mn, _ in places),
        ]
    )
    _draw_places(axes, places)
    mark_bounds(axes, evaluation.bounds_n)
    _separate_eyes(axes, [frame.eye for frame in frames])
    axes.set(
        xlabel="trial", ylabel="measured force [mN]", xlim=(0.0, len(frames) + 1.0)
    )
    axes.set_ylim(-0.04 * top_mn, 1.12 * top_mn)
    figure.legend(loc="outside upper center", ncols=5)


def _draw_places(axes: Axes, places: Sequence[Place]) -> None:
    """Draw trials: marker and colour say which class was read, hollow ones are not
    usable, misread ones are ringed.
    """

    def draw(chosen: Iterable[Place], marker: str, label: str, **style: Any) -> None:
        if some := [place[:2] for place in chosen]:
            axes.plot(*zip(*some, strict=True), marker, label=label, **style)

    for number, (marker, colour) in enumerate(
        zip(figure_files.CLASS_MARKERS, figure_files.CLASS_COLOURS, strict=True)
    ):
        read = [place for place in places if place[2].answer.predicted == number]
        for usable, fill, label in (
            (True, colour, f"read as class {number}"),
            (False, figure_files.PAPER, "not usable"),
        ):
            chosen = (place for place in read if place[2].answer.usable == usable)
            draw(
                chosen,
                marker,
                label,
                color=fill,
                markeredgecolor=colour,
                markersize=4.5,
                zorder=4,
            )

    ringed = (place for place in places if place[2].misread)
    draw(
        ringed,
        "o",
        "misread",
        color="none",
        markeredgecolor=figure_files.BLACK,
        markersize=10,
        zorder=5,
    )


def _separate_eyes(axes: Axes, names: Sequence[str]) -> None:
    """Draw a line between the trials of two eyes, and the eyes' names where there is
    room.
    """
    starts = [n for n in range(len(names)) if n == 0 or names[n] != names[n - 1]]
    for start, end in pairwise([*starts, len(names)]):
        if start:
            axes.axvline(start + 0.5, color=figure_files.FAINT, linewidth=0.8, zorder=0)
        if LETTER_MM * len(names[start]) < WIDTH_MM * 0.85 * (end - start) / len(names):
            middle = 0.5 * (start + end) + 0.5
            axes.text(
                middle,
                0.985,
                names[start],
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="top",
            )


@figure_files.styled
def draw_residuals(evaluation: Evaluation) -> Figure:
    """Draw read minus measured force of every trial that counts, with its interval,
    over the measured force.

    The lines are the mean and its limits of agreement (Bland and Altman 1986, against a
    reference), the band is the labels' own error; trials that are not usable have no
    force, and are at the upper edge.
    """
    figure = Figure(figsize=figure_files.inches(WIDTH_MM, 88))
    axes = figure.subplots()
    places = list[Place]()
    unread = list[float]()

    for frame in evaluation.scored:
        measured_n = frame.measured_force_n
        read_n = frame.answer.force_n
        interval_n = frame.answer.interval_n
        if measured_n is None:
            continue
        if read_n is None or interval_n is None:
            unread.append(from_si(measured_n, "mn"))
            continue

        x, y, low, high = (
            from_si(force_n, "mn")
            for force_n in (measured_n, read_n - measured_n, *interval_n)
        )
        places.append((x, y, frame))
        axes.vlines(
            x,
            low - x,
            high - x,
            color=figure_files.CLASS_COLOURS[frame.answer.predicted],
            linewidth=0.9,
        )

    _draw_places(axes, places)
    if unread:
        axes.plot(
            unread,
            np.full(len(unread), 0.97),
            "x",
            color=figure_files.RED,
            markersize=4,
            label="not usable",
            transform=axes.get_xaxis_transform(),
        )

    _draw_agreement(axes, evaluation)
    top_mn = max([from_si(evaluation.max_force_n, "mn"), *(x for x, *_ in places)])
    _mark_classes(axes, evaluation.bounds_n, top_mn)
    axes.set(
        xlabel="measured force [mN]",
        ylabel="read minus measured force [mN]",
        xlim=(-0.02 * top_mn, top_mn),
    )
    figure.legend(
        loc="outside lower center", ncols=4, handlelength=1.5, columnspacing=1.2
    )

    return figure


def _draw_agreement(axes: Axes, evaluation: Evaluation) -> None:
    middle, low, high = (from_si(off_n, "mn") for off_n in agreement(evaluation.forces))
    words = (
        f"mean {middle:+.2f} mN",
        f"limits of agreement {low:+.2f} to {high:+.2f} mN",
    )
    mean_label, limits_label = (each.replace("-", "\N{MINUS SIGN}") for each in words)
    label_mn = SDS_OF_INTERVAL * from_si(evaluation.label_sd_n, "mn")
    axes.plot(
        [], [], "|", color=figure_files.BLACK, markersize=8, label="90 % interval"
    )

    if label_mn:
        label = f"label error, 90 %: ±{label_mn:.2f} mN"
        axes.axhspan(
            -label_mn,
            label_mn,
            color=figure_files.GREY,
            alpha=0.15,
            linewidth=0,
            zorder=0,
            label=label,
        )

    axes.axhline(0.0, color=figure_files.GREY, linewidth=0.6, zorder=1)
    axes.axhline(
        middle, color=figure_files.BLACK, linewidth=0.9, zorder=1, label=mean_label
    )

    if not isnan(low):
        for limit, name in ((low, limits_label), (high, None)):
            axes.axhline(
                limit,
                color=figure_files.BLACK,
                linewidth=0.9,
                linestyle=DASHED,
                zorder=1,
                label=name,
            )


def _mark_classes(axes: Axes, bounds_n: Sequence[float], top_mn: float) -> None:
    """Draw the class bounds across the horizontal axis and name the classes above
    it.
    """
    bounds_mn = from_si(np.array(bounds_n), "mn")
    for bound_mn in bounds_mn:
        axes.axvline(
            bound_mn, color=figure_files.GREY, linewidth=0.6, linestyle=DASHED, zorder=1
        )

    for number, (low, high) in enumerate(pairwise([0.0, *bounds_mn, top_mn])):
        axes.annotate(
            f"class {number}",
            (0.5 * (low + high), 1.0),
            (0, 3),
            ("data", "axes fraction"),
            "offset points",
            ha="center",
            color=figure_files.CLASS_INKS[number],
            annotation_clip=False,
        )


@figure_files.styled
def draw_overview(read: Sequence[AnsweredFrame], evaluation: Evaluation) -> Figure:
    """Draw frames, one of each class, with their walls and the classes read, above the
    forces of all trials.
    """
    figure = Figure(figsize=figure_files.inches(170, 92))
    top, bottom = figure.subfigures(2, 1, squeeze=False, height_ratios=[1.0, 2.1])[:, 0]

    for axes, one in zip(
        top.subplots(1, len(read), squeeze=False)[0], read, strict=True
    ):
        draw_boundaries(axes, one)
        axes.set_axis_off()
        answer = one.answer.answer
        sure = (
            ""
            if answer.probabilities is None
            else f" (p = {answer.probabilities[answer.predicted]:.2f})"
        )
        title = f"read: class {answer.predicted}{sure}"
        axes.set_title(
            title, color=figure_files.CLASS_INKS[answer.predicted], fontweight="bold"
        )

        if one.answer.measured_force_n is not None:
            measured = f"measured: {from_si(one.answer.measured_force_n, 'mn'):.1f} mN"
            axes.text(
                0.5, -0.04, measured, transform=axes.transAxes, ha="center", va="top"
            )

    _draw_trials(bottom, evaluation)
    return figure


MOST = 40  # frames on a sheet
WORST = 24  # of these the first in the order
COLUMNS = 4
CELL_MM = 40.0
GAP_MM = 2.0
MARGIN_MM = 2.0
TOP_MM = 14.0
# below a frame: its name, and each line of words
NAME_MM = 6.0
LINE_MM = 2.6
# in a line
NAME_LETTERS = 25
LETTERS = 37
# dashes over a broader line
LINES = (
    ("classical method (edges)", *WALLS[0], 1.2),
    ("network", *WALLS[1], 0.7),
)
EXPLAINED = (
    "Disagreement: the share of columns in which the methods differ by more than their"
    " uncertainties, or the network\nis unsure of the wall's end, divided by the"
    " largest usable share. Unusable frames are first, and outlined."
)


@dataclass(frozen=True)
class SheetFrame:
    """A frame on a sheet: its name, its picture (row, column, colour), depth over
    width, its wall, and lines below.
    """

    name: str
    picture: Bytes
    aspect: float
    found: Segmentation
    words: tuple[str, ...]


def sheet_frame(name: str, frame: OpenedFrame, found: Segmentation) -> SheetFrame:
    """Return a frame for a sheet: to scale if its size is stated, else with square
    pixels; at most as deep as wide.
    """
    rows, columns = frame.pixels.shape
    width_m, depth_m = frame.scan.extent_m
    stated = "assumed" not in (frame.sources["width_m"], frame.sources["depth_m"])
    aspect = min(depth_m / width_m if stated else rows / columns, 1.0)
    size = max(1, round(WIDTH * aspect)), WIDTH
    verdict = "not usable"
    reason = found.reason.removeprefix("two methods to find the wall differ: ")

    if found.usable:
        verdict = "usable"
        reason = "inner boundary not seen" if isnan(found.thickness_m) else ""
        verdict += (
            f", {from_si(found.thickness_m, 'um'):.0f} µm"
            if stated and not reason
            else ""
        )

    if found.methods is not None:
        verdict += f", disagreement {found.methods.disagreement:.2f}"

    words = verdict, *wrap(shorten(reason, 3 * LETTERS, placeholder="…"), LETTERS)
    return SheetFrame(
        name,
        draw_overlay(frame.pixels, without_wall((rows, columns), ""), size),
        aspect,
        found,
        words,
    )


def shown_on_sheet(badness: Sequence[tuple[bool, float]]) -> list[int]:
    """Return which frames a sheet shows, the worst first: all, or the worst and others
    in even steps.
    """
    order = sorted(range(len(badness)), key=lambda n: badness[n], reverse=True)
    return order[:WORST] + figure_files.evenly(order[WORST:], MOST - WORST)


@figure_files.styled
def draw_sheet(frames: Sequence[SheetFrame], title: str, note: str = "") -> Figure:
    """Draw frames in their order, each with the walls of both methods, its verdict and
    the disagreement.
    """
    rows = [frames[n : n + COLUMNS] for n in range(0, len(frames), COLUMNS)]
    tall_mm = [
        CELL_MM * max(one.aspect for one in row)
        + NAME_MM
        + LINE_MM * max(len(one.words) for one in row)
        for row in rows
    ]
    wide_mm = 2 * MARGIN_MM + COLUMNS * (CELL_MM + GAP_MM) - GAP_MM
    high_mm = TOP_MM + sum(tall_mm)
    left = MARGIN_MM / wide_mm
    top = 1.0 - MARGIN_MM / high_mm
    figure = Figure(figsize=figure_files.inches(wide_mm, high_mm))
    figure.set_layout_engine("none")
    figure.text(left, top, title, fontsize=9, fontweight="bold", va="top")
    figure.text(
        left, top - 5.0 / high_mm, f"{EXPLAINED} {note}".strip(), fontsize=6, va="top"
    )
    handles = [
        Line2D([], [], color=colour, linestyle=line, linewidth=width)
        for _, colour, line, width in LINES
    ]
    figure.legend(
        handles,
        [name for name, *_ in LINES],
        loc="upper right",
        bbox_to_anchor=(1.0 - left, top),
        ncols=2,
        borderpad=0.0,
        borderaxespad=0.0,
    )
    grid = figure.add_gridspec(
        len(rows),
        COLUMNS,
        height_ratios=tall_mm,
        left=left,
        right=1.0 - left,
        bottom=0.0,
        top=1.0 - TOP_MM / high_mm,
        wspace=GAP_MM / CELL_MM,
        hspace=0.0,
    )

    for nth, one in enumerate(frames):
        _draw_frame(figure.add_subplot(grid[divmod(nth, COLUMNS)]), one)

    return figure


def _draw_frame(axes: Axes, one: SheetFrame) -> None:
    found = one.found
    methods = one.found.methods
    axes.imshow(one.picture, extent=(0.0, 1.0, 1.0, 0.0), aspect="auto")

    if methods is not None:
        classical = methods.classical
        network = methods.network
        columns = len(found.outer_row)
        walls = (
            (
                np.arange(columns),
                [classical.outer_row, classical.inner_row][: 1 + classical.inner_found],
            ),
            (
                network.column,
                np.where(network.there, [network.outer_row, network.inner_row], np.nan),
            ),
        )

        for (column, rows), (_, colour, line, width) in zip(walls, LINES, strict=True):
            x = (column + 0.5) / columns
            y = (np.asarray(rows).T + 0.5) / found.rows
            axes.plot(
                x,
                np.where(y < 1.0, y, np.nan),
                color=colour,
                linestyle=line,
                linewidth=width,
            )

    axes.set(
        xlim=(0.0, 1.0),
        ylim=(1.0, 0.0),
        xticks=[],
        yticks=[],
        box_aspect=one.aspect,
        anchor="NW",
    )
    axes.spines[:].set(visible=not found.usable, color=figure_files.RED, linewidth=1.5)
    name = figure_files.last_letters(one.name, NAME_LETTERS)
    axes.annotate(
        name,
        (0, 0),
        (0, -3),
        "axes fraction",
        "offset points",
        va="top",
        fontsize=6.5,
        fontweight="bold",
    )
    axes.set_xlabel("\n".join(one.words), loc="left", fontsize=6, labelpad=11.0)
