"""One wall, open and sealed, and what is read of its frames: docs/images/sealed_eye.png
and its caption in docs/reader.md.

The sealed eye's frames are read as three declarations tell: sealed and calibrated on
three frames up to 28 mN; no globe, E known to 3 %; open, E known to 3 %.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path

import click
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from figures.eyes import FigureEye
from figures.printing import picture, print_table, whole_number
from figures.sections import ComputedEye, compute_eye
from monitor.declarations import calibrated
from scleraforce.base.units import to_si
from scleraforce.calibration.filter.eye_parameters import with_modulus
from scleraforce.front.report.figure_files import (
    AMBER,
    BLACK,
    BLUE,
    GREY,
    RED,
    inches,
    styled,
    write_figure,
)
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.tissue_light import Pose, sample_optics
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.recordings.force_errors import LABEL_SD_N
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import GlobeStudy, Study, draw
from virtual_eyes import changed

SEED = 20_261_122
SETUP = changed(
    Setup(),
    name="eye",
    thickness_m=0.6e-3,
    youngs_modulus_pa=0.45e6,
    iop_pa=to_si(2.0, "mmhg"),
    gap_m=0.5e-3,
    polar_rad=radians(35.0),
)
RIGIDITY = to_si(0.03, "mmhg13_per_ul")
LARGEST_N = 60e-3
EDGE_N = 2e-3  # of the read forces, from 0 and the largest
DEEPEST_MM = 2.6
CALIBRATION_N = (10e-3, 20e-3, 28e-3)
DECLARED = "declared sealed, E and k found on three frames"
UNDECLARED = "no globe declared, E known to 3 %"
AS_OPEN = "declared open, E known to 3 %"
LOOKS = {DECLARED: (BLUE, "o"), UNDECLARED: (AMBER, "s"), AS_OPEN: (RED, "^")}
PANELS = {
    "Declared sealed": (DECLARED,),
    "The same frames, not declared or declared open": (UNDECLARED, AS_OPEN),
}


@dataclass(frozen=True)
class ReadFrame:
    """A frame of the sealed eye: its true force, N, its dent, m, and its readings by
    declaration.
    """

    force_n: float
    dent_m: float
    answers: dict[str, Answer]


def computed(study: Study, globe: GlobeStudy) -> ComputedEye:
    """Return the wall bent in three dimensions, in a globe."""
    needle = replace(study.needle, max_force_n=LARGEST_N)
    study = replace(study, globe=globe, needle=needle)
    return compute_eye(FigureEye("sealed eye", SETUP, study, shares=(), seed=SEED))


def frame_of(eye: ComputedEye, force_n: float, stream: int) -> NDArray[np.uint16]:
    """Return a raw frame under a force, with optics and a place of its own."""
    rng = np.random.default_rng((SEED, stream))
    phantom = eye.study.phantom
    optics = sample_optics(phantom, eye.study.oct, rng)
    lateral_m = draw(phantom.eye_shift_m, rng)
    pose = Pose(lateral_m=lateral_m, depth_m=draw(phantom.surface_depth_m, rng))
    (section,) = eye.sections_at([force_n])
    return render_bscan(pose.place(section), eye.study.oct, optics, rng).frame


def declarations(sealed: ComputedEye, reader: ForceReader) -> dict[str, Setup]:
    """Return the known inputs of the eye with each declaration."""
    rng = np.random.default_rng((SEED, 0))
    stated = changed(SETUP, name=None, modulus=None, globe=UNKNOWN)
    labelled = [
        (frame_of(sealed, force_n, stream), force_n + rng.normal(0.0, LABEL_SD_N))
        for stream, force_n in enumerate(CALIBRATION_N, start=1)
    ]
    assert SETUP.eye.modulus is not None
    return {
        DECLARED: calibrated(changed(stated, globe=SEALED), labelled, reader),
        UNDECLARED: with_modulus(stated, SETUP.eye.modulus),
        AS_OPEN: with_modulus(changed(stated, globe=OPEN), SETUP.eye.modulus),
    }


def read_frames(
    sealed: ComputedEye, reader: ForceReader, count: int
) -> Iterator[ReadFrame]:
    """Yield frames of the sealed eye, with even forces, and their readings."""
    forces_n = np.linspace(EDGE_N, sealed.largest_n - EDGE_N, count).tolist()
    scale = PixelScale.of(reader.study.oct)
    known = declarations(sealed, reader)

    for frame, force_n in enumerate(forces_n):
        pixels = frame_of(sealed, force_n, 100 + frame)
        answers = {
            name: reader.read(pixels, scale, setup) for name, setup in known.items()
        }
        yield ReadFrame(force_n, sealed.tips_m([force_n])[0], answers)


@styled
def draw_eye(
    opened: ComputedEye, sealed: ComputedEye, frames: list[ReadFrame]
) -> Figure:
    """Draw force against dent of both globes, and the readings of each declaration."""
    figure = Figure(figsize=inches(170, 88))
    panels = figure.subplots(1, 2, sharex=True, sharey=True)

    for axes, (title, names) in zip(panels, PANELS.items(), strict=True):
        for bound_n in sealed.study.classes.bounds_n:
            axes.axhline(1e3 * bound_n, color=GREY, linewidth=0.6, linestyle="--")
        for eye, dashes, label in ((opened, "--", "open"), (sealed, "-", "sealed")):
            forces_n = np.linspace(0.0, eye.largest_n, 120)
            dents_mm = 1e3 * np.array(eye.tips_m(forces_n.tolist()))
            line = {"color": BLACK, "linestyle": dashes, "linewidth": 0.9}
            axes.plot(dents_mm, 1e3 * forces_n, label=label, **line)
        for name in names:
            draw_readings(axes, frames, name)
        axes.set(title=title, xlabel="dent [mm]")

    known_mm = 1e3 * np.array(sealed.tips_m(CALIBRATION_N))
    known = {"color": BLACK, "markerfacecolor": "none", "markersize": 4}
    label = "the three frames of known force"
    known_mn = 1e3 * np.array(CALIBRATION_N)
    panels[0].plot(known_mm, known_mn, "D", label=label, zorder=5, **known)
    panels[0].set(xlim=(0.0, DEEPEST_MM), ylim=(0.0, 75.0), ylabel="force [mN]")
    for axes in panels:
        axes.legend(loc="upper left", fontsize=6.5)
    return figure


def draw_readings(axes: Axes, frames: list[ReadFrame], name: str) -> None:
    """Draw what is read of the frames, with its interval, at their true dents."""
    colour, marker = LOOKS[name]
    for frame in frames:
        answer = frame.answers[name]
        if answer.force_n is not None and answer.interval_n is not None:
            dent_mm = 1e3 * frame.dent_m
            ends_mn = 1e3 * np.array(answer.interval_n)
            axes.plot([dent_mm] * 2, ends_mn, color=colour, linewidth=1.0)
            axes.plot(dent_mm, 1e3 * answer.force_n, marker, color=colour, markersize=3)

    axes.plot([], [], marker, color=colour, markersize=3, label=name)


def text(answer: Answer) -> str:
    """Return an answer as a cell."""
    if answer.force_n is None or answer.interval_n is None:
        return f"not read: {answer.reason}"
    low_mn, high_mn = 1e3 * np.array(answer.interval_n)
    return f"{1e3 * answer.force_n:.1f} ({low_mn:.1f} to {high_mn:.1f})"


@click.command(help=__doc__)
@whole_number("--frames", 15, "Frames that are read.")
@click.option("--reader", default="default", help="A reader.")
@picture("sealed_eye.png")
def main(frames: int, reader: str, out: Path) -> None:
    """Compute, read, print and draw."""
    model = load_force_reader(Path(reader))
    opened = computed(model.study, GlobeStudy("open"))
    sealed = computed(model.study, GlobeStudy("sealed", RIGIDITY))
    read = list(read_frames(sealed, model, frames))
    rows = (
        [
            f"{1e3 * frame.force_n:.1f}",
            f"{1e3 * frame.dent_m:.2f}",
            *(text(frame.answers[name]) for name in LOOKS),
        ]
        for frame in read
    )
    print_table(["force, mN", "dent, mm", *LOOKS], rows)
    write_figure(draw_eye(opened, sealed, read), out)
