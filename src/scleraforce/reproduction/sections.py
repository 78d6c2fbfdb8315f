"""Sections of the page of `reproduce`: Young's modulus (the paper's Table 2, Figs. 4 and 5), and walls that bend."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import isnan
from pathlib import Path
from statistics import mean, median

import numpy as np

from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.result import Calibration, EyeCalibration, found_words, parse_calibration
from scleraforce.known.calibration_file import CalibrationSummary, open_calibration, read_calibration
from scleraforce.laboratory.virtual_eye import PhantomEye, linear_sections
from scleraforce.library import Library
from scleraforce.library.sections import cut_surfaces
from scleraforce.mechanics.contact import Section
from scleraforce.models import SHIPPED_WALL_FINDER, model_name
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.reader.metrics import (
    SHARED_ERROR,
    ForceTrial,
    Proportion,
    band_of,
    coverage,
    coverage_by_eye,
    held_by_eye,
    mean_absolute_error,
)
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.report.calibration_figures import draw_modulus_over_frames, draw_observed_points
from scleraforce.report.evaluation_page import read_forces_figure
from scleraforce.report.files import data_uri
from scleraforce.report.frames import AnsweredFrame, look_at
from scleraforce.report.html import (
    NOTHING,
    Html,
    confusion_table,
    figure,
    frame_table,
    paragraph,
    section,
    share,
    table,
)
from scleraforce.report.paper import EYES, MEAN_MODULUS_PA
from scleraforce.report.slice_figures import ComputedWall, FrameWithWalls, laid_on_surface, plot_walls
from scleraforce.reproduction.readings import CALIBRATED_EYES, CALIBRATION_FORCES_N, LeftOut, bent_trials, run_library
from scleraforce.reproduction.run import Run
from scleraforce.study import Study, study_hash
from scleraforce.units import from_si


def calibration_section(run: Run, evaluation: Evaluation, drawn: Callable[[Html], Html]) -> Html:
    """Return Table 2, the estimate over the frames of the first eye, and its points before and after.

    Args:
        run: its calibration is of the first eyes of the paper's design.
        evaluation: the answers to all eyes.
        drawn: called with each figure.
    """
    calibration = parse_calibration(open_calibration(run.calibration))
    first = _with_points(run, next(iter(calibration.eyes)))
    mean_pa, spread_pa = calibration.population
    spread = "not known from one eye" if spread_pa is None else f"{_mpa(spread_pa)} MPa"
    words = (
        "A reduced-order unscented Kalman filter with two sigma points starts from the paper's prior, 0.49 ± 0.34 MPa. "
        f"Mean of the means: {_mpa(mean_pa)} MPa, spread {spread} (the paper: "
        f"{from_si(MEAN_MODULUS_PA, 'mpa'):.2f} MPa). The network is trained with it, whatever eye it reads."
    )
    return section(
        "Young's modulus",
        paragraph(words),
        _table_2(calibration),
        drawn(_over_frames(first)),
        drawn(_points(first, evaluation)),
    )


def left_out_section(results: Sequence[LeftOut], evaluation: Evaluation) -> Html:
    """Return the accuracy of each eye with the mean of all moduli, and with the mean of the others'."""
    rows: list[list[object]] = [
        [one.eye, _mpa(one.youngs_modulus_pa), share(_of_eye(evaluation, one.eye)), share(one.accuracy)]
        for one in results
    ]
    together = Proportion(sum(one.accuracy.hits for one in results), sum(one.accuracy.total for one in results))
    among = Proportion(
        *(sum(counts) for counts in zip(*(_counts(evaluation, one.eye) for one in results), strict=True))
    )
    rows.append(["together", NOTHING, share(among), share(together)])
    words = (
        "The mean modulus has seen the eyes that are read with it, here as in the paper. So each eye is read once more "
        "with the mean of the others: the slices are labelled anew for that modulus, and a network is trained on them."
    )
    head = ["", "mean of the others in MPa", "read with the mean of all", "read with the mean of the others"]
    caption = "Accuracy of each calibrated eye, with its 95 % Wilson interval."
    return section("Each eye left out of the mean", paragraph(words), table(head, rows, caption))


def _table_2(calibration: Calibration) -> Html:
    paper = [eye for _, eye in zip(calibration.eyes, EYES, strict=False)]
    rows: list[list[object]] = [
        ["mean in MPa", *(_mpa(eye.mean_pa) for eye in calibration.eyes.values())],
        ["standard deviation in kPa", *(f"{from_si(eye.sd_pa, 'kpa'):.1f}" for eye in calibration.eyes.values())],
        *_found_rows(list(calibration.eyes.values())),
        ["frames used", *(len(eye.used) for eye in calibration.eyes.values())],
        ["true modulus = the paper's mean, in MPa", *(f"{from_si(eye.modulus_pa or 0.0, 'mpa'):.2f}" for eye in paper)],
        [
            "the paper's standard deviation in kPa",
            *(f"{from_si(eye.modulus_sd_pa or 0.0, 'kpa'):.1f}" for eye in paper),
        ],
    ]
    caption = (
        "Posterior of Young's modulus (the paper's Table 2). The virtual eyes were made with the paper's means, so the "
        "last rows are both the paper's figures and the truth to be found."
    )
    return table(["", *calibration.eyes], rows, caption)


def _found_rows(eyes: Sequence[EyeCalibration]) -> list[list[object]]:
    """Return a row with what was found beside the modulus, such as k of a sealed eye; none where nothing was."""
    found = ["; ".join(found_words(eye)) or NOTHING for eye in eyes]
    return [["found with it", *found]] if set(found) != {NOTHING} else []


def _mpa(modulus_pa: float) -> str:
    return f"{from_si(modulus_pa, 'mpa'):.3f}"


def _over_frames(eye: EyeCalibration) -> Html:
    truth_pa = EYES[0].modulus_pa
    caption = f"Young's modulus of {eye.id} over its frames, from the prior on (the paper's Fig. 5)."
    drawn = draw_modulus_over_frames(eye, truth_pa)
    return figure(data_uri(drawn, "svg"), "mean and band of the modulus over the frames", caption)


def _with_points(run: Run, eye: str) -> EyeCalibration:
    """Calibrate an eye once more, for the file of a calibration keeps no points to draw."""
    recording = read_recording(run.recordings / eye)
    finder = load_wall_finder(SHIPPED_WALL_FINDER)
    again = calibrate_recordings([recording], run.study, study_hash(run.study), library=None, finder=finder)
    return again.eyes[eye]


def _points(eye: EyeCalibration, evaluation: Evaluation) -> Html:
    index = max(range(len(eye.used)), key=lambda number: eye.used[number].force_n)
    file = eye.used[index].file
    look = look_at(next(frame for frame in evaluation.frames if (frame.eye, frame.file) == (eye.id, file)))
    drawn = draw_observed_points(eye, look.frame, index, *look.extent_m)
    caption = (
        f"Observed points (yellow) and predicted ones (red) in {eye.id}/{file}, at the prior's modulus and at the "
        "final one (the paper's Fig. 4)."
    )
    return figure(data_uri(drawn), "observed and predicted points before and after", caption)


def _counts(evaluation: Evaluation, eye: str) -> tuple[int, int]:
    trials = [frame for frame in evaluation.scored if frame.eye == eye]
    return sum(frame.answer.predicted == frame.target for frame in trials), len(trials)


def _of_eye(evaluation: Evaluation, eye: str) -> Proportion:
    return Proportion(*_counts(evaluation, eye))


SHOWN_FORCES_N = (12e-3, 28e-3, 50e-3)  # of the frames with computed walls: as near as the first eye's trials come


def bent_section(run: Run, paper: Evaluation, reader: Evaluation, drawn: Callable[[Html], Html]) -> Html:
    """Return the comparison of both methods: tables, force against force, and the walls that they take for the eye.

    Args:
        run: its bent eyes are made and calibrated.
        paper: the answers of the paper's method.
        reader: those of the force reader to the same frames.
        drawn: called with each figure.
    """
    forces = ", ".join(f"{from_si(force, 'mn'):g}" for force in CALIBRATION_FORCES_N)
    words = (
        "Walls that are thin beside their dent soften and then stiffen, which linear mechanics does not know. Here the "
        "eyes of the same design are computed in three dimensions at finite strain and imaged anew. The paper's method "
        f"reads them with a network for the mean linear modulus of {CALIBRATED_EYES} of them, calibrated on all their "
        "frames. The force reader has learned from the response library, and each eye is read with its own modulus, "
        f"found on three pushes of {forces} mN before the trials, which do not count. {reader_words(run)}"
    )
    return section(
        "Walls that bend: the paper's method and the force reader",
        paragraph(words),
        _comparison(paper, reader),
        *_coverage_words(reader),
        _moduli(run),
        drawn(read_forces_figure(reader)),
        confusion_table(paper.confusion, paper.bounds_n, "The paper's method on walls of finite strain."),
        confusion_table(reader.confusion, reader.bounds_n, "The force reader on the same trials."),
        *_misread(paper, "the paper's method"),
        *_misread(reader, "the force reader"),
        drawn(_walls_figure(run, reader)),
    )


def reader_words(run: Run) -> str:
    """Return a sentence that names the force reader of a run."""
    if run.train:
        return "The reader was trained in this run."
    made_by = load_model(run.reader).provenance["scleraforce"]
    return (
        f"It is the bundled reader, {model_name(run.reader)!r}, with its library (made by scleraforce {made_by}); "
        "this run trained the paper's classifiers alone. `reproduce --train` trains a reader, too."
    )


def _comparison(paper: Evaluation, reader: Evaluation) -> Html:
    both, true = (paper, reader), reader.true_forces
    rows: list[list[object]] = [
        ["trials read right", *(share(one.accuracy) for one in both)],
        ["the same, of the usable ones", *(share(one.usable.accuracy) for one in both)],
        ["dangerous forces seen (recall of class 2)", *(share(one.recall[-1]) for one in both)],
        ["dangerous forces read as harmless (2 as 0)", *(int(one.confusion[-1, 0]) for one in both)],
        ["trials not usable, which count as class 2", *(len(one.scored) - len(one.usable.scored) for one in both)],
        ["mean error of the force in mN", *(_number(from_si(one.mae_n, "mn")) for one in both)],
        ["the same against the true force", NOTHING, _number(from_si(mean_absolute_error(true), "mn"))],
        ["labels that agree with their 90 % interval", *(_held(one.forces) for one in both)],
        ["true forces within their 90 % interval", NOTHING, _held(true)],
    ]
    caption = (
        f"The same {len(reader.scored)} trials, read in two ways; in brackets the 95 % Wilson interval, of intervals "
        "that hold that of other such eyes (bootstrap over eyes). Forces are those of the force log, whose labels are "
        "noisy and drift over the minutes of a recording: where they are held against intervals, that error counts. "
        "Of virtual eyes the true forces are known, too."
    )
    return table(["", "the paper's method", "the force reader"], rows, caption)


def _held(trials: Sequence[ForceTrial]) -> str:
    """Return the share of forces that lie in their intervals, and between what that of other such eyes lies."""
    band = band_of(trials)
    return NOTHING if band is None else f"{coverage(trials).value:.2f} ({band[0]:.2f} to {band[1]:.2f})"


def _coverage_words(reader: Evaluation) -> tuple[Html, ...]:
    """Say what the two shares of forces within their intervals are of, and what comes between them."""
    logged, true = reader.forces, reader.true_forces
    if not logged:
        return ()
    off_mn = [from_si(abs(log.measured_n - fact.measured_n), "mn") for log, fact in zip(logged, true, strict=True)]
    reach_mn = median(from_si(high - low, "mn") / 2 for low, high in (trial.interval_n for trial in true))
    words = (
        "The reader's 90 % interval is one of the true force under the needle; it allows for no error of the force "
        f"log. The log is off from the true force by {mean(off_mn):.2f} mN in the mean and by {max(off_mn):.2f} mN at "
        "most, because its zero is taken once, before the first contact, and drifts from then on; the intervals reach "
        f"{reach_mn:.2f} mN to either side in the median. They agree with {coverage(logged).value:.2f} of the labels, "
        f"whose own error counts ({from_si(reader.label_sd_n, 'mn'):.2f} mN, median standard deviation), and hold "
        f"{coverage(true).value:.2f} of the true forces: {held_by_eye(true)}. {SHARED_ERROR} {_worst_eye(reader)}"
        "The paper's method reads no force, so it has no intervals."
    )
    return (paragraph(words),)


def _worst_eye(reader: Evaluation) -> str:
    """Say how far the eye whose true forces are held least was read off, and its calibration's labels; '' if all hold.

    What the frames of an eye share is the mean of their relative errors.
    """
    shares = coverage_by_eye(reader.true_forces)
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


def _moduli(run: Run) -> Html:
    """Return what each mechanics takes for the modulus of each eye, beside the true one."""
    linear, finite = read_calibration(run.bent.linear), read_calibration(run.bent.finite_strain)
    eyes = [eye for eye, _ in bent_trials(run.study)]
    rows: list[list[object]] = [
        ["true", *(f"{from_si(eye.youngs_modulus_pa, 'mpa'):.3f}" for eye in eyes)],
        ["linear, all frames", *(_modulus(linear, eye.id) for eye in eyes)],
        ["finite strain, three frames", *(_modulus(finite, eye.id) for eye in eyes)],
        ["its error, in standard deviations", *(_off(finite, eye) for eye in eyes)],
    ]
    caption = (
        "Young's modulus in MPa: mean and standard deviation of the posterior. An error of 1.6 standard deviations or "
        "more is one of ten; all readings of its eye share it."
    )
    return table(["", *(eye.id for eye in eyes)], rows, caption)


def _modulus(summary: CalibrationSummary, eye: str) -> str:
    if eye not in summary.eyes:
        return NOTHING
    found = summary.eyes[eye]
    return f"{from_si(found.mean_pa, 'mpa'):.3f} ± {from_si(found.sd_pa, 'mpa'):.3f}"


def _off(summary: CalibrationSummary, eye: PhantomEye) -> str:
    if eye.id not in summary.eyes:
        return NOTHING
    found = summary.eyes[eye.id]
    return f"{(found.mean_pa - eye.youngs_modulus_pa) / found.sd_pa:+.1f}"


def _misread(evaluation: Evaluation, name: str) -> tuple[Html, ...]:
    misread = [frame for frame in evaluation.scored if frame.answer.predicted != frame.target]
    if not misread:
        return (paragraph(f"No trial was misread by {name}."),)
    return (frame_table(evaluation, misread, f"Trials misread by {name}."),)


def _walls_figure(run: Run, reader: Evaluation) -> Html:
    """Return frames of the first eye with the walls that finite strain and linear mechanics compute for them."""
    looks = [look_at(answer) for answer in _shown(reader)]
    forces_n = [max(look.answer.measured_force_n or 0.0, 0.0) for look in looks]
    linear, finite = (_stated_eye(run, path, looks[0]) for path in (run.bent.linear, run.bent.finite_strain))
    computed = {
        "finite strain": _finite_sections(run_library(run), finite, forces_n),
        "linear": linear_sections(linear, run.study)(forces_n),
    }
    frames = [
        _with_walls(look, {name: sections[number] for name, sections in computed.items()})
        for number, look in enumerate(looks)
    ]
    caption = (
        f"Frames of {linear.id} and the sections computed for their measured forces, each mechanics with the "
        "modulus that it found for this eye. Only their place in the frame is fitted."
    )
    return figure(data_uri(plot_walls(frames)), "raw frames with the linear and the finite-strain section", caption)


def _shown(reader: Evaluation) -> list[FrameAnswer]:
    first = [frame for frame in reader.scored if frame.eye == reader.scored[0].eye]
    nearest = [min(first, key=lambda frame: abs((frame.measured_force_n or 0.0) - force)) for force in SHOWN_FORCES_N]
    return list(dict.fromkeys(nearest))


def _stated_eye(run: Run, calibration: Path, look: AnsweredFrame) -> PhantomEye:
    """Return the eye of a frame as its recording states it, with the modulus of a calibration."""
    modulus_pa = read_calibration(calibration).eyes[look.answer.eye].mean_pa
    eye = replace(run.study.eye, youngs_modulus_pa=modulus_pa)
    return eye_of(look.recording, replace(run.study, eye=eye))


def _with_walls(look: AnsweredFrame, computed: Mapping[str, Section]) -> FrameWithWalls:
    width_m, depth_m = look.extent_m
    surface_m = (look.found.outer_row + 0.5) * depth_m / len(look.frame)
    walls = tuple(ComputedWall(name, laid_on_surface(cut, surface_m, width_m)) for name, cut in computed.items())
    force_mn = from_si(max(look.answer.measured_force_n or 0.0, 0.0), "mn")
    return FrameWithWalls(f"{look.answer.file}, {force_mn:.0f} mN", look.frame, look.extent_m, walls)


def _finite_sections(library: Library, eye: PhantomEye, forces_n: Sequence[float]) -> list[Section]:
    """Return the library's sections of an eye; where a force goes beyond the library, its last state."""
    E = eye.youngs_modulus_pa
    library = library.for_contact(eye.polar_rad)
    thickness_m, iop_ratio = np.full(len(forces_n), eye.thickness_m), np.full(len(forces_n), eye.iop_pa / E)
    ratios = np.minimum(np.array(forces_n) / E, library.largest_force_ratio(thickness_m, iop_ratio))
    walls = library.curves(thickness_m, iop_ratio, ratios).curves_sbnc.astype(np.float64)
    return [cut_surfaces(wall, eye.gap_m, eye.tilt_rad) for wall in walls]


def _number(value: float) -> str:
    return NOTHING if isnan(value) else f"{value:.2f}"


def eye_of(recording: Recording, study: Study) -> PhantomEye:
    """Return the eye as the recording states it, with the study's Young's modulus."""
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
