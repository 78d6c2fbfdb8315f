"""One wall, open and sealed, and what is read of its frames:
docs/images/sealed_eye.png.

python benchmarks/figure_sealed_eye.py MODEL [--out FILE] [--frames N]
"""

import argparse
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from figures.eyes import FigureEye
from figures.sections import ComputedEye, compute_eye
from monitor_sessions.declarations import calibrated
from scleraforce.base.units import from_si, to_si
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
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import GlobeStudy, Study, draw
from virtual_eyes import changed

Frame = NDArray[np.uint16]

IMAGE = Path(__file__).parent.parent / "docs" / "images" / "sealed_eye.png"
SEED = 20_261_122
SETUP = Setup(
    eye=Eye(
        "eye",
        thickness_m=0.6e-3,
        modulus=Modulus.stated(0.45e6),
        iop_pa=to_si(2.0, "mmhg"),
    ),
    needle=Needle(gap_m=0.5e-3, polar_rad=radians(35.0)),
)
RIGIDITY = to_si(0.03, "mmhg13_per_ul")
LARGEST_MN = 60.0
DEEPEST_MM = 2.6
CALIBRATION_N = (10e-3, 20e-3, 28e-3)
DECLARED = "declared sealed, E and k found on three frames"
UNDECLARED = "no globe declared, E known to 3 %"
AS_OPEN = "declared open, E known to 3 %"
TEXT: Final[dict[str, Any]] = {"fontsize": 7, "textcoords": "offset points"}
OF_KNOWN_FORCE: Final[dict[str, Any]] = {
    "color": BLACK,
    "markerfacecolor": "none",
    "markersize": 4,
    "label": "the three frames of known force",
}
LOOKS = {DECLARED: (BLUE, "o"), UNDECLARED: (AMBER, "s"), AS_OPEN: (RED, "^")}


@dataclass(frozen=True)
class Seen:
    """A frame of the sealed eye: its true force, N, its dent, m, and its readings by
    declaration.
    """

    force_n: float
    dent_m: float
    answers: dict[str, Answer]


def computed(study: Study, globe: GlobeStudy) -> ComputedEye:
    """Return the wall bent in three dimensions, in a globe."""
    study = replace(
        study,
        globe=globe,
        needle=replace(study.needle, max_force_n=to_si(LARGEST_MN, "mn")),
    )
    return compute_eye(FigureEye("sealed eye", SETUP, study, shares=(), seed=SEED))


def frame_of(eye: ComputedEye, force_n: float, number: int) -> Frame:
    """Return a raw frame under a force, with optics and a place of its own."""
    rng = np.random.default_rng((SEED, number))
    phantom = eye.study.phantom
    optics = sample_optics(phantom, eye.study.oct, rng)
    pose = Pose(
        lateral_m=draw(phantom.eye_shift_m, rng),
        depth_m=draw(phantom.surface_depth_m, rng),
    )
    (section,) = eye.sections_at([force_n])

    return render_bscan(pose.place(section), eye.study.oct, optics, rng).frame


def tellings(sealed: ComputedEye, reader: ForceReader) -> dict[str, Setup]:
    """Return the known inputs of the eye with each declaration."""
    rng = np.random.default_rng((SEED, 0))
    stated = Setup(
        eye=Eye(
            iop_pa=SETUP.eye.iop_pa, thickness_m=SETUP.eye.thickness_m, globe=UNKNOWN
        ),
        needle=Needle(gap_m=SETUP.needle.gap_m, polar_rad=SETUP.needle.polar_rad),
    )
    labelled = [
        (frame_of(sealed, force_n, number), force_n + rng.normal(0.0, LABEL_SD_N))
        for number, force_n in enumerate(CALIBRATION_N, start=1)
    ]
    modulus = Modulus.stated(SETUP.eye.modulus_pa)

    return {
        DECLARED: calibrated(changed(stated, globe=SEALED), labelled, reader),
        UNDECLARED: with_modulus(stated, modulus),
        AS_OPEN: with_modulus(changed(stated, globe=OPEN), modulus),
    }


def read_frames(sealed: ComputedEye, reader: ForceReader, count: int) -> list[Seen]:
    """Return a number of frames of the sealed eye, with forces up to the largest, and
    their readings.
    """
    forces_n = np.linspace(2e-3, sealed.largest_n - 2e-3, count).tolist()
    scale = PixelScale.of(reader.study.oct)
    known = tellings(sealed, reader)
    seen = []

    for number, (force_n, dent_m) in enumerate(
        zip(forces_n, sealed.tips_m(forces_n), strict=True)
    ):
        frame = frame_of(sealed, force_n, 100 + number)
        answers = {
            name: reader.read(frame, scale, told) for name, told in known.items()
        }
        seen.append(Seen(force_n, dent_m, answers))

    return seen


@styled
def draw_eye(opened: ComputedEye, sealed: ComputedEye, seen: list[Seen]) -> Figure:
    """Draw force against dent of both globes, and beside them the readings with and
    without a declared globe.
    """
    figure = Figure(figsize=inches(170, 88))
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)

    for axes, names, title in (
        (left, [DECLARED], "Declared sealed"),
        (
            right,
            [UNDECLARED, AS_OPEN],
            "The same frames, not declared or declared open",
        ),
    ):
        draw_curves(axes, opened, sealed)
        for name in names:
            draw_readings(axes, seen, name)

        axes.set_title(title)
        axes.set_xlabel("dent [mm]")

    dents_mm = [from_si(dent_m, "mm") for dent_m in sealed.tips_m(CALIBRATION_N)]
    left.plot(
        dents_mm,
        [from_si(force_n, "mn") for force_n in CALIBRATION_N],
        "D",
        zorder=5,
        **OF_KNOWN_FORCE,
    )

    for axes in (left, right):
        axes.legend(loc="upper left", fontsize=6.5)

    left.set_ylabel("force [mN]")
    left.set_xlim(0.0, DEEPEST_MM)
    left.set_ylim(0.0, 1.25 * LARGEST_MN)
    return figure


def draw_curves(axes: Axes, opened: ComputedEye, sealed: ComputedEye) -> None:
    """Draw the true force against the dent, open and sealed, and the bounds of the
    classes.
    """
    for bound_n in sealed.study.classes.bounds_n:
        bound_mn = from_si(bound_n, "mn")
        axes.axhline(
            bound_mn, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)), zorder=0
        )
        axes.annotate(
            f"{bound_mn:g} mN",
            (DEEPEST_MM, bound_mn),
            (0, -9),
            color=GREY,
            ha="right",
            **TEXT,
        )

    for eye, dashes, label in ((opened, "--", "open"), (sealed, "-", "  sealed")):
        forces_n = np.linspace(0.0, eye.largest_n, 120).tolist()
        dents_mm = np.array([from_si(dent_m, "mm") for dent_m in eye.tips_m(forces_n)])
        forces_mn = np.array([from_si(force_n, "mn") for force_n in forces_n])
        shown = dents_mm <= DEEPEST_MM
        axes.plot(
            dents_mm[shown],
            forces_mn[shown],
            color=BLACK,
            linestyle=dashes,
            linewidth=0.9,
            zorder=1,
        )
        end = (float(dents_mm[shown][-1]), float(forces_mn[shown][-1]))
        side: Literal["left", "right"] = (
            "left" if end[0] < 0.9 * DEEPEST_MM else "right"
        )
        axes.annotate(
            label, end, (0, 4 if side == "right" else -3), color=BLACK, ha=side, **TEXT
        )


def draw_readings(axes: Axes, seen: list[Seen], name: str) -> None:
    """Draw what is read of the frames, with its interval, at their true dents."""
    colour, marker = LOOKS[name]
    read = [
        (one.dent_m, one.answers[name])
        for one in seen
        if one.answers[name].interval_n is not None
    ]
    dents_mm = [from_si(dent_m, "mm") for dent_m, _ in read]
    forces_mn = np.array([from_si(answer.force_n or 0.0, "mn") for _, answer in read])
    ends_mn = np.array(
        [
            [from_si(end_n, "mn") for end_n in answer.interval_n or ()]
            for _, answer in read
        ]
    )
    reach_mn = np.abs(ends_mn - forces_mn[:, None]).T
    axes.errorbar(
        dents_mm,
        forces_mn,
        reach_mn,
        fmt=marker,
        color=colour,
        markersize=3.2,
        elinewidth=1.0,
        label=name,
    )


def main() -> None:
    """Compute, read, print and draw."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("model", type=Path, help="a reader")
    parser.add_argument("--out", type=Path, default=IMAGE, help="the picture")
    parser.add_argument("--frames", type=int, default=15, help="that are read")
    given = parser.parse_args()
    reader = load_force_reader(given.model)
    opened = computed(reader.study, GlobeStudy("open"))
    sealed = computed(reader.study, GlobeStudy("sealed", RIGIDITY))
    seen = read_frames(sealed, reader, given.frames)
    print("force, dent; what is read with its 90 % interval, mN: " + "; ".join(LOOKS))

    for one in seen:
        print(
            f"{from_si(one.force_n, 'mn'):5.1f} mN {from_si(one.dent_m, 'mm'):.2f} mm"
            + "".join(f"  {words(one.answers[name])}" for name in LOOKS)
        )

    write_figure(draw_eye(opened, sealed, seen), given.out)


def words(answer: Answer) -> str:
    """Return an answer as a cell."""
    if answer.force_n is None or answer.interval_n is None:
        return f"not read: {answer.reason}"
    low, high = answer.interval_n
    return (
        f"{from_si(answer.force_n, 'mn'):.1f} ({from_si(low, 'mn'):.1f} to"
        f" {from_si(high, 'mn'):.1f})"
    )


if __name__ == "__main__":
    main()
