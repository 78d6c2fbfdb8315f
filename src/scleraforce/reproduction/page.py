"""The page of `reproduce`: every table and figure of the paper, from the run in its folder."""

from collections.abc import Mapping
from datetime import datetime

import numpy as np

from scleraforce.reader import Classifier, load_classifier
from scleraforce.reader.evaluate import Evaluation
from scleraforce.report.deviations import DEVIATIONS
from scleraforce.report.evaluation_page import NAMES_REMARK, evaluation_cards, forces_figure
from scleraforce.report.eye_view.view import view_script, view_style
from scleraforce.report.files import write_figure, write_page
from scleraforce.report.html import Html, figure, notice, page, paragraph, section, table
from scleraforce.report.paper import CONFUSION, EYES, PAPER_TITLE, SECONDS_A_SLICE
from scleraforce.report.provenance import made_line, provenance_table
from scleraforce.report.style import data_uri
from scleraforce.report.tables import NOTHING, class_names, confusion_table, frame_table
from scleraforce.reproduction.bent_section import bent_section
from scleraforce.reproduction.calibration_section import calibration_section, left_out_section
from scleraforce.reproduction.figures import (
    force_log_figure,
    mesh_figure,
    model_figure,
    montage_figure,
    network_figure,
    overview_figure,
    pairs_figure,
    segmentation_figure,
    training_figure,
)
from scleraforce.reproduction.left_out import read_left_out_file
from scleraforce.reproduction.run import Progress, Run
from scleraforce.units import from_si

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
    misread = [frame for frame in evaluation.scored if frame.predicted != frame.target]
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
