"""The page of `reproduce`: every table and figure of the paper, from the run in its
folder; walls that bend.
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from importlib.resources import files
from itertools import product
from math import isnan
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from scleraforce.base.arrays import Bytes, Places
from scleraforce.base.units import from_si
from scleraforce.calibration import answer_metrics
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.calibration import (
    Calibration,
    EyeCalibration,
    parse_calibration,
)
from scleraforce.calibration.evaluation import Evaluation, FrameAnswer
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.front.paper.run_folder import (
    CALIBRATED_EYES,
    CALIBRATION_FORCES_N,
    Progress,
    Run,
    bent_trials,
    run_library,
)
from scleraforce.front.report import frame_figures, html_pages
from scleraforce.front.report.figure_files import write_figure
from scleraforce.front.report.figures_beside import figure_encoder
from scleraforce.front.report.frame_figures import AnsweredFrame, answered_frames
from scleraforce.front.report.html_pages import NOTHING, PageTable
from scleraforce.front.report.model_figures import (
    draw_curves,
    draw_model,
    draw_network,
    draw_simulation,
)
from scleraforce.front.report.recording_figures import (
    draw_force_log,
    draw_modulus_over_frames,
    draw_observed_points,
)
from scleraforce.lab.training.slice_dataset import open_dataset
from scleraforce.lab.virtual_eye import (
    LinearSections,
    eye_name,
    paper_eyes,
    scan_plane,
    simulate_eye,
)
from scleraforce.library import Library
from scleraforce.library.plane_cut import cut_surfaces
from scleraforce.mechanics.contact_and_section import Contact, WallSection
from scleraforce.mechanics.mesh_section import fill_section, slice_window
from scleraforce.reading.load_model import (
    load_classifier,
    load_reader,
    load_wall_finder,
)
from scleraforce.reading.reading_models import Classifier
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import open_calibration, read_calibration
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.fields import declared
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER, model_name
from scleraforce.records.setup import Setup, completed_by_study
from scleraforce.records.study import Study, study_hash

# forces of the frames with computed walls: as near as the first eye's trials come
SHOWN_FORCES_N = (
    12e-3,
    28e-3,
    50e-3,
)


def _comparison(paper: Evaluation, reader: Evaluation) -> PageTable:
    """Return the comparison of the paper's method and the force reader on the same
    frames.
    """
    both = (paper, reader)
    true = reader.true_forces
    rows: list[list[object]] = [
        ["trials read right", *(one.accuracy.words(NOTHING) for one in both)],
        [
            "the same, of the usable ones",
            *(one.usable.accuracy.words(NOTHING) for one in both),
        ],
        [
            "dangerous forces seen (recall of class 2)",
            *(one.recall[-1].words(NOTHING) for one in both),
        ],
        [
            "dangerous forces read as harmless (2 as 0)",
            *(int(one.confusion[-1, 0]) for one in both),
        ],
        [
            "trials not usable, which count as class 2",
            *(len(one.scored) - len(one.usable.scored) for one in both),
        ],
        [
            "mean error of the force in mN",
            *(_number(from_si(one.mae_n, "mn")) for one in both),
        ],
        [
            "the same against the true force",
            NOTHING,
            _number(from_si(answer_metrics.mean_absolute_error(true), "mn")),
        ],
        [
            "labels that agree with their 90 % interval",
            *(_held(one.forces) for one in both),
        ],
        ["true forces within their 90 % interval", NOTHING, _held(true)],
    ]

    return PageTable(["", "the paper's method", "the force reader"], rows)


def _held(trials: Sequence[answer_metrics.ForceTrial]) -> str:
    band = answer_metrics.band_of(trials)
    if band is None:
        return NOTHING

    share = answer_metrics.coverage(trials).value
    return f"{share:.2f} ({band[0]:.2f} to {band[1]:.2f})"


def _coverage(reader: Evaluation) -> dict[str, object]:
    """Return the errors of the force log, the median reach of the intervals, mN, and
    what they hold.
    """
    logged = reader.forces
    true = reader.true_forces
    if not logged:
        return {}

    off_mn = [
        from_si(abs(log.measured_n - fact.measured_n), "mn")
        for log, fact in zip(logged, true, strict=True)
    ]
    reach_mn = median(
        from_si(high - low, "mn") / 2
        for low, high in (trial.interval_n for trial in true)
    )
    log = {
        "off_mn": mean(off_mn),
        "most_mn": max(off_mn),
        "label_mn": from_si(reader.label_sd_n, "mn"),
    }
    held = {
        "agree": reader.coverage.value,
        "hold": reader.true_coverage.value,
        "by_eye": answer_metrics.held_by_eye(true),
    }

    return {**log, **held, "reach_mn": reach_mn, "worst": _worst_eye(reader)}


def _worst_eye(reader: Evaluation) -> str:
    shares = answer_metrics.coverage_by_eye(reader.true_forces)
    worst = min(shares, key=lambda eye: shares[eye].value)
    if shares[worst].hits == shares[worst].total:
        return ""

    off = mean(
        trial.read_n / trial.measured_n - 1.0
        for trial in reader.true_forces
        if trial.eye == worst
    )
    frames = [
        frame for frame in reader.frames if frame.eye == worst and frame.calibration
    ]
    labels_mn = [
        from_si(frame.measured_force_n - frame.true_force_n, "mn")
        for frame in frames
        if frame.measured_force_n is not None and frame.true_force_n is not None
    ]
    labels = (
        f", after labels of {mean(labels_mn):+.2f} mN in the mean of its calibration"
        if labels_mn
        else ""
    )

    return f"{worst} is read {from_si(off, 'percent'):+.1f} % off in the mean{labels}. "


def _moduli(calibration: Path) -> dict[str, Modulus]:
    """Return the moduli of a calibration's eyes."""
    eyes = read_calibration(calibration).eyes
    return {name: one.eye.modulus for name, one in eyes.items() if one.eye.modulus}


def _bent_moduli(run: Run) -> PageTable:
    linear, finite = (
        _moduli(path) for path in (run.bent_linear, run.bent_finite_strain)
    )
    eyes = {
        eye_name(setup): setup.eye.modulus_pa for setup, _ in bent_trials(run.study)
    }
    off = {
        name: (finite[name].mean_pa - true_pa) / finite[name].sd_pa
        for name, true_pa in eyes.items()
        if name in finite
    }
    posteriors = [
        {
            name: f"{from_si(found.mean_pa, 'mpa'):.3f} ±"
            f" {from_si(found.sd_pa, 'mpa'):.3f}"
            for name, found in moduli.items()
        }
        for moduli in (linear, finite)
    ]
    rows: list[list[object]] = [
        ["true", *(f"{from_si(true_pa, 'mpa'):.3f}" for true_pa in eyes.values())],
        ["linear, all frames", *(posteriors[0].get(name, NOTHING) for name in eyes)],
        [
            "finite strain, three frames",
            *(posteriors[1].get(name, NOTHING) for name in eyes),
        ],
        [
            "its error, in standard deviations",
            *(f"{off[name]:+.1f}" if name in off else NOTHING for name in eyes),
        ],
    ]

    return PageTable(["", *eyes], rows)


def _misread(evaluation: Evaluation) -> PageTable | None:
    misread = [frame for frame in evaluation.scored if frame.misread]
    return html_pages.frame_table(evaluation, misread) if misread else None


def _walls_figure(run: Run, reader: Evaluation) -> Figure:
    first = [frame for frame in reader.scored if frame.eye == reader.scored[0].eye]
    nearest = [
        min(first, key=lambda frame: abs((frame.measured_force_n or 0.0) - force))
        for force in SHOWN_FORCES_N
    ]
    frames_shown = answered_frames(list(dict.fromkeys(nearest)))
    forces_n = [
        max(answered.answer.measured_force_n or 0.0, 0.0) for answered in frames_shown
    ]
    linear, finite = (
        _stated_eye(run, path, frames_shown[0])
        for path in (run.bent_linear, run.bent_finite_strain)
    )
    computed = {
        "finite strain": _finite_sections(run_library(run), finite, forces_n),
        "linear": LinearSections(linear, run.study)(forces_n),
    }

    return frame_figures.draw_computed_walls(frames_shown, computed)


def _stated_eye(run: Run, calibration: Path, answered: AnsweredFrame) -> Setup:
    modulus = Modulus.stated(_moduli(calibration)[answered.answer.eye].mean_pa)
    setup = stated_setup(answered.recording, run.study)
    return replace(setup, eye=replace(setup.eye, modulus=modulus))


def _finite_sections(
    library: Library, setup: Setup, forces_n: Sequence[float]
) -> list[WallSection]:
    """Return the library's sections of an eye; beyond its largest force, its last
    state.
    """
    E = setup.eye.modulus_pa
    iop_pa = declared(setup.eye.iop_pa, "eye: iop_pa")
    plane = scan_plane(setup)
    library = library.for_contact(plane.contact.polar_rad)
    thickness_m = np.full(
        len(forces_n), declared(setup.eye.thickness_m, "eye: thickness_m")
    )
    iop_ratio = np.full(len(forces_n), iop_pa / E)
    ratios = np.minimum(
        np.array(forces_n) / E, library.largest_force_ratio(thickness_m, iop_ratio)
    )
    walls = library.curves(thickness_m, iop_ratio, ratios).curves_sbnc.astype(
        np.float64
    )

    return [cut_surfaces(wall, plane.gap_m, plane.tilt_rad) for wall in walls]


def _number(value: float) -> str:
    return NOTHING if isnan(value) else f"{value:.2f}"


def stated_setup(recording: Recording, study: Study) -> Setup:
    """Return what a recording states, completed by the study, also by a thickness."""
    thickness_m = study.dataset.group[0].thickness_m
    setup = completed_by_study(recording.info.setup, study)
    return setup.completed_by(Setup(eye=Eye(thickness_m=thickness_m)))


PAPER_MODULUS_PA = 0.25e6  # the paper's mean for all eyes, sec. 3.2
PAPER_SD_PA = (4.7e3, 6.7e3, 3.9e3, 4.9e3)  # of the eyes' moduli, Table 2
PAPER_CONFUSION = ((5, 2, 0), (0, 14, 1), (0, 0, 23))  # Table 3, rows are targets

SECTIONS = 14  # progress ticks of the page
MONTAGE_SLICES = 36
LOG_TRIALS = 5  # the paper's Fig. 3 shows five acquisitions
AFTER_LAST_S = 4.0  # of them, in the figure


def write_reproduction_html(
    run: Run,
    evaluations: Sequence[Evaluation],
    seconds: Mapping[str, float],
    made_at: datetime,
    progress: Progress,
) -> None:
    """Write the page of a run; `evaluations`: linear, up to the bounds, finite strain
    by paper and by reader.
    """
    values: dict[str, Any] = {"run": run, "seconds": seconds}
    with figure_encoder() as encoder:
        for part in _parts(run, evaluations, seconds):
            values |= {name: encoder.begin(value) for name, value in part.items()}
            progress(1)

        values = {name: encoder.finish(value) for name, value in values.items()}

    html_pages.write_page(
        "front/paper/report.html", run.report, made_at, values, overwrite=True
    )


def _parts(
    run: Run, evaluations: Sequence[Evaluation], seconds: Mapping[str, float]
) -> Iterator[dict[str, Any]]:
    """Yield the values of the page's sections, in their order."""
    evaluation, to_the_bounds, bent_paper, bent_reader = evaluations
    reader = load_classifier(run.model)
    study = run.study
    overview = frame_figures.draw_overview(
        answered_frames(_typical(evaluation, 0)), evaluation
    )
    write_figure(overview, run.overview)
    yield {
        "evaluation": evaluation,
        "overview": overview,
        "design": _design(run, evaluation),
    }
    contact = Contact(polar_rad=sum(study.needle.polar_angle_rad.bounds) / 2)
    eye = simulate_eye(study, 500e-6, study.classes.bounds_n[1], contact)
    yield {"model": draw_model(study), "eye": eye, "mesh": draw_simulation(eye)}
    yield _frames(run, evaluation)
    yield _calibration(run, evaluation)
    pairs = [_pairs(evaluation, reader, rank) for rank in (0, 1)]
    yield {
        "pairs": pairs,
        "modulus_mpa": from_si(reader.study.eye.youngs_modulus_pa, "mpa"),
    }
    yield _training(run, reader, seconds)
    paper_table = html_pages.confusion_table(evaluation, np.array(PAPER_CONFUSION))
    yield {
        "paper_table": paper_table,
        "to_the_bounds": _to_the_bounds(evaluation, to_the_bounds),
    }
    yield {
        "misread": _misread(evaluation),
        "bent_misread": [_misread(bent_paper), _misread(bent_reader)],
    }
    yield {
        "bent_paper": bent_paper,
        "bent_reader": bent_reader,
        "comparison": _comparison(bent_paper, bent_reader),
    }
    yield {
        "coverage": _coverage(bent_reader),
        "shared_error": answer_metrics.SHARED_ERROR,
        "bent_moduli": _bent_moduli(run),
    }
    forces_mn = [f"{from_si(force_n, 'mn'):g}" for force_n in CALIBRATION_FORCES_N]
    yield {
        "calibrated": CALIBRATED_EYES,
        "forces_mn": forces_mn,
        "walls": _walls_figure(run, bent_reader),
    }
    yield {"reader": load_reader(run.reader), "reader_name": model_name(run.reader)}
    text = (
        files("scleraforce.front.paper")
        .joinpath("deviations.toml")
        .read_text(encoding="utf-8")
    )
    deviations = [
        list(deviation.values()) for deviation in tomllib.loads(text)["deviation"]
    ]
    yield {"deviations": PageTable(["", "the paper", "here", "why"], deviations)}
    taken = [
        [name, f"{value:.1f}"]
        for name, value in [
            *seconds.items(),
            ("one after the other", sum(seconds.values())),
        ]
    ]
    yield {
        "times": PageTable(["stage", "seconds"], taken),
        "provenance": html_pages.provenance_table(study, reader),
    }


def _design(run: Run, evaluation: Evaluation) -> PageTable:
    """Return Table 1: wall thickness and trials of each class, here and in the
    paper.
    """
    design = paper_eyes(run.study)
    names = html_pages.class_names(run.study.classes.bounds_n)
    eyes = [setup.eye for setup, _ in design]
    bounds_n = run.study.classes.bounds_n
    targets = [
        [
            f.target
            for f in evaluation.scored
            if f.eye == eye.name and f.target is not None
        ]
        for eye in eyes
    ]
    here = _counts(targets, len(names))
    paper = _counts(
        [np.digitize(forces_n, bounds_n) for _, forces_n in design], len(names)
    )
    moduli = [f"{from_si(eye.modulus_pa, 'mpa'):.2f}" for eye in eyes]
    thicknesses_m = [declared(eye.thickness_m, "eye: thickness_m") for eye in eyes]
    rows: list[list[object]] = [
        [
            "wall thickness in µm",
            *(f"{from_si(thickness_m, 'um'):.0f}" for thickness_m in thicknesses_m),
            NOTHING,
        ],
        ["Young's modulus in MPa (Table 2)", *moduli, NOTHING],
    ]

    for name, mine, theirs in zip([*names, "trials"], here, paper, strict=True):
        rows.append(
            [
                name,
                *(
                    f"{count} ({stated})"
                    for count, stated in zip(mine, theirs, strict=True)
                ),
            ]
        )

    return PageTable(["", *(eye_name(setup) for setup, _ in design), "total"], rows)


def _counts(classes: Sequence[ArrayLike], names: int) -> Places:
    counts = np.stack(
        [
            np.bincount(np.asarray(of_eye, np.intp), minlength=names)
            for of_eye in classes
        ],
        axis=1,
    )
    counts = np.vstack([counts, counts.sum(axis=0)])

    return np.hstack([counts, counts.sum(axis=1, keepdims=True)])


def _frames(run: Run, evaluation: Evaluation) -> dict[str, Any]:
    """Return the first eye's first acquisitions in its force log (Fig. 3), and its
    frame of the largest force (9).
    """
    recording = read_recording(run.recordings / evaluation.frames[0].eye)
    classes = run.study.classes
    trials = label_frames(recording, classes)[:LOG_TRIALS]
    log = draw_force_log(
        recording, trials, classes.bounds_n, trials[-1].time_s + AFTER_LAST_S
    )
    first = [
        frame for frame in evaluation.frames if frame.eye == evaluation.frames[0].eye
    ]
    answered = answered_frames(
        [max(first, key=lambda frame: frame.measured_force_n or 0.0)]
    )[0]
    segmentation = frame_figures.draw_segmentation(answered)

    return {
        "log": log,
        "log_trials": len(trials),
        "segmented": answered.answer,
        "segmentation": segmentation,
    }


def _calibration(run: Run, evaluation: Evaluation) -> dict[str, Any]:
    """Return Table 2, the estimate over the frames of the first eye (Fig. 5), and its
    points before and after (4).
    """
    calibration = parse_calibration(open_calibration(run.calibration))
    # Calibrated once more: the file keeps no points to draw.
    opened = read_recording(run.recordings / next(iter(calibration.eyes)))
    finder = load_wall_finder(SHIPPED_WALL_FINDER)
    study = run.study
    (first,) = calibrate_recordings(
        [opened], study, study_hash(study), None, walls=FoundWalls(finder)
    ).eyes.values()
    over_frames = draw_modulus_over_frames(
        first, paper_eyes(study)[0][0].eye.modulus_pa
    )
    index = max(range(len(first.used)), key=lambda number: first.used[number].force_n)
    shown = first.id, first.used[index].file
    answered = answered_frames(
        [next(frame for frame in evaluation.frames if (frame.eye, frame.file) == shown)]
    )[0]
    mean_pa, spread_pa = calibration.population
    spread = "not known from one eye" if spread_pa is None else f"{_mpa(spread_pa)} MPa"
    moments = {
        "mean": _mpa(mean_pa),
        "spread": spread,
        "paper_mpa": from_si(PAPER_MODULUS_PA, "mpa"),
    }
    points = draw_observed_points(first, answered.frame, index, *answered.extent_m)
    drawn = {
        "calibrated_eye": first.id,
        "over_frames": over_frames,
        "points": points,
        "points_frame": "/".join(shown),
    }

    return {**moments, **drawn, "moduli": modulus_table(calibration, study)}


def modulus_table(calibration: Calibration, study: Study) -> PageTable:
    """Return Table 2."""
    eyes: list[EyeCalibration] = list(calibration.eyes.values())
    truths_pa = [
        setup.eye.modulus_pa
        for (setup, _), _ in zip(paper_eyes(study), eyes, strict=False)
    ]
    rows: list[list[object]] = [
        ["mean in MPa", *(_mpa(eye.mean_pa) for eye in eyes)],
        [
            "standard deviation in kPa",
            *(f"{from_si(eye.sd_pa, 'kpa'):.1f}" for eye in eyes),
        ],
        ["frames used", *(len(eye.used) for eye in eyes)],
        [
            "true modulus = the paper's mean, in MPa",
            *(f"{from_si(truth_pa, 'mpa'):.2f}" for truth_pa in truths_pa),
        ],
        [
            "the paper's standard deviation in kPa",
            *(
                f"{from_si(sd_pa, 'kpa'):.1f}"
                for sd_pa, _ in zip(PAPER_SD_PA, eyes, strict=False)
            ),
        ],
    ]

    return PageTable(["", *calibration.eyes], rows)


def _mpa(modulus_pa: float) -> str:
    return f"{from_si(modulus_pa, 'mpa'):.3f}"


def _pairs(
    evaluation: Evaluation, reader: Classifier, rank: int
) -> tuple[Figure, float]:
    """Return a frame of each class, of its `rank`-th eye, beside the slice simulated
    for its force; their mean Dice.
    """
    pairs = [
        _pair(answered, reader.study)
        for answered in answered_frames(_typical(evaluation, rank))
    ]
    likeness = float(
        np.mean(
            [
                answer_metrics.dice(measured, simulated)
                for _, measured, simulated in pairs
            ]
        )
    )

    return frame_figures.draw_slice_pairs(pairs, reader.study.slice.pixel_m), likeness


def _typical(evaluation: Evaluation, rank: int) -> list[FrameAnswer]:
    """Return the usable trial of median force of each class, from the eye that is
    `rank`-th in trials of the class.
    """
    found = []
    for target in range(len(evaluation.bounds_n) + 1):
        of_class = [
            f for f in evaluation.scored if f.target == target and f.answer.usable
        ]
        eyes = sorted(
            {f.eye for f in of_class},
            key=lambda eye: (-sum(f.eye == eye for f in of_class), eye),
        )
        if rank < len(eyes):
            frames = sorted(
                (f for f in of_class if f.eye == eyes[rank]),
                key=lambda f: f.measured_force_n or 0.0,
            )
            found.append(frames[len(frames) // 2])

    return found


def _pair(answered: AnsweredFrame, study: Study) -> tuple[AnsweredFrame, Bytes, Bytes]:
    measured = answered.slice(study.slice)
    force_n = max(answered.answer.measured_force_n or 0.0, 0.0)
    unloaded, section = LinearSections(stated_setup(answered.recording, study), study)(
        [0.0, force_n]
    )

    return (
        answered,
        measured,
        _laid_on(section, float(unloaded.outer[:, 1].min()), measured, study),
    )


def _laid_on(
    section: WallSection, top_m: float, measured: Bytes, study: Study
) -> Bytes:
    """Draw a section shifted to where it covers a slice best, in steps of half a pixel;
    `top_m`: unloaded wall.
    """
    steps = (0.5 * study.slice.pixel_m * np.arange(-12, 13)).tolist()
    drawn = (
        fill_section(section, slice_window(study.slice, top_m, lateral_m, depth_m))
        for depth_m, lateral_m in product(steps, steps[4:-4])
    )
    return max(drawn, key=lambda one: answer_metrics.dice(one, measured))


def _training(
    run: Run, reader: Classifier, seconds: Mapping[str, float]
) -> dict[str, Any]:
    """Return the network (Fig. 2), its curves (Fig. 8a), and slices that it has learned
    from (Fig. 8b).
    """
    study = reader.study
    record = reader.record
    window = (study.slice.columns, study.slice.rows)
    names = html_pages.class_names(study.classes.bounds_n)
    network = draw_network(window, study.network.hidden, names, study.network.dropout)
    dataset = open_dataset(run.dataset)
    rng = np.random.default_rng(run.study.dataset.seed)
    chosen = np.sort(rng.choice(dataset.images, MONTAGE_SLICES, replace=False))
    counts = {
        "images": dataset.images,
        "shown": MONTAGE_SLICES,
        "rate_s": seconds["generate"] / dataset.images,
    }
    curves = draw_curves(record["curves"], "epoch")
    montage = frame_figures.draw_montage(dataset, chosen)

    return {
        **counts,
        "record": record,
        "network": network,
        "curves": curves,
        "montage": montage,
    }


def _to_the_bounds(evaluation: Evaluation, to_the_bounds: Evaluation) -> PageTable:
    rows: list[list[object]] = []
    designs = {
        "2 mN clear of the bounds, as above": evaluation,
        "up to the bounds": to_the_bounds,
    }

    for name, answers in designs.items():
        right = answers.accuracy
        dangerous = answers.confusion[2]
        recall = f"{dangerous[2]} of {dangerous.sum()}"
        rows.append([name, f"{right.hits} of {right.total}", recall, int(dangerous[0])])

    return PageTable(
        [
            "forces of the trials",
            "read right",
            "recall of class 2",
            "class 2 read as 0",
        ],
        rows,
    )
