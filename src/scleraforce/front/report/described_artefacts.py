"""Descriptions of artefacts: libraries, data sets and models; recordings, calibrations,
the decision logs.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from scleraforce.base.errors import InputError, MessageError, RecordingError
from scleraforce.base.units import HumanUnit, from_si
from scleraforce.calibration.calibration import modulus_lines, parse_calibration
from scleraforce.front.report.description import LOG_FILES, Description, range_text
from scleraforce.front.report.figure_files import (
    AMBER,
    BLACK,
    BLUE,
    GREY,
    RED,
    evenly,
    inches,
    styled,
)
from scleraforce.front.report.frame_figures import draw_montage
from scleraforce.front.report.model_figures import draw_curves
from scleraforce.front.report.recording_figures import draw_calibration, draw_recording
from scleraforce.lab.training.slice_dataset import open_dataset
from scleraforce.library.library_file import load_library
from scleraforce.library.library_store import open_library
from scleraforce.library.wall_responses import Library
from scleraforce.live.companions.decision_log import read_log
from scleraforce.live.companions.process_messages import Entry
from scleraforce.live.console.board import sentence_of
from scleraforce.reading.trained_ranges import (
    CLASSIFIER,
    limit_remarks,
    reading_ranges,
)
from scleraforce.recordings.forces_under_frames import (
    Trial,
    label_frames,
    label_remarks,
)
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import open_calibration
from scleraforce.records.missing_inputs import missing_inputs
from scleraforce.records.model_folder import (
    FILES,
    SHIPPED_READER,
    WALL_FINDER,
    folder_study,
    read_folder,
)
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.remark import Remark, sentences
from scleraforce.records.study import ClassesStudy

PICTURED = 24  # slices
TITLES = {
    "mae_mn": "mean error of the force [mN]",
    "lateral_mae_mm": "mean error of the contact [mm]",
    "coverage": "intervals that hold",
    "dice_mean": "overlap (Dice)",
}
# Data behind the metrics of a training. README and docs/figures.md have a reader's
# figures on recordings.
MEASURED_ON = {
    "reader": (
        "the network alone, on simulated slices with values that are missing or wrong;"
        " not what it does on recordings of calibrated eyes, where {default} answers"
        " (docs/figures.md)"
    ),
    "raw-reader": "simulated frames with values that are missing or wrong",
    "classifier": "simulated slices that it was not trained on",
    "wall-finder": "drawn scenes that it was not trained on",
}
MADE_WITH = ("scleraforce", "python", "numpy", "torch", "onnx")


def show_library(path: Path) -> Description:
    """Describe a response library: a store of `scleraforce library`, or the file of a
    model folder.
    """
    library = load_library(path) if path.is_file() else open_library(path)
    shape = library.force_ratio_tpd.shape
    rows = (
        (
            "walls",
            (
                f"radius {from_si(library.radius_m, 'mm'):g} mm,"
                f" {range_text(library.thickness_m, 'um', 'µm')} thick, Poisson's ratio"
                f" {library.poisson_ratio:g}"
            ),
        ),
        ("needle", f"{from_si(2 * library.needle_radius_m, 'mm'):g} mm thick"),
        (
            "load paths",
            (
                f"{shape[0]} thicknesses x {shape[1]} tensions p R/(E t) from"
                f" {library.tension[0]:.3g} to {library.tension[-1]:.3g}"
            ),
        ),
        (
            "dents",
            f"{shape[2]} states of each, {range_text(library.tip_m, 'mm', 'mm')}",
        ),
        ("contacts", f"{range_text(library.polar_rad, 'deg', '°')} from the pole"),
        ("largest F/E", f"{from_si(library.max_force_ratio, 'mm2'):.4g} mm²"),
    )
    facts = {
        "radius_mm": from_si(library.radius_m, "mm"),
        "thickness_um": from_si(library.thickness_m, "um").tolist(),
        "tension": library.tension.tolist(),
        "tip_mm": from_si(library.tip_m, "mm").tolist(),
        "largest_force_ratio_mm2": from_si(library.max_force_ratio, "mm2"),
    }

    return Description(
        kind="library", facts=facts, rows=rows, draw=partial(draw_library, library)
    )


@styled
def draw_library(library: Library) -> Figure:
    """Draw F/E over the dent for every thickness, at the lowest, the middle and the
    highest pressure.
    """
    figure = Figure(figsize=inches(170, 62))
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    dent_mm = from_si(library.tip_m, "mm")
    largest = from_si(library.max_force_ratio, "mm2")
    shades = colormaps["viridis"](np.linspace(0.35, 0.75, len(library.thickness_m)))

    for axes, pressure in zip(panels, (0, len(library.tension) // 2, -1), strict=True):
        walls = zip(
            library.thickness_m,
            library.force_ratio_tpd[:, pressure],
            shades,
            strict=True,
        )
        for thickness_m, ratio_d, shade in walls:
            label = f"{from_si(thickness_m, 'um'):.0f} µm"
            axes.plot(dent_mm, from_si(ratio_d, "mm2"), color=shade, label=label)

        axes.axhline(
            largest,
            color=GREY,
            linewidth=0.6,
            linestyle=(0, (4, 3)),
            label="largest F/E",
        )
        axes.set_title(f"tension p R/(E t) = {library.tension[pressure]:.3g}")
        axes.set_xlabel("dent [mm]")

    panels[0].set(ylabel="force over Young's modulus [mm²]", ylim=(0.0, 1.1 * largest))
    figure.legend(
        *(each[::-1] for each in panels[0].get_legend_handles_labels()),
        loc="outside right upper",
    )

    return figure


def show_data_set(path: Path) -> Description:
    """Describe a data set; raises `DatasetError`."""
    dataset = open_dataset(path)
    _, validation = dataset.split()
    counts = np.bincount(
        dataset.target, minlength=len(dataset.study.classes.bounds_n) + 1
    ).tolist()
    rows = (
        ("slices", f"{dataset.images}, {len(validation)} of them for validation"),
        (
            "classes",
            ", ".join(
                f"{count} of class {label}" for label, count in enumerate(counts)
            ),
        ),
        (
            "forces",
            range_text(
                [float(end(dataset.force_n)) for end in (np.min, np.max)], "mn", "mN"
            ),
        ),
        (
            "walls",
            (
                f"{range_text(np.unique(dataset.read('thickness_m')), 'um', 'µm')}"
                f" thick, {from_si(dataset.youngs_modulus_pa, 'mpa'):.3g} MPa"
            ),
        ),
        ("seed", str(dataset.study.dataset.seed)),
    )
    facts = {
        "images": dataset.images,
        "validation": len(validation),
        "classes": counts,
        "youngs_modulus_mpa": from_si(dataset.youngs_modulus_pa, "mpa"),
    }
    pictured = np.array(evenly(list(range(dataset.images)), PICTURED))

    return Description(
        kind="data set",
        facts=facts,
        rows=rows,
        draw=partial(draw_montage, dataset, pictured),
    )


def show_model(path: Path) -> Description:
    """Describe a model folder; its files are checked against their hashes; raises
    `ModelError`.
    """
    folder = read_folder(path)
    record = folder.record
    metrics = _table(record, "metrics")
    provenance = _table(record, "provenance")
    ranges = reading_ranges(path)
    lines = (
        ("what it reads:", *(f"  {name:<36}{words}" for name, words in ranges))
        if ranges
        else ()
    )
    size = sum(map(len, folder.files.values()))
    bounds_mn = (
        None
        if record["kind"] == WALL_FINDER
        else [from_si(end, "mn") for end in folder_study(folder).classes.bounds_n]
    )
    intervals = _table(record, "intervals")
    measured_on = f"measured on {intervals['eyes']}" if intervals.get("eyes") else "of"
    rows = (
        (
            "kind",
            record["kind"]
            + (
                f", answers with its {record['default']}"
                if record.get("default")
                else ""
            ),
        ),
        (
            "classes",
            f"bounds at {' and '.join(f'{end:g}' for end in bounds_mn)} mN"
            if bounds_mn
            else "",
        ),
        ("training", ", ".join(f"{count} {name}" for name, count in _amounts(record))),
        (
            "figures below are of",
            MEASURED_ON[record["kind"]].format(default=f"its {record.get('default')}"),
        ),
        *(
            (TITLES.get(name, name.replace("_", " ")), f"{value:.4g}")
            for name, value in metrics.items()
            if isinstance(value, int | float)
        ),
        (
            "intervals",
            f"90 %, {measured_on} {intervals.get('source')}" if intervals else "",
        ),
        (
            "made with",
            ", ".join(
                f"{name} {provenance[name]}" for name in MADE_WITH if name in provenance
            ),
        ),
        ("seed", str(provenance.get("seed", "-"))),
        (
            "files",
            (
                f"{', '.join(sorted(folder.files))}: {from_si(float(size), 'mb'):.1f}"
                " MB, hashes match"
            ),
        ),
    )
    curves = {
        name: values
        for name, values in _table(record, "curves").items()
        if isinstance(values, list)
        and values
        and all(isinstance(value, int | float) for value in values)
    }
    facts = {
        "model_kind": record["kind"],
        "default": record.get("default"),
        "class_bounds_mn": bounds_mn,
        "metrics": metrics,
        "provenance": provenance,
        "reads": dict(ranges),
        "files": {name: len(folder.files[name]) for name in FILES[record["kind"]]},
    }
    steps = "epoch" if "epochs" in record else "reports during the training"

    return Description(
        kind="model",
        facts=facts,
        rows=rows,
        lines=lines,
        draw=partial(draw_curves, curves, steps),
    )


def _table(record: Mapping[str, Any], key: str) -> dict[str, Any]:
    found = record.get(key)
    return found if isinstance(found, dict) else {}


def _amounts(record: Mapping[str, Any]) -> list[tuple[str, int]]:
    samples = record.get("samples")
    found = {
        "samples": samples.get("training") if isinstance(samples, dict) else samples
    }
    found |= {name: record.get(name) for name in ("scenes", "epochs", "batches")}
    return [(name, count) for name, count in found.items() if isinstance(count, int)]


LISTED = 12  # frames of a recording (`evaluate` lists all), withdrawals of a log
CLASSES = ClassesStudy()  # the paper's bounds
SHADES = {"NOT_READY": GREY, "WATCHING": BLUE, "PIERCED": AMBER, "WITHDRAW": RED}


def show_recording(path: Path, model: Path = SHIPPED_READER) -> Description:
    """Describe a recording, and the limits of a model that reads it; forces are put
    into the paper's classes.
    """
    recording = read_recording(path)
    fault = None

    try:
        trials = label_frames(recording, CLASSES)
    except RecordingError as error:
        trials = label_frames(replace(recording, forces=None), CLASSES)
        fault = str(error)

    here = (
        *limit_remarks(model, recording.info),
        *label_remarks(recording, () if fault else trials),
        *missing_inputs(
            recording.info.setup,
            forces=recording.forces is not None,
            classifier=read_folder(model).record["kind"] == CLASSIFIER,
        ),
    )
    # of the import without what is said of its inputs and labels here
    remarks = (*here, *(r for r in recording.remarks if r.code not in SAID_ANEW))
    log = recording.forces
    log_words = "none: its frames can be read, but neither scored nor calibrated on"

    if log is not None:
        taken_s = log.time_s[-1] - log.time_s[0]
        log_words = (
            f"{len(log.time_s)} samples at {log.sample_rate_hz:.4g} Hz, {taken_s:.4g} s"
        )

    info = recording.info
    seconds = recording.frames[-1].time_s - recording.frames[0].time_s
    width_mm, depth_mm = (
        from_si(extent_m, "mm") for extent_m in (info.scan.width_m, info.scan.depth_m)
    )
    forces_n = [
        trial.measured_force_n for trial in trials if trial.measured_force_n is not None
    ]
    counts = Counter(trial.target for trial in trials)
    of_classes = ", ".join(
        f"{counts[label]} of class {label}"
        for label in range(len(CLASSES.bounds_n) + 1)
    )
    globe = None if info.eye.globe is None else info.eye.globe.kind
    rows = (
        ("eye", info.eye_name),
        (
            "stated",
            (
                f"thickness {_value(info.eye.thickness_m, 'um', 'µm')}, "
                f"IOP {_value(info.eye.iop_pa, 'mmhg', 'mmHg')}, "
                f"globe {globe or 'not stated: intervals are wider'}"
            ),
        ),
        (
            "frames",
            (
                f"{len(recording.frames)} in {seconds:.3g} s, {info.scan.columns} x"
                f" {info.scan.rows} pixels of {info.scan.bits} bits, {width_mm:g} x"
                f" {depth_mm:g} mm, refractive index {info.scan.refractive_index:g}"
            ),
        ),
        ("needle", f"{info.needle.gauge} gauge, {_planes_words(info)}"),
        ("force log", log_words),
        (
            "forces",
            (
                f"{range_text([min(forces_n), max(forces_n)], 'mn', 'mN')}:"
                f" {of_classes}"
                if forces_n
                else ""
            ),
        ),
        ("no labels", fault or ""),
        *_remark_rows(remarks),
    )
    facts = {
        "eye": info.eye_name,
        "seconds": seconds,
        "globe": globe,
        "no_labels": fault,
        "notes": list(sentences(remarks)),
        "remarks": [remark.to_dict() for remark in remarks],
        "frames": [
            {
                "file": trial.file,
                "time_s": trial.time_s,
                "measured_force_mn": from_si(trial.measured_force_n, "mn"),
                "target": trial.target,
                "excluded": trial.excluded,
            }
            for trial in trials
        ],
    }
    lines = tuple(_frame_lines(trials))
    draw = partial(draw_recording, recording, trials, CLASSES.bounds_n)

    return Description(kind="recording", facts=facts, rows=rows, lines=lines, draw=draw)


# Remarks of an import that a description of its recording has as they are now.
SAID_ANEW = (
    "outside-training",
    "inputs-ignored",
    "missing-input",
    "log-slow",
    "samples-without-force",
    "frames-without-label",
)


def _remark_rows(remarks: Iterable[Remark]) -> tuple[tuple[str, str], ...]:
    """Return a row for each remark, named by its severity."""
    each_once = dict.fromkeys((remark.severity, str(remark)) for remark in remarks)
    return tuple(each_once)


def _frame_lines(trials: tuple[Trial, ...]) -> list[str]:
    lines = [f"{'frame':<20}{'time/s':>10}{'force/mN':>10}{'class':>7}  remark"]
    for trial in trials[:LISTED]:
        known = trial.measured_force_n is not None
        force = f"{from_si(trial.measured_force_n or 0.0, 'mn'):.1f}" if known else "-"
        target = "-" if trial.target is None else str(trial.target)
        name = trial.file if len(trial.file) < 20 else f"{trial.file[:18]}…"
        lines.append(
            f"{name:<20}{trial.time_s:>10.3f}{force:>10}{target:>7} "
            f" {trial.excluded or ''}".rstrip()
        )

    left = len(trials) - LISTED
    return [*lines, f"... and {left} more"] if left > 0 else lines


def _value(value: float | None, unit: HumanUnit, printed: str) -> str:
    return "not stated" if value is None else f"{from_si(value, unit):.4g} {printed}"


def show_calibration(path: Path) -> Description:
    """Describe a calibration file; raises `CalibrationError`."""
    calibration = parse_calibration(open_calibration(path))
    mean_pa, sd_pa = calibration.population
    used = sum(len(eye.used) for eye in calibration.eyes.values())
    rows = (
        ("eyes", f"{len(calibration.eyes)}, on {used} frames"),
        ("mechanics", calibration.mechanics),
        ("study, SHA-256", calibration.study_sha256),
        *_remark_rows(calibration.remarks),
    )
    facts = {
        "remarks": [remark.to_dict() for remark in calibration.remarks],
        "mechanics": calibration.mechanics,
        "study_sha256": calibration.study_sha256,
        "population": {
            "mean_mpa": from_si(mean_pa, "mpa"),
            "sd_mpa": from_si(sd_pa, "mpa"),
        },
        "eyes": {
            name: {
                "mean_mpa": from_si(eye.mean_pa, "mpa"),
                "sd_mpa": from_si(eye.sd_pa, "mpa"),
                "frames": len(eye.used),
                "status": eye.status,
            }
            for name, eye in calibration.eyes.items()
        },
    }
    lines = tuple(modulus_lines(calibration))

    return Description(
        kind="calibration",
        facts=facts,
        rows=rows,
        lines=lines,
        draw=partial(draw_calibration, calibration),
    )


def show_decision_log(path: Path) -> Description:
    """Describe a log: a file, the folder of its files, or the folder of a black box;
    raises `InputError`.
    """
    decisions, notes, torn = _read_decisions(
        path / "log" if (path / "log").is_dir() else path
    )
    withdrawals = [entry for entry in _changes(decisions) if entry.state == "WITHDRAW"]
    forces_mn = [entry.force_mn for entry in decisions if entry.force_mn is not None]
    causes = Counter(entry.cause or "?" for entry in withdrawals)
    frames = sum(entry.event == "frame" for entry in decisions)
    span_words = ""

    if decisions:
        begin = datetime.fromtimestamp(decisions[0].time_s, UTC)
        span_words = (
            f"{decisions[-1].at_s - decisions[0].at_s:.4g} s from"
            f" {begin:%Y-%m-%d %H:%M:%S} UTC"
        )

    rows = (
        ("decisions", f"{len(decisions)}, {frames} of them on a frame"),
        ("span", span_words),
        (
            "forces",
            f"{min(forces_mn):.1f} to {max(forces_mn):.1f} mN" if forces_mn else "",
        ),
        ("lost frames", str(decisions[-1].lost) if decisions else ""),
        (
            "withdrawals",
            ", ".join(f"{count} {cause}" for cause, count in causes.items()) or "none",
        ),
        ("notes", str(len(notes))),
        ("torn", f"{torn} parts could not be read" if torn else "nothing"),
    )
    facts = {
        "decisions": len(decisions),
        "frames": frames,
        "withdrawals": [
            {
                "number": entry.number,
                "time_s": entry.time_s,
                "cause": entry.cause,
                "message": entry.message,
            }
            for entry in withdrawals
        ],
        "notes": notes,
        "torn": torn,
    }
    lines = tuple(_listed(withdrawals))
    draw = partial(draw_decisions, decisions)

    return Description(
        kind="decision log", facts=facts, rows=rows, lines=lines, draw=draw
    )


def _read_decisions(folder: Path) -> tuple[tuple[Entry, ...], tuple[str, ...], int]:
    for file in folder.glob(LOG_FILES):
        if not file.is_file():
            raise InputError(f"{file}: not a regular file; a log has no other files")

    decisions = list[Entry]()
    notes = list[str]()
    torn = 0

    for part in read_log(folder):
        if part.record is None:
            torn += 1
        elif part.record.get("kind") == "entry":
            try:
                decisions.append(Entry.from_json(part.record.get("entry")))
            except MessageError as fault:
                raise InputError(
                    f"{part.file}: byte {part.offset}: entry: {fault}"
                ) from fault
        else:
            notes.append(str(part.record.get("text", "")))

    if not decisions and not notes:
        raise InputError(f"{folder}: no whole record of a decision log in it")

    return tuple(decisions), tuple(notes), torn


def _changes(decisions: Sequence[Entry]) -> list[Entry]:
    return [
        after
        for n, after in enumerate(decisions)
        if not n or decisions[n - 1].state != after.state
    ]


@styled
def draw_decisions(decisions: Sequence[Entry]) -> Figure:
    """Draw the read force with its interval over time; the ground says the state."""
    figure = Figure(figsize=inches(170, 70))
    axes = figure.subplots()
    start_s = decisions[0].at_s if decisions else 0.0
    read = [
        entry
        for entry in decisions
        if entry.force_mn is not None and entry.interval_mn is not None
    ]
    at_s = np.array([entry.at_s - start_s for entry in read])
    ends_mn = np.array([entry.interval_mn for entry in read], dtype=float).reshape(
        -1, 2
    )
    force_mn = np.array([entry.force_mn for entry in read], dtype=float)

    if read:
        axes.fill_between(
            at_s,
            *ends_mn.T,
            color=AMBER,
            alpha=0.35,
            linewidth=0,
            label="90 % interval",
        )
        axes.plot(at_s, force_mn, color=BLACK, linewidth=0.8, label="force")

    changes = _changes(decisions)
    for begin, end in zip(changes, [*changes[1:], *decisions[-1:]], strict=False):
        axes.axvspan(
            begin.at_s - start_s,
            end.at_s - start_s,
            color=SHADES[begin.state],
            alpha=0.12,
            linewidth=0,
        )

    for state in dict.fromkeys(change.state for change in changes):
        axes.fill_between([], [], color=SHADES[state], alpha=0.12, label=state)

    axes.set(xlabel="time [s]", ylabel="force [mN]")
    axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside upper left", ncols=5)
    return figure


def _listed(withdrawals: Sequence[Entry]) -> Iterator[str]:
    for entry in withdrawals[:LISTED]:
        when = datetime.fromtimestamp(entry.time_s, UTC)
        yield (
            f"{when:%H:%M:%S} UTC, decision {entry.number}:"
            f" {sentence_of(entry.cause or '')}"
        )
    if len(withdrawals) > LISTED:
        yield f"... and {len(withdrawals) - LISTED} more"


def _planes_words(info: RecordingInfo) -> str:
    """Return where the planes of the B-scans are."""
    if info.needle.gap_m is not None:
        return f"{from_si(info.needle.gap_m, 'mm'):g} mm beside the B-scan"

    words = (
        f"{plane.name} ({from_si(plane.offset_m, 'mm'):g} mm,"
        f" {from_si(plane.direction_rad, 'deg'):.0f}°)"
        for plane in info.scan.planes
    )
    return f"B-scans in {len(info.scan.planes)} planes: {', '.join(words)}"
