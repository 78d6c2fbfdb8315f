"""The section of the page of `reproduce` on walls that bend: the paper's method beside the force reader."""

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.resources import files
from math import isnan
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np

from scleraforce.known.calibration_file import read_calibration
from scleraforce.laboratory.virtual_eye import PhantomEye, linear_sections
from scleraforce.library import Library
from scleraforce.library.sections import cut_surfaces
from scleraforce.mechanics.contact import Section
from scleraforce.models import model_name
from scleraforce.reader import load_model, metrics
from scleraforce.reader.evaluate import Evaluation
from scleraforce.recording.folder import Recording
from scleraforce.report import html
from scleraforce.report.evaluation_page import read_forces_figure
from scleraforce.report.frame_figures import draw_computed_walls
from scleraforce.report.frames import AnsweredFrame, look_at_all
from scleraforce.reproduction.readings import CALIBRATED_EYES, CALIBRATION_FORCES_N, bent_trials, run_library
from scleraforce.reproduction.run import Run
from scleraforce.study import Study
from scleraforce.units import from_si

TEXTS = tomllib.loads(files("scleraforce.reproduction").joinpath("words.toml").read_text(encoding="utf-8"))
SHOWN_FORCES_N = (12e-3, 28e-3, 50e-3)  # of the frames with computed walls: as near as the first eye's trials come


def said(key: str, /, **fields: Any) -> str:
    """Return a text of `words.toml` with its fields filled in."""
    return str(TEXTS[key]).format(**fields)


def bent_section(run: Run, paper: Evaluation, reader: Evaluation, drawn: Callable[[html.Html], html.Html]) -> html.Html:
    """Return the comparison of the paper's method and the force reader on the same frames; `drawn` counts figures."""
    forces = ", ".join(f"{from_si(force, 'mn'):g}" for force in CALIBRATION_FORCES_N)
    words = said("bent", calibrated=CALIBRATED_EYES, forces=forces, reader=reader_words(run))
    return html.section(
        "Walls that bend: the paper's method and the force reader",
        html.paragraph(words),
        _comparison(paper, reader),
        *_coverage_words(reader),
        _moduli(run),
        drawn(read_forces_figure(reader)),
        html.confusion_table(paper.confusion, paper.bounds_n, "The paper's method on walls of finite strain."),
        html.confusion_table(reader.confusion, reader.bounds_n, "The force reader on the same trials."),
        *_misread(paper, "the paper's method"),
        *_misread(reader, "the force reader"),
        drawn(_walls_figure(run, reader)),
    )


def reader_words(run: Run) -> str:
    """Return a sentence that names the force reader of a run."""
    if run.train:
        return "The reader was trained in this run."
    made_by = load_model(run.reader).provenance["scleraforce"]
    return said("bundled", name=model_name(run.reader), made_by=made_by)


def _comparison(paper: Evaluation, reader: Evaluation) -> html.Html:
    both, true = (paper, reader), reader.true_forces
    rows: list[list[object]] = [
        ["trials read right", *(one.accuracy.words(html.NOTHING) for one in both)],
        ["the same, of the usable ones", *(one.usable.accuracy.words(html.NOTHING) for one in both)],
        ["dangerous forces seen (recall of class 2)", *(one.recall[-1].words(html.NOTHING) for one in both)],
        ["dangerous forces read as harmless (2 as 0)", *(int(one.confusion[-1, 0]) for one in both)],
        ["trials not usable, which count as class 2", *(len(one.scored) - len(one.usable.scored) for one in both)],
        ["mean error of the force in mN", *(_number(from_si(one.mae_n, "mn")) for one in both)],
        ["the same against the true force", html.NOTHING, _number(from_si(metrics.mean_absolute_error(true), "mn"))],
        ["labels that agree with their 90 % interval", *(_held(one.forces) for one in both)],
        ["true forces within their 90 % interval", html.NOTHING, _held(true)],
    ]
    caption = said("comparison", trials=len(reader.scored))
    return html.table(["", "the paper's method", "the force reader"], rows, caption)


def _held(trials: Sequence[metrics.ForceTrial]) -> str:
    band = metrics.band_of(trials)
    return html.NOTHING if band is None else f"{metrics.coverage(trials).value:.2f} ({band[0]:.2f} to {band[1]:.2f})"


def _coverage_words(reader: Evaluation) -> tuple[html.Html, ...]:
    logged, true = reader.forces, reader.true_forces
    if not logged:
        return ()
    off_mn = [from_si(abs(log.measured_n - fact.measured_n), "mn") for log, fact in zip(logged, true, strict=True)]
    reach_mn = median(from_si(high - low, "mn") / 2 for low, high in (trial.interval_n for trial in true))
    words = said(
        "coverage",
        off_mn=mean(off_mn),
        most_mn=max(off_mn),
        reach_mn=reach_mn,
        agree=metrics.coverage(logged).value,
        label_mn=from_si(reader.label_sd_n, "mn"),
        hold=metrics.coverage(true).value,
        by_eye=metrics.held_by_eye(true),
        shared=metrics.SHARED_ERROR,
        worst=_worst_eye(reader),
    )
    return (html.paragraph(words),)


def _worst_eye(reader: Evaluation) -> str:
    shares = metrics.coverage_by_eye(reader.true_forces)
    worst = min(shares, key=lambda eye: shares[eye].value)
    if shares[worst].hits == shares[worst].total:
        return ""
    off = mean(trial.read_n / trial.measured_n - 1.0 for trial in reader.true_forces if trial.eye == worst)
    frames = [frame for frame in reader.frames if frame.eye == worst and frame.calibration]
    labels_mn = [
        from_si(frame.measured_force_n - frame.true_force_n, "mn")
        for frame in frames
        if frame.measured_force_n is not None and frame.true_force_n is not None
    ]
    labels = f", after labels of {mean(labels_mn):+.2f} mN in the mean of its calibration" if labels_mn else ""
    return f"{worst} is read {from_si(off, 'percent'):+.1f} % off in the mean{labels}. "


def _moduli(run: Run) -> html.Html:
    linear, finite = (read_calibration(path).eyes for path in (run.bent_linear, run.bent_finite_strain))
    eyes = {eye.id: eye.youngs_modulus_pa for eye, _ in bent_trials(run.study)}
    off = {
        name: (finite[name].mean_pa - true_pa) / finite[name].sd_pa for name, true_pa in eyes.items() if name in finite
    }
    posteriors = [
        {name: f"{from_si(eye.mean_pa, 'mpa'):.3f} ± {from_si(eye.sd_pa, 'mpa'):.3f}" for name, eye in found.items()}
        for found in (linear, finite)
    ]
    rows: list[list[object]] = [
        ["true", *(f"{from_si(true_pa, 'mpa'):.3f}" for true_pa in eyes.values())],
        ["linear, all frames", *(posteriors[0].get(name, html.NOTHING) for name in eyes)],
        ["finite strain, three frames", *(posteriors[1].get(name, html.NOTHING) for name in eyes)],
        ["its error, in standard deviations", *(f"{off[name]:+.1f}" if name in off else html.NOTHING for name in eyes)],
    ]
    return html.table(["", *eyes], rows, said("bent_moduli"))


def _misread(evaluation: Evaluation, name: str) -> tuple[html.Html, ...]:
    misread = [frame for frame in evaluation.scored if frame.misread]
    if not misread:
        return (html.paragraph(f"No trial was misread by {name}."),)
    return (html.frame_table(evaluation, misread, f"Trials misread by {name}."),)


def _walls_figure(run: Run, reader: Evaluation) -> html.Html:
    first = [frame for frame in reader.scored if frame.eye == reader.scored[0].eye]
    nearest = [min(first, key=lambda frame: abs((frame.measured_force_n or 0.0) - force)) for force in SHOWN_FORCES_N]
    looks = look_at_all(list(dict.fromkeys(nearest)))
    forces_n = [max(look.answer.measured_force_n or 0.0, 0.0) for look in looks]
    linear, finite = (_stated_eye(run, path, looks[0]) for path in (run.bent_linear, run.bent_finite_strain))
    computed = {
        "finite strain": _finite_sections(run_library(run), finite, forces_n),
        "linear": linear_sections(linear, run.study)(forces_n),
    }
    drawn = draw_computed_walls(looks, computed)
    caption = said("walls", eye=linear.id)
    return html.figure(drawn, "raw frames with the linear and the finite-strain section", caption, "png")


def _stated_eye(run: Run, calibration: Path, look: AnsweredFrame) -> PhantomEye:
    modulus_pa = read_calibration(calibration).eyes[look.answer.eye].mean_pa
    eye = replace(run.study.eye, youngs_modulus_pa=modulus_pa)
    return eye_of(look.recording, replace(run.study, eye=eye))


def _finite_sections(library: Library, eye: PhantomEye, forces_n: Sequence[float]) -> list[Section]:
    """Return the library's sections of an eye; beyond its largest force, its last state."""
    E = eye.youngs_modulus_pa
    library = library.for_contact(eye.polar_rad)
    thickness_m, iop_ratio = np.full(len(forces_n), eye.thickness_m), np.full(len(forces_n), eye.iop_pa / E)
    ratios = np.minimum(np.array(forces_n) / E, library.largest_force_ratio(thickness_m, iop_ratio))
    walls = library.curves(thickness_m, iop_ratio, ratios).curves_sbnc.astype(np.float64)
    return [cut_surfaces(wall, eye.gap_m, eye.tilt_rad) for wall in walls]


def _number(value: float) -> str:
    return html.NOTHING if isnan(value) else f"{value:.2f}"


def eye_of(recording: Recording, study: Study) -> PhantomEye:
    """Return the eye that a recording states, with the study's Young's modulus."""
    info = recording.info
    low, high = study.needle.polar_angle_rad.bounds
    return PhantomEye(
        id=info.eye.id,
        thickness_m=info.eye.thickness_m or study.dataset.group[0].thickness_m,
        youngs_modulus_pa=study.eye.youngs_modulus_pa,
        iop_pa=study.eye.iop_pa if info.eye.iop_pa is None else info.eye.iop_pa,
        gap_m=info.needle.slice_gap_m,
        polar_rad=0.5 * (low + high) if info.needle.polar_angle_rad is None else info.needle.polar_angle_rad,
        direction_rad=info.oct.plane_direction_rad or 0.0,
        tilt_rad=info.oct.plane_tilt_rad,
    )
