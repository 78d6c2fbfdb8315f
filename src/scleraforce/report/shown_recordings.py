"""Descriptions of measured things: recordings, calibrations, and the monitor's decision logs."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scleraforce.calibration.result import calibration_lines, parse_calibration
from scleraforce.errors import InputError, MessageError, RecordingError
from scleraforce.known.calibration_file import open_calibration
from scleraforce.models import SHIPPED_READER
from scleraforce.reader.limits import limit_notes
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.recording.labels import Trial, label_frames, label_notes
from scleraforce.report.files import AMBER, BLACK, BLUE, GREY, RED, inches, styled
from scleraforce.report.recording_figures import draw_calibration, draw_recording
from scleraforce.report.shown import LOG_FILES, Thing, span
from scleraforce.service.console.board import sentence_of
from scleraforce.service.decision_log import read_log
from scleraforce.service.messages import Entry
from scleraforce.study import ClassesStudy
from scleraforce.units import HumanUnit, from_si

LISTED = 12  # frames of a recording (`evaluate` lists all), withdrawals of a log
CLASSES = ClassesStudy()  # the paper's bounds
SHADES = {"NOT_READY": GREY, "WATCHING": BLUE, "PIERCED": AMBER, "WITHDRAW": RED}


def show_recording(path: Path, model: Path = SHIPPED_READER) -> Thing:
    """Describe a recording, and the limits of a model that reads it; forces are put into the paper's classes."""
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
        ("stated", f"thickness {_value(info.eye.thickness_m, 'um', 'µm')}, "
                   f"IOP {_value(info.eye.iop_pa, 'mmhg', 'mmHg')}, globe {globe}"),
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
    lines, draw = tuple(_frame_lines(trials)), partial(draw_recording, recording, trials, CLASSES.bounds_n)
    return Thing(kind="recording", facts=facts, rows=rows, lines=lines, draw=draw)


def _labelled(recording: Recording) -> tuple[tuple[Trial, ...], str | None]:
    try:
        return label_frames(recording, CLASSES), None
    except RecordingError as fault:
        return label_frames(replace(recording, forces=None), CLASSES), str(fault)


def _log_words(recording: Recording) -> str:
    log = recording.forces
    if log is None:
        return "none: its frames can be read, but neither scored nor calibrated on"
    return f"{len(log.time_s)} samples at {log.sample_rate_hz:.4g} Hz, {log.time_s[-1] - log.time_s[0]:.4g} s"


def _frame_lines(trials: tuple[Trial, ...]) -> list[str]:
    lines = [f"{'frame':<20}{'time/s':>10}{'force/mN':>10}{'class':>7}  remark"]
    for trial in trials[:LISTED]:
        known = trial.measured_force_n is not None
        force = f"{from_si(trial.measured_force_n or 0.0, 'mn'):.1f}" if known else "-"
        target = "-" if trial.target is None else str(trial.target)
        name = trial.file if len(trial.file) < 20 else f"{trial.file[:18]}…"
        lines.append(f"{name:<20}{trial.time_s:>10.3f}{force:>10}{target:>7}  {trial.excluded or ''}".rstrip())
    left = len(trials) - LISTED
    return [*lines, f"... and {left} more"] if left > 0 else lines


def _value(value: float | None, unit: HumanUnit, printed: str) -> str:
    return "not stated" if value is None else f"{from_si(value, unit):.4g} {printed}"


def show_calibration(path: Path) -> Thing:
    """Describe a calibration file; raises `CalibrationError`."""
    calibration = parse_calibration(open_calibration(path))
    mean_pa, sd_pa = calibration.population
    used = sum(len(eye.used) for eye in calibration.eyes.values())
    rows = (
        ("eyes", f"{len(calibration.eyes)}, on {used} frames"),
        ("mechanics", calibration.mechanics),
        ("study, SHA-256", calibration.study_sha256),
    )
    facts = {
        "mechanics": calibration.mechanics,
        "study_sha256": calibration.study_sha256,
        "population": {"mean_mpa": from_si(mean_pa, "mpa"), "sd_mpa": from_si(sd_pa, "mpa")},
        "eyes": {
            name: {"mean_mpa": from_si(eye.mean_pa, "mpa"), "sd_mpa": from_si(eye.sd_pa, "mpa"),
                   "frames": len(eye.used), "status": eye.status}
            for name, eye in calibration.eyes.items()
        },
    }  # fmt: skip
    lines = tuple(calibration_lines(calibration))
    return Thing(kind="calibration", facts=facts, rows=rows, lines=lines, draw=partial(draw_calibration, calibration))


def show_decision_log(path: Path) -> Thing:
    """Describe a log: a file, the folder of its files, or the folder of a black box; raises `InputError`."""
    decisions, notes, torn = _read_decisions(path / "log" if (path / "log").is_dir() else path)
    withdrawals = [entry for entry in _changes(decisions) if entry.state == "WITHDRAW"]
    forces_mn = [entry.force_mn for entry in decisions if entry.force_mn is not None]
    causes = Counter(entry.cause or "?" for entry in withdrawals)
    frames = sum(entry.event == "frame" for entry in decisions)
    rows = (
        ("decisions", f"{len(decisions)}, {frames} of them on a frame"),
        ("span", _span(decisions)),
        ("forces", f"{min(forces_mn):.1f} to {max(forces_mn):.1f} mN" if forces_mn else ""),
        ("lost frames", str(decisions[-1].lost) if decisions else ""),
        ("withdrawals", ", ".join(f"{count} {cause}" for cause, count in causes.items()) or "none"),
        ("notes", str(len(notes))),
        ("torn", f"{torn} parts could not be read" if torn else "nothing"),
    )
    facts = {
        "decisions": len(decisions),
        "frames": frames,
        "withdrawals": [
            {"number": entry.number, "time_s": entry.time_s, "cause": entry.cause, "message": entry.message}
            for entry in withdrawals
        ],
        "notes": notes,
        "torn": torn,
    }
    filled, lines = tuple((name, words) for name, words in rows if words), tuple(_listed(withdrawals))
    return Thing(kind="decision log", facts=facts, rows=filled, lines=lines, draw=partial(draw_decisions, decisions))


def _read_decisions(folder: Path) -> tuple[tuple[Entry, ...], tuple[str, ...], int]:
    for file in folder.glob(LOG_FILES):
        if not file.is_file():
            raise InputError(f"{file}: not a regular file; a log has no other files")
    decisions, notes, torn = list[Entry](), list[str](), 0
    for part in read_log(folder):
        if part.record is None:
            torn += 1
        elif part.record.get("kind") == "entry":
            try:
                decisions.append(Entry.from_json(part.record.get("entry")))
            except MessageError as fault:
                raise InputError(f"{part.file}: byte {part.offset}: entry: {fault}") from fault
        else:
            notes.append(str(part.record.get("text", "")))
    if not decisions and not notes:
        raise InputError(f"{folder}: no whole record of a decision log in it")
    return tuple(decisions), tuple(notes), torn


def _changes(decisions: Sequence[Entry]) -> list[Entry]:
    return [after for n, after in enumerate(decisions) if not n or decisions[n - 1].state != after.state]


@styled
def draw_decisions(decisions: Sequence[Entry]) -> Figure:
    """Draw the read force with its interval over time; the ground says the state, a line each withdrawal."""
    figure = Figure(figsize=inches(170, 70))
    axes = figure.subplots()
    start_s = decisions[0].at_s if decisions else 0.0
    read = [entry for entry in decisions if entry.force_mn is not None and entry.interval_mn is not None]
    at_s = np.array([entry.at_s - start_s for entry in read])
    ends_mn = np.array([entry.interval_mn for entry in read], dtype=float).reshape(-1, 2)
    axes.fill_between(at_s, *ends_mn.T, color=AMBER, alpha=0.35, linewidth=0, label="90 % interval")
    axes.plot(
        at_s, np.array([entry.force_mn for entry in read], dtype=float), color=BLACK, linewidth=0.8, label="force"
    )
    changes = _changes(decisions)
    for begin, end in zip(changes, [*changes[1:], *decisions[-1:]], strict=False):
        axes.axvspan(begin.at_s - start_s, end.at_s - start_s, color=SHADES[begin.state], alpha=0.12, linewidth=0)
    for state, shade in SHADES.items():
        axes.fill_between([], [], color=shade, alpha=0.12, label=state)
    axes.set(xlabel="time [s]", ylabel="force [mN]")
    axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside upper left", ncols=5)
    return figure


def _span(decisions: Sequence[Entry]) -> str:
    if not decisions:
        return ""
    begin = datetime.fromtimestamp(decisions[0].time_s, UTC)
    return f"{decisions[-1].at_s - decisions[0].at_s:.4g} s from {begin:%Y-%m-%d %H:%M:%S} UTC"


def _listed(withdrawals: Sequence[Entry]) -> Iterator[str]:
    for entry in withdrawals[:LISTED]:
        when = datetime.fromtimestamp(entry.time_s, UTC)
        yield f"{when:%H:%M:%S} UTC, decision {entry.number}: {sentence_of(entry.cause or '')}"
    if len(withdrawals) > LISTED:
        yield f"... and {len(withdrawals) - LISTED} more"
