"""A first look: a small virtual session from the push to the page, with the bundled
reader.
"""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from math import radians
from pathlib import Path

from scleraforce.base.errors import InputError
from scleraforce.base.units import to_si
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.evaluation import Evaluation, evaluate_recordings
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.front.report.frame_figures import answered_frames
from scleraforce.front.report.html_pages import shown_frames, write_evaluation_html
from scleraforce.lab.virtual_eye import study_sections
from scleraforce.lab.virtual_recording import plan_phantom, write_phantom
from scleraforce.reading.load_model import load_force_reader, load_wall_finder
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import read_calibration, write_calibration
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.model_folder import SHIPPED_READER, SHIPPED_WALL_FINDER
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import MechanicsStudy, MeshStudy, Study, study_hash

IOP_PA = to_si(2.0, "mmhg")
POLAR_RAD = radians(35.0)
NAME = "demo"
SETUP = Setup(
    eye=Eye(NAME, thickness_m=650e-6, modulus=Modulus.stated(0.3e6), iop_pa=IOP_PA),
    needle=Needle(gap_m=0.5e-3, polar_rad=POLAR_RAD),
)
FORCES_N = (
    0.002,
    0.007,
    0.011,
    0.015,
    0.019,
    0.023,
    0.027,
    0.033,
    0.037,
    0.042,
    0.046,
    0.050,
)
TAUGHT = 3  # frames that calibrate
# coarse: tips within 2 %
MESH_CORE = 4
MESH_RINGS = 8
# shares of the time
BENT = 0.5
CALIBRATION_DONE = 0.75
FRAMES_READ = 0.8


@dataclass(frozen=True)
class Demo:
    """Results of the session: its files, the calibrated modulus, Pa, and the
    answers.
    """

    recording: Path
    calibration: Path
    page: Path
    modulus_pa: float
    evaluation: Evaluation


def run_demo(
    out: Path, made_at: datetime, progress: Callable[[float], object] | None = None
) -> Demo:
    """Push a virtual eye, calibrate on three of the frames, read the others, and write
    a page with the date `made_at`.

    A failure removes the folder. `progress` is called with the finished share of the
    work. It raises `InputError` if `out` exists or cannot be written.
    """
    if out.exists():
        raise InputError(
            f"{out}: exists already; remove it or choose another folder with `out`"
        )

    reach = progress or (lambda _: None)
    recording = out / "eye"
    calibration = out / "modulus.json"
    page = out / "answers.html"
    mesh = MeshStudy(core=MESH_CORE, rings=MESH_RINGS)
    mechanics = MechanicsStudy(kind="finite-strain")
    study = Study(mesh=mesh, mechanics=mechanics)

    try:
        sections_at = study_sections(SETUP, study, lambda share: reach(BENT * share))
        write_phantom(
            recording,
            plan_phantom(SETUP, FORCES_N, study, study.phantom.seed),
            sections_at,
            study,
        )
        reader = load_force_reader(SHIPPED_READER)
        finder = load_wall_finder(SHIPPED_WALL_FINDER)
        opened = [read_recording(recording)]
        of_study = reader.study, study_hash(reader.study), reader.library
        found = calibrate_recordings(
            opened, *of_study, frames=TAUGHT, walls=FoundWalls(finder)
        )
        write_calibration(found.to_dict(), calibration)
        reach(CALIBRATION_DONE)
        evaluation = evaluate_recordings(
            reader, [recording], read_calibration(calibration)
        )
        reach(FRAMES_READ)
        write_evaluation_html(
            evaluation, answered_frames(shown_frames(evaluation.frames)), page, made_at
        )
        reach(1.0)
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise

    return Demo(recording, calibration, page, found.eyes[NAME].mean_pa, evaluation)
