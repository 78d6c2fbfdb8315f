"""Young's modulus in the page of `reproduce`: the paper's Table 2, Figs. 4 and 5, and each eye left out of the mean."""

from collections.abc import Callable, Sequence

from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.result import Calibration, EyeCalibration, found_words, parse_calibration
from scleraforce.known.calibration_file import open_calibration
from scleraforce.models.folder import SHIPPED_WALL_FINDER
from scleraforce.reader.evaluate import Evaluation
from scleraforce.reader.metrics import Proportion
from scleraforce.reader.model import load_wall_finder
from scleraforce.recording.folder import read_recording
from scleraforce.report.answered_frame import look_at
from scleraforce.report.calibration_figures import draw_modulus_over_frames, draw_observed_points
from scleraforce.report.html import Html, figure, paragraph, section, table
from scleraforce.report.paper import EYES, MEAN_MODULUS_PA
from scleraforce.report.style import data_uri
from scleraforce.report.tables import NOTHING, share
from scleraforce.reproduction.left_out import LeftOut
from scleraforce.reproduction.run import Run
from scleraforce.study import study_hash
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
    return sum(frame.predicted == frame.target for frame in trials), len(trials)


def _of_eye(evaluation: Evaluation, eye: str) -> Proportion:
    return Proportion(*_counts(evaluation, eye))
