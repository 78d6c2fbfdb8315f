"""The figures of a reproduction, drawn from what its stages have left in the folder."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scleraforce.dataset import open_dataset
from scleraforce.eye.contact import Contact
from scleraforce.laboratory.simulation import simulate_eye
from scleraforce.laboratory.virtual_eye import PhantomEye, linear_sections
from scleraforce.reader import Classifier
from scleraforce.reader.evaluate import Evaluation, FrameAnswer
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.recording.labels import contact_force, label_frames
from scleraforce.report.answered_frame import look_at
from scleraforce.report.eye_view.view import eye_view
from scleraforce.report.force_figures import draw_force_log
from scleraforce.report.html import Html, figure
from scleraforce.report.mesh_figure import draw_simulation
from scleraforce.report.overview_figure import draw_overview
from scleraforce.report.schematics import draw_model, draw_network
from scleraforce.report.slice_figures import SlicePair, dice, draw_montage, draw_segmentation, draw_slice_pairs
from scleraforce.report.style import data_uri
from scleraforce.report.tables import class_names
from scleraforce.report.training_figure import draw_training_curves
from scleraforce.section.plane import Section
from scleraforce.section.slices import fill_section, slice_window
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

    A page that holds it needs the style and the script of `report.eye_view.view`.
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
    of_class = [f for f in evaluation.scored if f.target == target and f.usable]
    eyes = sorted({f.eye for f in of_class}, key=lambda eye: (-sum(f.eye == eye for f in of_class), eye))
    if rank >= len(eyes):
        return None
    frames = sorted((f for f in of_class if f.eye == eyes[rank]), key=lambda f: f.measured_force_n or 0.0)
    return frames[len(frames) // 2]


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
