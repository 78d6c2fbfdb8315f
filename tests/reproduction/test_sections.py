"""Sections of the page: forces on walls of finite strain against the log and against the truth."""

import re
from dataclasses import replace
from pathlib import Path

from small_recordings import frame_answer

from scleraforce.reader.evaluate import Evaluation
from scleraforce.reader.metrics import ForceTrial
from scleraforce.reproduction.bent_page import _comparison, _coverage_words, _held


def evaluation(folder: Path, kind: str, read_n: tuple[float | None, ...]) -> Evaluation:
    """Answers to two frames, the log 2 mN above the truth."""
    frames = tuple(
        frame_answer(
            recording=str(folder),
            eye="eye-1",
            file=f"{number}.png",
            measured_force_n=true_n + 2e-3,
            measured_force_sd_n=0.1e-3,
            true_force_n=true_n,
            force_n=force_n,
            interval_n=None if force_n is None else (force_n - 1e-3, force_n + 1e-3),
        )
        for number, (true_n, force_n) in enumerate(zip((10e-3, 20e-3), read_n, strict=True))
    )
    return Evaluation(
        model="model", bounds_n=(5e-3, 30e-3), max_force_n=60e-3, youngs_modulus_pa=0.25e6, frames=frames, kind=kind
    )


def test_forces_are_compared_with_the_log_and_with_the_truth(tmp_path: Path) -> None:
    paper = evaluation(tmp_path, "classifier", (None, None))
    reader = evaluation(tmp_path, "reader", (10.5e-3, 19.5e-3))
    rows = [re.findall(r"<t[hd][^>]*>([^<]*)", row) for row in re.findall(r"<tr>.*?</tr>", _comparison(paper, reader))]
    cells = {row[0]: row[1:] for row in rows}
    assert cells["mean error of the force in mN"] == ["\N{EN DASH}", "2.00"]
    assert cells["the same against the true force"] == ["\N{EN DASH}", "0.50"]
    assert cells["labels that agree with their 90 % interval"][1].startswith("0.00")
    assert cells["true forces within their 90 % interval"][1].startswith("1.00")


def test_a_low_coverage_is_explained_by_the_error_of_the_log(tmp_path: Path) -> None:
    (words,) = _coverage_words(evaluation(tmp_path, "reader", (10.5e-3, 19.5e-3)))
    assert "off from the true force by 2.00 mN in the mean and by 2.00 mN at most" in words
    assert "reach 1.00 mN to either side in the median" in words
    assert "agree with 0.00 of the labels, whose own error counts (0.10 mN" in words
    assert "hold 1.00 of the true forces: 2 of 2 of eye-1." in words
    assert "share the error" in words
    assert _coverage_words(evaluation(tmp_path, "classifier", (None, None))) == ()


def test_the_eye_with_the_least_coverage_is_named_with_its_common_error(tmp_path: Path) -> None:
    read = evaluation(tmp_path, "reader", (12e-3, 24e-3))
    calibrated = frame_answer(eye="eye-1", calibration=True, measured_force_n=10.3e-3, true_force_n=10e-3)
    (words,) = _coverage_words(replace(read, frames=(*read.frames, calibrated)))
    assert "eye-1 is read +20.0 % off in the mean, after labels of +0.30 mN in the mean of its calibration." in words


def test_the_band_of_a_coverage_is_over_eyes() -> None:
    """One eye holds and one does not, with two trials each: other two such eyes may hold none, half or all."""
    held = ForceTrial(eye="eye-1", measured_n=1.0, read_n=1.0, interval_n=(0.9, 1.1))
    missed = ForceTrial(eye="eye-2", measured_n=2.0, read_n=1.0, interval_n=(0.9, 1.1))
    assert _held([held, held, missed, missed]) == "0.50 (0.00 to 1.00)"
    assert _held([]) == "\N{EN DASH}"
