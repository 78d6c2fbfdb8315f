"""Fingerprint of the code that decides the pages' figures (`provenance.fingerprint`),
at small size.

The bundled models' fingerprints, and an eye of each group of `make figures`, computed
on a coarse mesh, imaged, and read by the bundled reader. `behaviour.json` has the
fingerprint of each run whose figures are in a page.
"""

import json
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from figures.declared import declare
from figures.folder import FiguresFolder
from figures.groups import GROUPS, draw_eyes
from figures.recordings import make_eye, read_made
from provenance.fingerprint import (
    PIXELS,
    SAME,
    Fingerprint,
    Tolerance,
    item,
    moved,
)
from provenance.stamps import Stamp
from scleraforce.base.whole_files import write_whole
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.evaluation import evaluate_recordings
from scleraforce.library import load_library
from scleraforce.reading.load_model import load_reader
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.model_folder import (
    LIBRARY_FILE,
    NETWORK_FILE,
    SHIPPED,
    SHIPPED_READER,
    read_folder,
)
from scleraforce.records.study import Study, study_hash

KEPT = Path(__file__).with_name("behaviour.json")
SHARES = (0.2, 0.6)  # forces on an eye's frames, of the largest force
# Relative to the largest: the pages state figures to three digits, which is less than
# an interval allows. Other processors move the results of fits by 2e-4.
FIGURES = Tolerance(of_largest=3e-3)
# Commands whose figures only some entries decide, by the beginning of their names; no
# entry decides a speed.
DECIDED_BY: dict[str, tuple[str, ...]] = {
    "make bench": (),
    "make reproduce": (*SHIPPED, "plain eye"),
    "python -m figures real-tissue": ("default",),
    "scleraforce train DATASET --search": ("paper",),
}


def behaviour() -> Fingerprint:
    """Return today's fingerprint, in less than a minute; default tests hold the models'
    entries to today's code.
    """
    found: Fingerprint = {}
    for model, path in SHIPPED.items():
        folder = read_folder(path)
        found |= {
            f"{model} {name}": entry
            for name, entry in folder.record["fingerprint"].items()
        }
        found[f"{model} network"] = item(
            int(sha256(folder.files[NETWORK_FILE]).hexdigest()[:7], 16), SAME
        )

    return found | _eyes()


def keep(stamp: Stamp, now: Fingerprint) -> None:
    """Note the fingerprint of a run whose figures are in a page."""
    kept = {
        **_kept(),
        stamp.made_by: {"commit": stamp.commit, "fingerprint": _deciding(stamp, now)},
    }
    write_whole(json.dumps(kept, indent=1, sort_keys=True) + "\n", KEPT)


def moved_since(stamp: Stamp, now: Fingerprint) -> list[str] | None:
    """Return the names of the entries that have moved since figures were made; None if
    no fingerprint was kept.
    """
    entry = _kept().get(stamp.made_by)
    if entry is None or entry["commit"] != stamp.commit:
        return None
    return moved(entry["fingerprint"], _deciding(stamp, now))


def _deciding(stamp: Stamp, now: Fingerprint) -> Fingerprint:
    begin = DECIDED_BY.get(stamp.made_by, ("",))
    return {name: entry for name, entry in now.items() if name.startswith(begin)}


def _kept() -> dict[str, Any]:
    kept: dict[str, Any] = (
        json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    )
    return kept


def _eyes() -> Fingerprint:
    """Return entries of the eyes of all groups: computed, imaged, read; a plain one is
    calibrated as well.
    """
    found: Fingerprint = {}
    with TemporaryDirectory() as place:
        for group in GROUPS:
            found |= _eye(FiguresFolder(Path(place)), group)
    return found


def _eye(folder: FiguresFolder, group: str) -> Fingerprint:
    study = Study(oct=replace(Study().oct, columns=128, rows=96))
    drawn = draw_eyes(group, 1, study)[0]
    mesh = replace(drawn.study.mesh, core=4, rings=8)
    drawn = replace(drawn, study=replace(drawn.study, mesh=mesh), shares=SHARES)
    make_eye(folder, drawn)
    made = read_made(folder, drawn)
    path = declare(folder, [drawn]).recording(drawn)
    recording = read_recording(path)
    answers = evaluate_recordings(load_reader("default"), [path]).frames
    forces_n = [
        [
            value
            for value in (frame.answer.force_n, *(frame.answer.interval_n or ()))
            if value
        ]
        for frame in answers
    ]
    entries = {
        "forces": item([made.forces_n, made.tips_m, made.lowest_m.T[0]], FIGURES),
        "frames": item([recording.frame(entry) for entry in recording.frames], PIXELS),
        "answers": item(np.concatenate(forces_n), FIGURES),
    }

    if group == "plain":
        eye = calibrate_recordings(
            [recording],
            study,
            study_hash(study),
            load_library(SHIPPED_READER / LIBRARY_FILE),
        )
        entries["calibration"] = item(
            [value for one in eye.eyes.values() for value in (*one.means, *one.sds)],
            FIGURES,
        )

    return {f"{group} eye: {name}": entry for name, entry in entries.items()}
