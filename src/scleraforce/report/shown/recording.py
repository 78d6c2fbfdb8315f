"""A recording folder: what it states, its frames, and the force under each."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scleraforce.errors import RecordingError
from scleraforce.models import SHIPPED_READER
from scleraforce.reader.limits import limit_notes
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.recording.labels import Trial, contact_force, label_frames, label_notes
from scleraforce.report.files import BLACK, CLASS_COLOURS, CLASS_MARKERS, GREY, SCAN_COLOURS, inches, styled
from scleraforce.report.shown.kinds import Thing, span, value_words
from scleraforce.study import ClassesStudy
from scleraforce.units import from_si

LISTED = 12  # frames, at the beginning; `evaluate` lists them all
PICTURED = 3
CLASSES = ClassesStudy()  # the paper's bounds


def show_recording(path: Path, model: Path = SHIPPED_READER) -> Thing:
    """Look at a recording, and whether a model reads it; forces are put into the paper's classes.

    Raises:
        RecordingError: it cannot be read.
        ModelError: the model cannot.
    """
    recording = read_recording(path)
    trials, fault = _labelled(recording)
    notes = (*limit_notes(model, recording.info), *label_notes(recording, () if fault else trials))
    info, seconds = recording.info, recording.frames[-1].time_s - recording.frames[0].time_s
    width_mm, depth_mm = (from_si(extent_m, "mm") for extent_m in (info.oct.width_m, info.oct.depth_m))
    forces_n = [trial.measured_force_n for trial in trials if trial.measured_force_n is not None]
    counts = Counter(trial.target for trial in trials)
    globe = info.eye.globe or "not stated: intervals are wider"
    rows = (
        ("eye", info.eye.id),
        ("stated", f"thickness {value_words(info.eye.thickness_m, 'um', 'µm')}, "
                   f"IOP {value_words(info.eye.iop_pa, 'mmhg', 'mmHg')}, globe {globe}"),
        ("frames", f"{len(recording.frames)} in {seconds:.3g} s, {info.oct.columns} x {info.oct.rows} pixels of "
                   f"{info.oct.bits} bits, {width_mm:g} x {depth_mm:g} mm, "
                   f"refractive index {info.oct.refractive_index:g}"),
        ("needle", f"{info.needle.gauge} gauge, {from_si(info.needle.slice_gap_m, 'mm'):g} mm beside the B-scan"),
        ("force log", _log_words(recording)),
        *((("forces", span([min(forces_n), max(forces_n)], "mn", "mN") + ": " + ", ".join(
            f"{counts[label]} of class {label}" for label in range(len(CLASSES.bounds_n) + 1))),) if forces_n else ()),
        *((("no labels", fault),) if fault else ()),
        *(("note", note) for note in notes),
    )  # fmt: skip
    facts = {
        "eye": info.eye.id,
        "seconds": seconds,
        "globe": info.eye.globe,
        "no_labels": fault,
        "notes": list(notes),
        "frames": [
            {"file": trial.file, "time_s": trial.time_s, "measured_force_mn": from_si(trial.measured_force_n, "mn"),
             "target": trial.target, "excluded": trial.excluded}
            for trial in trials
        ],
    }  # fmt: skip
    return Thing(
        kind="recording",
        facts=facts,
        rows=rows,
        lines=tuple(_table(trials)),
        draw=lambda: draw_recording(recording, trials),
    )


def _labelled(recording: Recording) -> tuple[tuple[Trial, ...], str | None]:
    """Return the frames with their labels, or without and why: who looks at them may be looking for the fault."""
    try:
        return label_frames(recording, CLASSES), None
    except RecordingError as fault:
        return label_frames(replace(recording, forces=None), CLASSES), str(fault)


@styled
def draw_recording(recording: Recording, trials: tuple[Trial, ...]) -> Figure:
    """Draw the force over time with its frames, and above it three frames of different force."""
    figure = Figure(figsize=inches(170, 80))
    grid = figure.add_gridspec(2, 1, height_ratios=(0.7, 1.0))
    pictures, curve = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    chosen = _of_different_force(trials)
    extent = (0.0, from_si(recording.info.oct.width_m, "mm"), from_si(recording.info.oct.depth_m, "mm"), 0.0)
    for axes, place in zip(pictures.subplots(1, len(chosen), squeeze=False)[0], chosen, strict=True):
        axes.imshow(recording.frame(recording.frames[place]), cmap=SCAN_COLOURS, extent=extent)
        force_n = trials[place].measured_force_n
        words = "" if force_n is None else f": {from_si(force_n, 'mn'):.1f} mN"
        axes.set_title(f"{trials[place].file}{words}")
        axes.set_xlabel("mm")
    _draw_forces(curve.subplots(), recording, trials)
    if recording.forces is not None:
        curve.legend(loc="outside upper center", ncols=4)
    return figure


def _draw_forces(axes: Axes, recording: Recording, trials: tuple[Trial, ...]) -> None:
    if recording.forces is None or recording.info.force is None:
        axes.plot([trial.time_s for trial in trials], [0.0] * len(trials), "|", color=BLACK)
        axes.set_yticks([])
        axes.set_title("frames; their forces were not logged")
    else:
        force_mn = from_si(contact_force(recording.forces, recording.info.force), "mn")
        axes.plot(recording.forces.time_s, force_mn, color=GREY, linewidth=0.7, label="force log, filtered and tared")
        for bound_n in CLASSES.bounds_n:
            axes.axhline(from_si(bound_n, "mn"), color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
        for label, colour, marker in zip(range(len(CLASS_COLOURS)), CLASS_COLOURS, CLASS_MARKERS, strict=True):
            of_class = [(t.time_s, from_si(t.measured_force_n, "mn")) for t in trials if t.target == label]
            if of_class:
                axes.plot(*zip(*of_class, strict=True), marker, color=colour, markersize=4, label=f"class {label}")
        axes.set_ylabel("force [mN]")
    axes.set_xlabel("time [s]")


def _of_different_force(trials: tuple[Trial, ...]) -> list[int]:
    """Return the frames of the lowest, the middle and the highest force, in the order of time where none is known."""
    order = sorted(range(len(trials)), key=lambda n: trials[n].measured_force_n or 0.0)
    places = np.linspace(0, len(order) - 1, min(PICTURED, len(order))).round().astype(int)
    return [order[place] for place in places]


def _log_words(recording: Recording) -> str:
    log = recording.forces
    if log is None:
        return "none: its frames can be read, but neither scored nor calibrated on"
    return f"{len(log.time_s)} samples at {log.sample_rate_hz:.4g} Hz, {log.time_s[-1] - log.time_s[0]:.4g} s"


def _table(trials: tuple[Trial, ...]) -> list[str]:
    """Return the first frames, a line each."""
    lines = [f"{'frame':<20}{'time/s':>10}{'force/mN':>10}{'class':>7}  remark"]
    for trial in trials[:LISTED]:
        known = trial.measured_force_n is not None
        force = f"{from_si(trial.measured_force_n or 0.0, 'mn'):.1f}" if known else "-"
        target = "-" if trial.target is None else str(trial.target)
        name = trial.file if len(trial.file) < 20 else f"{trial.file[:18]}…"
        lines.append(f"{name:<20}{trial.time_s:>10.3f}{force:>10}{target:>7}  {trial.excluded or ''}".rstrip())
    left = len(trials) - LISTED
    return [*lines, f"... and {left} more"] if left > 0 else lines
