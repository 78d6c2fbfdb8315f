"""The page of `reproduce`: every table and figure of the paper, from the run in its folder."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scleraforce.laboratory.simulation import simulate_eye
from scleraforce.laboratory.virtual_eye import linear_sections
from scleraforce.learning.dataset import open_dataset
from scleraforce.mechanics.contact import Contact, Section
from scleraforce.mechanics.slices import fill_section, slice_window
from scleraforce.reader import Classifier, load_classifier
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.recording.folder import read_recording
from scleraforce.recording.labels import contact_force, label_frames
from scleraforce.report.evaluation_page import NAMES_REMARK, evaluation_cards, forces_figure
from scleraforce.report.eye_view import eye_view, view_script, view_style
from scleraforce.report.files import data_uri, write_figure, write_page
from scleraforce.report.force_figures import draw_force_log, draw_overview, draw_training_curves
from scleraforce.report.frames import look_at
from scleraforce.report.html import (
    NOTHING,
    Html,
    class_names,
    confusion_table,
    figure,
    frame_table,
    made_line,
    notice,
    page,
    paragraph,
    provenance_table,
    section,
    table,
)
from scleraforce.report.model_figures import draw_model, draw_network, draw_simulation
from scleraforce.report.paper import CONFUSION, DEVIATIONS, EYES, PAPER_TITLE, SECONDS_A_SLICE
from scleraforce.report.slice_figures import SlicePair, dice, draw_montage, draw_segmentation, draw_slice_pairs
from scleraforce.reproduction.readings import read_left_out_file
from scleraforce.reproduction.run import Progress, Run
from scleraforce.reproduction.sections import bent_section, calibration_section, eye_of, left_out_section
from scleraforce.study import Study
from scleraforce.units import from_si

MONTAGE_SLICES = 36
LOG_TRIALS = 5  # the paper's Fig. 3 shows five acquisitions


def model_figure(study: Study) -> Html:
    """Return the sketch of the model (Fig. 1a)."""
    caption = (
        "The model of the sclera and what acts on it (the paper's Fig. 1a), in the needle's meridian. The wall is "
        "drawn twice as thick as it is."
    )
    return figure(data_uri(draw_model(study), "svg"), "a half-sphere with its loads and its clamped base", caption)


def network_figure(reader: Classifier) -> Html:
    """Return the sketch of the network (Fig. 2)."""
    study = reader.study
    window, names = (study.slice.columns, study.slice.rows), class_names(study.classes.bounds_n)
    drawn = draw_network(window, study.network.hidden, names, study.network.dropout)
    return figure(data_uri(drawn, "svg"), "the layers of the network", "The network of this run (the paper's Fig. 2).")


def mesh_figure(study: Study) -> Html:
    """Return the deformed mesh under a dangerous force (Fig. 1b), and the same wall to be turned.

    A page that holds it needs the style and the script of `report.eye_view`.
    """
    contact = Contact(polar_rad=sum(study.needle.polar_angle_rad.bounds) / 2)
    eye = simulate_eye(study, 500e-6, study.classes.bounds_n[1], contact)
    caption = (
        f"The deformed mesh (the paper's Fig. 1b), cut open at the needle (orange), under "
        f"{from_si(eye.force_n, 'mn'):g} mN, the bound of the dangerous class: "
        f"{len(eye.mesh.cells_en)} curved hexahedra. Beside it the slice."
    )
    return Html(figure(data_uri(draw_simulation(eye)), "the deformed mesh and its slice", caption) + eye_view(eye))


def force_log_figure(path: Path, study: Study) -> Html:
    """Return the first acquisitions of a recording's force log with their imaging times (Fig. 3)."""
    recording = read_recording(path)
    log, info = recording.forces, recording.info.force
    assert log is not None, "a virtual acquisition has a log"
    assert info is not None
    trials = label_frames(recording, study.classes)[:LOG_TRIALS]
    shown = log.time_s < trials[-1].time_s + 4.0
    filtered_n = contact_force(log, info)
    raw_n = info.contact_sign * log.force_n(info.axis)
    raw_n = raw_n - raw_n.mean() + filtered_n.mean()
    drawn = draw_force_log(
        log.time_s[shown],
        raw_n[shown],
        filtered_n[shown],
        [trial.time_s for trial in trials],
        [trial.measured_force_n for trial in trials],
        study.classes.bounds_n,
    )
    caption = (
        f"Force log of {recording.info.eye.id}, the first {len(trials)} acquisitions (the paper's Fig. 3). Grey: as "
        "logged, in the sensor's steps, tared; blue: filtered; lines: imaging times; diamonds: the labels. The tissue "
        "relaxes under each push."
    )
    return figure(data_uri(drawn, "svg"), "contact force over time with the imaging times", caption)


def overview_figure(evaluation: Evaluation) -> Figure:
    """Return the result in one picture: a frame of each class, and all trials."""
    chosen = [_typical(evaluation, target, 0) for target in range(len(evaluation.bounds_n) + 1)]
    read = [look_at(answer) for answer in chosen if answer is not None]
    return draw_overview(read, evaluation.scored, evaluation.bounds_n, evaluation.max_force_n)


def segmentation_figure(evaluation: Evaluation) -> Html:
    """Return a raw frame and what the segmentation makes of it (Fig. 9): the first eye's frame of the largest force."""
    first = [frame for frame in evaluation.frames if frame.eye == evaluation.frames[0].eye]
    answer = max(first, key=lambda frame: frame.measured_force_n or 0.0)
    look = look_at(answer)
    drawn = draw_segmentation(look.frame, look.found.mask, look.found.outer_row, look.found.inner_row, look.extent_m)
    caption = f"Raw frame {answer.eye}/{answer.file} and the wall that was found in it (the paper's Fig. 9)."
    return figure(data_uri(drawn), "raw frame, boundaries, mask, masked frame", caption)


def pairs_figure(evaluation: Evaluation, reader: Classifier, rank: int, name: str) -> Html:
    """Return for each class a frame and the slice simulated for its measured force (Figs. 6, 7).

    Args:
        evaluation: the answers.
        reader: the model; its study gives Young's modulus and the size of the slice.
        rank: 0 takes for each class the eye with most trials in it, 1 the next one.
        name: the paper's figure.
    """
    chosen = [_typical(evaluation, target, rank) for target in range(reader.classes)]
    pairs = [_pair(frame, reader.study) for frame in chosen if frame is not None]
    likeness = np.mean([dice(pair.measured, pair.simulated) for pair in pairs])
    caption = (
        f"A frame of each class, its slice, and the slice simulated for its measured force at "
        f"{from_si(reader.study.eye.youngs_modulus_pa, 'mpa'):.3g} MPa (the paper's {name}). The simulated slice is "
        f"moved to where the eye lies in the frame, which shifts from frame to frame. Mean Dice {likeness:.3f}."
    )
    return figure(data_uri(draw_slice_pairs(pairs)), "frames beside simulated slices for each class", caption)


def _pair(answer: FrameAnswer, study: Study) -> SlicePair:
    """Return a frame with its slice and the simulated one for the measured force, laid on it by a shift."""
    look = look_at(answer)
    measured = look.slice(study.slice)
    force_n = max(answer.measured_force_n or 0.0, 0.0)
    unloaded, section = linear_sections(eye_of(look.recording, study), study)([0.0, force_n])
    return SlicePair(
        f"class {answer.target}: {answer.eye}, {from_si(force_n, 'mn'):.0f} mN",
        answer.target or 0,
        look.frame,
        look.extent_m,
        measured,
        _laid_on(section, float(unloaded.outer[:, 1].min()), measured, study),
        study.slice.pixel_m,
    )


def montage_figure(path: Path, study: Study) -> Html:
    """Return a sample of the data set (Fig. 8b)."""
    dataset = open_dataset(path)
    chosen = np.sort(np.random.default_rng(study.dataset.seed).choice(dataset.images, MONTAGE_SLICES, replace=False))
    chosen = chosen[np.argsort(dataset.force_n[chosen])]
    thickness_m = dataset.read("thickness_m")[chosen]
    drawn = draw_montage(
        dataset.slices[chosen], dataset.force_n[chosen], dataset.target[chosen].astype(np.intp), thickness_m
    )
    caption = (
        f"{MONTAGE_SLICES} of the {dataset.images} simulated slices, drawn at random, by force (the paper's Fig. 8b)."
    )
    return figure(data_uri(drawn), "simulated slices with force and wall thickness", caption)


def training_figure(reader: Classifier) -> Html:
    """Return the training curves of a model (Fig. 8a)."""
    curves = reader.record["curves"]
    drawn = draw_training_curves(
        curves["training_loss"],
        curves["validation_loss"],
        curves["training_accuracy"],
        curves["validation_accuracy"],
    )
    caption = (
        "Cross-entropy and accuracy over the epochs (the paper's Fig. 8a). Validation lies above training because "
        "training is measured under dropout, as the paper remarks too."
    )
    return figure(data_uri(drawn, "svg"), "loss and accuracy over the epochs", caption)


def _typical(evaluation: Evaluation, target: int, rank: int) -> FrameAnswer | None:
    """Return the usable trial of median force of a class, from the eye that is `rank`-th in trials of the class."""
    of_class = [f for f in evaluation.scored if f.target == target and f.answer.usable]
    eyes = sorted({f.eye for f in of_class}, key=lambda eye: (-sum(f.eye == eye for f in of_class), eye))
    if rank >= len(eyes):
        return None
    frames = sorted((f for f in of_class if f.eye == eyes[rank]), key=lambda f: f.measured_force_n or 0.0)
    return frames[len(frames) // 2]


def _laid_on(section: Section, top_m: float, measured: NDArray[np.uint8], study: Study) -> NDArray[np.uint8]:
    """Draw a section shifted to where it covers a slice best, in steps of half a pixel; `top_m`: unloaded wall."""
    best, best_likeness = measured * 0, -1.0
    steps = 0.5 * study.slice.pixel_m * np.arange(-12, 13)
    for depth_m in steps:
        for lateral_m in steps[4:-4]:
            drawn = fill_section(section, slice_window(study.slice, top_m, float(lateral_m), float(depth_m)))
            likeness = dice(drawn, measured)
            if likeness > best_likeness:
                best, best_likeness = drawn, likeness
    return best


FIGURES = 15  # progress ticks of the page

SIMULATED = (
    "The recordings are simulated: five virtual eyes, bent by the same linear mechanics that the network learned from, "
    "imaged by a simulated scanner, pushed by a simulated robot. The figures here show that the method works from end "
    "to end; below, the same eyes bend at finite strain, as walls do. Neither shows how well it reads real tissue. "
    "Not a medical device."
)

PAPER_RESULT = (
    "The paper read 42 of 45 trials on five ex vivo porcine eyes right: 93 %, 95 % interval 82 to 98 %; of the "
    "dangerous forces all 23. Real tissue is the harder task, so the two figures are no contest."
)


def write_reproduction_html(
    run: Run,
    evaluation: Evaluation,
    to_the_bounds: Evaluation,
    bent_paper: Evaluation,
    bent_reader: Evaluation,
    seconds: Mapping[str, float],
    made_at: datetime,
    progress: Progress,
) -> None:
    """Write the page of a run; a page that is there is replaced.

    Args:
        run: the run, all stages but this one done.
        evaluation: the answers to the virtual eyes of linear mechanics.
        to_the_bounds: those to the same eyes under forces up to the bounds of the classes.
        bent_paper: those of the paper's method to the eyes of finite strain.
        bent_reader: those of the force reader to the same.
        seconds: what the stages took.
        made_at: what the page gives as its date.
        progress: called with 1 after each figure.
    """
    reader = load_classifier(run.model)
    first = run.recordings / evaluation.frames[0].eye

    def drawn(block: Html) -> Html:
        progress(1)
        return block

    sections = (
        section(
            "Result",
            notice(SIMULATED),
            evaluation_cards(evaluation),
            paragraph(PAPER_RESULT),
            drawn(_overview(run, evaluation)),
        ),
        _design(run, evaluation),
        section("The simulated eye", drawn(model_figure(run.study)), drawn(mesh_figure(run.study))),
        section("Measured forces", drawn(force_log_figure(first, run.study))),
        section("From the raw frame to the slice", drawn(segmentation_figure(evaluation))),
        calibration_section(run, evaluation, drawn),
        section(
            "Frames beside the simulation",
            drawn(pairs_figure(evaluation, reader, 0, "Fig. 6")),
            drawn(pairs_figure(evaluation, reader, 1, "Fig. 7")),
        ),
        section(
            "Training",
            paragraph(_training_words(reader, seconds)),
            drawn(network_figure(reader)),
            drawn(training_figure(reader)),
            drawn(montage_figure(run.dataset, run.study)),
        ),
        _reading(evaluation, to_the_bounds, drawn(forces_figure(evaluation))),
        left_out_section(read_left_out_file(run.left_out), evaluation),
        bent_section(run, bent_paper, bent_reader, drawn),
        _deviations(),
        section("Time and provenance", _times(seconds), provenance_table(run.study, reader)),
    )
    lead = f"The method of {PAPER_TITLE}, run from end to end, beside what the paper reports."
    content = page(
        "Force from a single OCT slice",
        lead,
        made_line(made_at),
        *sections,
        style=view_style(),
        script=view_script(),
    )
    write_page(content, run.report, overwrite=True)


def _overview(run: Run, evaluation: Evaluation) -> Html:
    """Return the result in one picture, which is left beside the page as well."""
    drawn = overview_figure(evaluation)
    write_figure(drawn, run.overview)
    caption = "A raw frame of each class, the wall found in it and the class read from it; below, all trials."
    return figure(data_uri(drawn), "frames with the class read, and the forces of all trials", caption)


def _design(run: Run, evaluation: Evaluation) -> Html:
    """Return Table 1: wall thickness and trials of each class, here and in the paper."""
    eyes = list(dict.fromkeys(frame.eye for frame in evaluation.frames))
    counts = np.zeros((3, len(eyes)), dtype=int)
    for frame in evaluation.scored:
        if frame.target is not None:
            counts[frame.target, eyes.index(frame.eye)] += 1
    moduli = [eye.modulus_pa or 0.25e6 for eye in EYES]
    rows: list[list[object]] = [
        ["wall thickness in µm", *(f"{from_si(eye.thickness_m, 'um'):.0f}" for eye in EYES), NOTHING],
        ["Young's modulus in MPa (Table 2)", *(f"{from_si(modulus_pa, 'mpa'):.2f}" for modulus_pa in moduli), NOTHING],
    ]
    for target, name in enumerate(class_names(run.study.classes.bounds_n)):
        here = counts[target].tolist()
        paper = [eye.trials[target] for eye in EYES]
        cells = [f"{mine} ({theirs})" for mine, theirs in zip([*here, sum(here)], [*paper, sum(paper)], strict=True)]
        rows.append([name, *cells])
    totals = counts.sum(axis=0).tolist()
    cells = [
        f"{mine} ({theirs})"
        for mine, theirs in zip([*totals, sum(totals)], [*(sum(e.trials) for e in EYES), 45], strict=True)
    ]
    rows.append(["trials", *cells])
    caption = (
        "The virtual eyes and their trials by measured force; in brackets the paper's Table 1. Thickness and modulus "
        "are the paper's (eye 5: the mean modulus, because the paper gives none). The paper gives no forces: here they "
        "are spread evenly over each class, and none lies within 2 mN of a bound of its class."
    )
    return section("Design", table(["", *eyes, "total"], rows, caption))


def _reading(evaluation: Evaluation, to_the_bounds: Evaluation, forces: Html) -> Html:
    """Return Table 3, here and the paper's, the trials up to the bounds, Fig. 10, and the trials that were misread."""
    bounds_n = evaluation.bounds_n
    designs = [("2 mN clear of the bounds, as above", evaluation), ("up to the bounds", to_the_bounds)]
    gap = table(
        ["forces of the trials", "read right", "recall of class 2", "class 2 read as 0"],
        [[name, *_counts(answers)] for name, answers in designs],
        "The same five eyes and trials for each class; in the second row the forces are drawn from the whole of each "
        "class, so that some lie nearer to its bounds than the force log's noise and the calibration's error reach.",
    )
    mine = confusion_table(evaluation.confusion, bounds_n, f"Confusion matrix of this run. {NAMES_REMARK}")
    paper = confusion_table(np.array(CONFUSION), bounds_n, "The paper's Table 3, under the standard names: 42 of 45.")
    misread = [frame for frame in evaluation.scored if frame.answer.predicted != frame.target]
    missed = frame_table(evaluation, misread, "Misread trials.") if misread else paragraph("No trial was misread.")
    return section("Reading the forces", mine, paper, gap, forces, missed)


def _counts(evaluation: Evaluation) -> list[object]:
    dangerous = evaluation.confusion[2]
    right = evaluation.accuracy
    return [f"{right.hits} of {right.total}", f"{dangerous[2]} of {dangerous.sum()}", int(dangerous[0])]


def _training_words(reader: Classifier, seconds: Mapping[str, float]) -> str:
    metrics, samples = reader.record["metrics"], reader.record["samples"]
    images = samples["training"] + samples["validation"]
    low, high = metrics["validation_interval"]
    rate = seconds["generate"] / images
    return (
        f"{images} slices were simulated in {seconds['generate']:.0f} s ({from_si(rate, 'ms'):.1f} ms each; the paper: "
        f"{SECONDS_A_SLICE:.2f} s each), {samples['training']} of them to train on and {samples['validation']}, of "
        f"contacts that training never saw, to validate on. After {reader.record['epochs']} epochs the network reads "
        f"{from_si(metrics['validation_accuracy'], 'percent'):.2f} % of these (95 % interval "
        f"{from_si(low, 'percent'):.2f} to {from_si(high, 'percent'):.2f} %; the paper: 100 %)."
    )


def _deviations() -> Html:
    rows = [[item.topic, item.paper, item.here, item.reason] for item in DEVIATIONS]
    caption = "What is done otherwise than in the paper."
    return section("Deviations", table(["", "the paper", "here", "why"], rows, caption, prose=True))


def _times(seconds: Mapping[str, float]) -> Html:
    rows = [[name, f"{value:.1f}"] for name, value in seconds.items()]
    rows.append(["together", f"{sum(seconds.values()):.1f}"])
    return table(["stage", "seconds"], rows, "Stages of this run; writing this page comes on top.")
