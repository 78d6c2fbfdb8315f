"""Small recordings, their answers and their calibrations."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from shutil import copytree
from typing import Any

import analytic_frames
import cv2
import numpy as np
import pytest
from analytic_frames import (
    GAP_M,
    IOP_PA,
    MODULUS_PA,
    THICKNESS_M,
    image,
    recording_toml,
    tip_of,
    wall_section,
)
from analytic_library import solve_analytic
from small_models import write_fixed_reader

import virtual_eyes
from scleraforce.calibration.calibration import (
    RIGIDITY,
    Calibration,
    EyeCalibration,
    FrameRecord,
    UsedRecording,
)
from scleraforce.calibration.evaluation import Evaluation, FrameAnswer
from scleraforce.calibration.filter.eye_filter import PARAMETERS
from scleraforce.calibration.stiffness_from_forces import KnownForce
from scleraforce.front.report.frame_figures import AnsweredFrame, answered_frames
from scleraforce.lab.training import slice_dataset
from scleraforce.lab.virtual_recording import plan_phantom, write_phantom
from scleraforce.library import library_store
from scleraforce.reading.answer import Answer
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records import needle, recording_info
from scleraforce.records.decoder import format_record
from scleraforce.records.eye import Eye, ForceDiscrepancy, Modulus
from scleraforce.records.frame import frame_digest
from scleraforce.records.globe import REFERENCE_RIGIDITY, SEALED
from scleraforce.records.needle import Needle
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, read_study
from scleraforce.wall.find_wall import find_wall

ROWS = 24
COLUMNS = 32


def write_small_recording(
    folder: Path,
    frames: int = 40,
    rate_hz: float = 100.0,
    forces_mn=None,
    log: bool = True,
    pictures=None,
    bits: int = 12,
    pixel_m: tuple[float, float] = (0.008 / COLUMNS, 0.003 / ROWS),
) -> Path:
    """Write frames of noise, numbered in their first pixel, or `pictures`; return the
    folder.
    """
    rng = np.random.default_rng(0)
    if pictures is None:
        pictures = [
            rng.integers(0, 4096, (ROWS, COLUMNS), dtype=np.uint16)
            for _ in range(frames)
        ]
        for index, pixels in enumerate(pictures):
            pixels[0, 0] = index

    rows, columns = pictures[0].shape
    (folder / "frames").mkdir(parents=True)
    force = "[force]\naxis = 'fz'\ncontact_sign = -1\naverage_s = 0.1\n" if log else ""
    (folder / "recording.toml").write_text(
        f"[eye]\nid = 'small'\n[oct]\ncolumns = {columns}\nrows = {rows}\nbits = "
        f"{bits}\nwidth_m = {columns * pixel_m[0]}\ndepth_m = "
        f"{rows * pixel_m[1]}\n[needle]\ngauge = "
        f"22\nslice_gap_m = 0.0005\n{force}"
    )
    lines = ["file,time_s"]

    for index, pixels in enumerate(pictures):
        assert cv2.imwrite(str(folder / "frames" / f"{index:04d}.png"), pixels)
        lines.append(f"{index:04d}.png,{1.0 + index / rate_hz:.4f}")

    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    if log:
        samples = np.arange(1.0, 1.0 + frames / rate_hz, 0.005)
        rows = [
            f"{time_s:.4f},0.001,0.002,{-time_s:.4f},0.1,0.2,0.3" for time_s in samples
        ]
        (folder / "forces.csv").write_text(
            "\n".join(["time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm", *rows]) + "\n"
        )

    if forces_mn is not None:
        truth = [
            {"file": f"{n:04d}.png", "force_n": force / 1e3}
            for n, force in enumerate(forces_mn)
        ]
        (folder / "truth.json").write_text(json.dumps({"frames": truth}))

    return folder


LOGGED_INFO = recording_info.RecordingInfo(
    Eye("eye"),
    Scan(
        columns=32,
        rows=16,
        bits=12,
        width_m=15e-3,
        depth_m=4e-3,
        refractive_index=1.0,
    ),
    needle.Needle(diameter_m=needle.gauge_diameter_m(22), gap_m=5e-4),
    recording_info.ForceInfo("fz", -1),
)


RIGHT = FrameAnswer(
    recording="rec",
    eye="eye",
    file="0000.png",
    measured_force_n=0.020,
    target=1,
    answer=Answer(predicted=1, probabilities=(0.0, 1.0, 0.0), usable=True, reason=None),
)


def changed(frame: FrameAnswer, **said: Any) -> FrameAnswer:
    """A frame with other attributes of it, or of its answer."""
    of_answer = {
        name: said.pop(name) for name in [*said] if name in Answer.__dataclass_fields__
    }
    return replace(frame, answer=replace(frame.answer, **of_answer), **said)


def frame_answer(**said: Any) -> FrameAnswer:
    """The answer to a frame of 20 mN that is read as class 1, with other attributes."""
    return changed(RIGHT, **said)


def refused_frame(**said: Any) -> FrameAnswer:
    """The answer to a frame that cannot be judged, of the highest class, with other
    attributes.
    """
    return changed(
        RIGHT, **{"predicted": 2, "probabilities": None, "usable": False, **said}
    )


def evaluation_of(frames: Iterable[FrameAnswer], **more: Any) -> Evaluation:
    """The evaluation that has these answers."""
    limits = {
        "bounds_n": (0.005, 0.03),
        "max_force_n": 0.06,
        "youngs_modulus_pa": 0.25e6,
    }
    return Evaluation(**{"model": "model", **limits, "frames": tuple(frames), **more})


LOOKED_AT_ROWS = 256
LOOKED_AT_COLUMNS = 300


def looked_at_frames(folder: Path, count: int) -> tuple[AnsweredFrame, ...]:
    """Return frames of a wall 0.6 mm thick, each read as it was measured: 20 mN, class
    1.
    """
    (folder / "frames").mkdir(parents=True)
    scan = replace(LOGGED_INFO.scan, rows=LOOKED_AT_ROWS, columns=LOOKED_AT_COLUMNS)
    (folder / "recording.toml").write_text(
        format_record(replace(LOGGED_INFO, scan=scan, force=None))
    )
    names = [f"{number:04d}.png" for number in range(1, count + 1)]
    (folder / "frames.csv").write_text(
        "\n".join(["file,time_s", *(f"{name},{n}" for n, name in enumerate(names))])
    )
    rng = np.random.default_rng(7)

    for name in names:
        cv2.imwrite(str(folder / "frames" / name), drawn_wall(rng))

    recording = read_recording(folder)
    scale = recording.info.scan.scale
    return answered_frames(
        frame_answer(
            recording=str(folder),
            file=entry.file,
            segmentation=find_wall(recording.frame(entry), scale),
        )
        for entry in recording.frames
    )


def read_frames(
    folder: Path, reason: str, **more: Any
) -> tuple[tuple[AnsweredFrame, ...], Evaluation]:
    """Four frames of 20 mN, read as 21 mN, and their evaluation: the second is misread,
    the third not usable.
    """
    looks = looked_at_frames(folder, 4)
    answers = [
        changed(look.answer, force_n=0.021, interval_n=(0.0187, 0.0234), **more)
        for look in looks
    ]
    differ = Remark("methods-disagree", "the methods differ")
    answers[1] = changed(answers[1], predicted=2, remarks=(differ,))
    nothing = {"force_n": None, "interval_n": None, "probabilities": None}
    answers[2] = changed(
        answers[2], usable=False, predicted=2, reason=reason, **nothing
    )
    looks = tuple(
        replace(look, answer=answer)
        for look, answer in zip(looks, answers, strict=True)
    )

    gap = Remark("outside-training", "a gap of 0.9 mm", ("gap_m",))
    return looks, evaluation_of(answers, remarks=(gap,), kind="reader")


def drawn_surface_m(lateral_m: np.ndarray, dent_m: float) -> np.ndarray:
    """Depth of the surface of `drawn_wall`."""
    round_m = 12e-3 - np.sqrt(12e-3**2 - lateral_m**2)
    return 0.5e-3 + round_m + dent_m * np.exp(-((lateral_m / 2e-3) ** 2))


def drawn_wall(rng: np.random.Generator, dent_m: float = 0.6e-3) -> np.ndarray:
    """A frame of 15 x 4 mm, in 12 bits, with a wall of 0.6 mm: its surface is 0.5 mm
    deep in the middle, and dented.
    """
    lateral_m = (
        np.arange(LOOKED_AT_COLUMNS) + 0.5
    ) / LOOKED_AT_COLUMNS * 15e-3 - 7.5e-3
    top_m = drawn_surface_m(lateral_m, dent_m)
    depth_m = (np.arange(LOOKED_AT_ROWS)[:, None] + 0.5) / LOOKED_AT_ROWS * 4e-3
    wall = (depth_m >= top_m) & (depth_m < top_m + 0.6e-3)

    return np.clip(rng.normal(np.where(wall, 2400.0, 600.0), 150.0), 0, 4095).astype(
        np.uint16
    )


def calibration_text(
    mean_mpa: Any = 0.27, eyes: Mapping[str, Any] | None = None, **keys: Any
) -> str:
    """Return the JSON text; `eyes` maps ids to changed values of an entry, `keys`
    replace the file's own.
    """
    usual = {
        "mean_mpa": mean_mpa,
        "sd_mpa": 0.005,
        "thickness_um": 700.0,
        "frames": [],
        "status": "ok",
    }
    content = {
        "format": 3,
        "mechanics": "finite-strain",
        "population": {"mean_mpa": mean_mpa, "sd_mpa": 0.03},
        "eyes": {name: {**usual, **entry} for name, entry in (eyes or {}).items()},
    }

    return json.dumps({**content, **keys})


def calibration_of_a_sealed_eye() -> Calibration:
    """E 0.3 ± 0.01 MPa, thickness 651 ± 12 µm and k 0.0312 ± 0.0012 mmHg^(1/3)/µl;
    forces 13 % high.
    """
    force = KnownForce(
        force_n=0.015,
        library_n=0.014,
        sd_n=2e-4,
        modulus_pa=0.3e6,
        rigidity=REFERENCE_RIGIDITY,
    )
    frames = tuple(
        FrameRecord(
            recording="mine",
            file=f"{n}.png",
            sha256=str(n),
            force_n=0.015 * n,
            mean_pa=0.3e6,
            sd_pa=1e4,
            own_modulus_pa=(0.2 + 0.05 * n) * 1e6,
            again=replace(force, force_n=0.015 * n, library_n=0.014 * n),
        )
        for n in (1, 2, 3)
    )
    eye = EyeCalibration(
        id="mine",
        names=(PARAMETERS["e"], PARAMETERS["thickness"], RIGIDITY),
        means=(0.3e6, 651e-6, 1.04 * REFERENCE_RIGIDITY),
        sds=(1e4, 12e-6, 0.04 * REFERENCE_RIGIDITY),
        bounds_n=(0.005, 0.03),
        stated_thickness_m=650e-6,
        globe=SEALED,
        recordings=(
            UsedRecording(path="mine", sha256="0" * 64, zero_n=0.0, drift_n_per_s=0.0),
        ),
        frames=frames,
        discrepancy=ForceDiscrepancy(
            level=0.02, growth=0.2, level_sd=0.02, growth_sd=0.04, correlation=0.0
        ),
    )

    return Calibration({"mine": eye}, "0" * 64, (0.005, 0.03), "finite-strain")


FORCES_N = (0.002, 0.012, 0.022, 0.036)
FORCE_TOML = '[force]\naxis = "fz"\ncontact_sign = -1'


def write_recording(path: Path, eye: str, gap_m: float = GAP_M, seed: int = 0) -> Path:
    """Four frames of the analytic wall under known forces, and one that shows
    nothing.
    """
    (path / "frames").mkdir(parents=True)
    (path / "recording.toml").write_text(recording_toml(eye, gap_m, more=FORCE_TOML))
    forces_n = (*FORCES_N, 0.010)
    images = [
        image(wall_section(tip_of(force_n)), seed + k)
        for k, force_n in enumerate(FORCES_N)
    ]
    images.append(np.full_like(images[0], 600))

    for number, pixels in enumerate(images):
        cv2.imwrite(str(path / "frames" / f"{number}.png"), pixels)

    lines = [
        "file,time_s",
        *(f"{number}.png,{5 + 6 * number}" for number in range(len(images))),
    ]
    (path / "frames.csv").write_text("\n".join(lines) + "\n")
    time_s = np.arange(0.0, 40.0, 0.01)
    log = np.zeros((len(time_s), 7))
    log[:, 0] = time_s
    log[:, 3] = 0.1 - sum(
        f * (np.abs(time_s - 5 - 6 * n) < 2.0) for n, f in enumerate(forces_n)
    )
    header = "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
    np.savetxt(
        path / "forces.csv", log, fmt="%.6f", delimiter=",", header=header, comments=""
    )

    return path


def calibration_of_mine(frames: Sequence[Mapping[str, str]] = ()) -> str:
    """Return the JSON text of an eye that was calibrated on frames."""
    mpa = MODULUS_PA / 1e6
    eye = {
        "mean_mpa": mpa,
        "sd_mpa": 0.01 * mpa,
        "thickness_um": THICKNESS_M * 1e6,
        "frames": frames,
    }
    population = {"mean_mpa": 1.1 * mpa, "sd_mpa": 0.05}
    return calibration_text(eyes={"mine": eye}, population=population)


def write_places(folder: Path) -> dict[str, Path]:
    """Write a model, calibrations and recordings of three eyes."""
    write_fixed_reader(folder / "model", analytic_frames.SMALL_LIBRARY, (0.125,) * 8)
    mine = write_recording(folder / "mine", "mine")
    used = [
        {"file": "1.png", "sha256": frame_digest(read_frame(mine / "frames" / "1.png"))}
    ]
    (folder / "calibration.json").write_text(calibration_of_mine(used))
    (folder / "linear.json").write_text(calibration_text(mechanics="linear"))

    return {
        "model": folder / "model",
        "calibration": folder / "calibration.json",
        "linear": folder / "linear.json",
        "mine": mine,
        "other": write_recording(folder / "other", "stranger", seed=100),
        "far": write_recording(folder / "far", "far", gap_m=1.5e-3),
    }


NOTEBOOK_STUDY = """
[library]
thicknesses = 4
tension = { min = 3e-3, max = 0.1 }
tensions = 4
tips = 24

[dataset]
contacts = 10

[[dataset.group]]
thickness_um = 600
images = 200
max_force_mn = 60

[network]
hidden = [20]
epochs = 2
"""


VIRTUAL_EYE = Setup(
    eye=Eye(
        "eye-a",
        thickness_m=THICKNESS_M,
        modulus=Modulus.stated(MODULUS_PA),
        iop_pa=IOP_PA,
    ),
    needle=Needle(gap_m=GAP_M, polar_rad=0.61),
)


def write_eye_and_reader(folder: Path) -> None:
    """Write study.toml, eye-a and reader."""
    (folder / "study.toml").write_text(NOTEBOOK_STUDY)
    write_pushes(folder / "eye-a", forces_mn=(10.0, 20.0, 40.0))
    write_fixed_reader(
        folder / "reader", analytic_frames.SMALL_LIBRARY, [0.0, 1.0] + [0.0] * 14
    )


def in_this_process(
    prepare: Callable[[], Callable[[int], Any]], units: Iterable[int], _workers: int
) -> Iterator[tuple[int, Any]]:
    """`work_units` without a process, which takes a second to start."""
    work = prepare()
    for unit in units:
        yield unit, work(unit)


def write_notebook_folder(folder: Path) -> None:
    """Write study.toml, eye-a, responses, dataset and reader; below `cache`, the
    library of the study for the user.
    """
    write_eye_and_reader(folder)
    write_stores(folder)


def write_stores(folder: Path) -> None:
    """Write responses, dataset and the user's library to a folder with study.toml."""
    study = read_study(folder / "study.toml")
    cache = folder / "cache" / "scleraforce" / "libraries"
    with pytest.MonkeyPatch.context() as patch:
        for module in (library_store, slice_dataset):
            patch.setattr(module, "work_units", in_this_process)
        library_store.cached_library(study, folder=cache, solve=solve_analytic)
        slice_dataset.generate_dataset(
            study, folder / "dataset", library=analytic_frames.LIBRARY
        )

    copytree(next(cache.glob("*.zarr")), folder / "responses")


# one push each, at random: rising, falling, near and far from another
PUSHES_MN = (3.0, 31.0, 12.0, 45.0, 20.0, 38.0, 8.0, 27.0, 50.0, 16.0, 42.0, 5.5)


def write_pushes(folder: Path, eye: str = "eye-a", forces_mn=PUSHES_MN, **more) -> Path:
    """Write an eye of the analytic library under these forces, with a log in which the
    needle pushes once for each frame; `more` are other values of the eye.
    """
    drawn = virtual_eyes.changed(VIRTUAL_EYE, name=eye, **more)
    plan = plan_phantom(drawn, tuple(1e-3 * f for f in forces_mn), Study(), seed=0)
    write_phantom(folder, plan, _sections, Study())
    return folder


def _sections(forces_n):
    return [
        wall_section(tip_of(force_n), surface_m=0.0, lateral_m=0.0)
        for force_n in forces_n
    ]
