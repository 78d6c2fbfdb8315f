"""Forces, intervals, classes and reasons of the same frames through each door;
`evaluate` is the reference.
"""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import scleraforce as sf
from golden.answers import Answers, Record, plain
from golden.groups.calibrations import calibration_file
from golden.inputs import PRESSURES, frame_files
from golden.monitor_door import SCLERAFORCE, MonitorRefusedError, monitor_readings

MODEL = "default"
UNCALIBRATED = " uncalibrated"  # read with no calibration: E is not known
# and the shared; frames of `PRESSURES` have no force log to calibrate on
UNCALIBRATED_OF = ("plain", "sealed", "damaged", "relaxing", "leaking", PRESSURES)
CLASSIFIER = " by the classifier"  # the paper's model
CLASSIFIER_OF = ("plain",)
PLACES = ("contact_mm", "contact_depth_mm", "dent_mm", "gap_mm", "lean_deg")


def answers(name: str, recordings: dict[str, Path], folder: Path) -> Answers:
    """Return the answers to a recording's frames through each door."""
    eye = name.removesuffix(UNCALIBRATED).removesuffix(CLASSIFIER)
    recording = recordings[eye]
    if name.endswith(CLASSIFIER):
        return _command_doors(name, recording, None, "paper")

    calibration = None
    if not name.endswith(UNCALIBRATED):
        calibration = calibration_file(eye, recording, folder)
    found = _command_doors(name, recording, calibration, MODEL)
    found |= _python_door(name, recording, calibration)
    if not _relaxes(calibration):
        place = folder / f"monitor-of-{name.replace(' ', '-')}"
        place.mkdir()
        found |= _monitor_doors(name, recording, calibration, place)
    return found


def _relaxes(calibration: Path | None) -> bool:
    """Return whether a calibration found a tissue that relaxes, or may relax.

    A monitor's readings of such an eye depend on the time between frames, which is the
    machine's.
    """
    if calibration is None:
        return False
    eyes = json.loads(calibration.read_text(encoding="utf-8"))["eyes"].values()
    relaxations = [eye["relaxation"] or {} for eye in eyes]
    return any(
        any(relaxation.get(explanation, ()))
        for relaxation in relaxations
        for explanation in ("shares", "other")
    )


def _command_doors(
    name: str, recording: Path, calibration: Path | None, model: str
) -> Answers:
    """Return the answers of `scleraforce evaluate` and `scleraforce read`."""
    eye = sf.read_recording(recording).info.eye_name
    given = [] if calibration is None else ["--calibration", str(calibration)]
    evaluated = _command("evaluate", model, str(recording), *given)
    files = [str(file) for file in frame_files(recording)]
    named = [] if calibration is None else ["--eye", eye]
    read = _command("read", model, *files, *given, *named)
    found = {
        f"{name}/{frame['file']}/evaluate": _scored(frame)
        for frame in evaluated["frames"]
    }
    found |= {
        f"{name}/{Path(frame['file']).name}/read": _answer(frame)
        for frame in read["frames"]
    }
    found[f"{name}/metrics"] = _metrics(evaluated)
    return found


def _python_door(name: str, recording: Path, calibration: Path | None) -> Answers:
    """Return the answers of `sf.read` to the moments of a recording, in their order."""
    opened = sf.read_recording(recording)
    eye = None if calibration is None else opened.info.eye_name
    moments = [
        sf.Moment(tuple(sf.Frame(opened.frame_path(entry)) for entry in entries))
        for entries in opened.moments
    ]
    answers = sf.read(sf.load_model(MODEL), moments, calibration=calibration, eye=eye)
    files = [entries[0].file for entries in opened.moments]
    return {
        f"{name}/{file}/sf.read": _answer(answer.to_dict())
        for file, answer in zip(files, answers, strict=True)
    }


def _monitor_doors(
    name: str, recording: Path, calibration: Path | None, folder: Path
) -> Answers:
    """Return what the monitor's network and its second opinion read."""
    try:
        readings = monitor_readings(recording, calibration, folder, MODEL)
    except MonitorRefusedError as refusal:
        return {f"{name}/refusal of the monitor": {"words": str(refusal)}}
    names = [file.name for file in frame_files(recording)]
    network = {
        f"{name}/{file}/monitor": _verdict(
            {**entry, "class": entry["class"]}, entry["force_mn"], entry["interval_mn"]
        )
        for file, entry in zip(names, readings.network, strict=True)
    }
    opinions = {}
    for file, given in zip(names, readings.opinions, strict=True):
        verdict = given["verdict"]
        force_n, interval_n = verdict.get("force_n"), verdict.get("interval_n")
        opinions[f"{name}/{file}/second opinion"] = _verdict(
            {**verdict, "class": verdict["predicted"]},
            None if force_n is None else 1e3 * force_n,
            None if interval_n is None else [1e3 * end for end in interval_n],
        )
    return network | opinions


def _answer(frame: Mapping[str, Any]) -> Record:
    """Return what an answer of `evaluate` or `read` says, all but its units' twins."""
    needle = frame["needle"] or {}
    record = _verdict(
        {**frame, "class": frame["predicted"]},
        frame["predicted_force_mn"],
        frame["interval_mn"],
    )
    more = {name: frame[name] for name in PLACES}
    more |= {
        "elastic_force_mn": frame["elastic_force_mn"],
        "time_to_bound_ms": frame["time_to_bound_ms"],
        "pressure_pa": frame["pressure_pa"],
        "needle_deg": needle.get("angle_deg"),
        "conjunctiva_um": frame["conjunctiva_um"],
        "contact_xyz_mm": frame["contact_xyz_mm"],
        "wall": frame["wall"],
        "can_calibrate": frame["can_calibrate"],
        "warnings": frame["warnings"],
    }
    return record | {name: plain(value) for name, value in more.items()}


def _scored(frame: Mapping[str, Any]) -> Record:
    """Return an answer of `evaluate` with its label."""
    label = {
        "measured_force_mn": frame["measured_force_mn"],
        "measured_force_sd_mn": frame["measured_force_sd_mn"],
        "target": frame["target"],
        "calibration": frame["calibration"],
        "excluded": frame["excluded"],
        "used_mpa": frame["youngs_modulus_mpa"],
        "modulus_source": frame["modulus_source"],
    }
    return _answer(frame) | {name: plain(value) for name, value in label.items()}


def _verdict(said: Mapping[str, Any], force_mn: Any, interval_mn: Any) -> Record:
    record = {
        "class": said["class"],
        "usable": said["usable"],
        "reason": said["reason"],
        "force_mn": force_mn,
        "interval_mn": interval_mn,
        "class_share": said["probabilities"],
    }
    return {name: plain(value) for name, value in record.items()}


def _metrics(evaluated: Mapping[str, Any]) -> Record:
    record = {
        "accuracy_share": evaluated["accuracy"],
        "confusion": evaluated["confusion"],
        "error_mn": evaluated.get("mae_mn"),
        "coverage_share": evaluated.get("coverage"),
        "notes": evaluated.get("notes"),
    }
    return {name: plain(value) for name, value in record.items()}


def _command(*words: str) -> dict[str, Any]:
    """Return what a command prints with `--json`."""
    done = subprocess.run(
        [SCLERAFORCE, *words, "--json"], capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        print(done.stderr, file=sys.stderr)
        raise RuntimeError(f"scleraforce {words[0]}: exit code {done.returncode}")
    printed: dict[str, Any] = json.loads(done.stdout)
    return printed
