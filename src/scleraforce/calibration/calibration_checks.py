"""Calibrations that should not exist: what contradicts one, and its likely cause.

Before the fit of an eye, its frames are compared with what is stated: the log, the
thickness, and which way is down. After it, its frames are fitted with the eye that was
found, as a reader would, and the modulus is compared with the ranges of the readers.
What the frames show (`Appearance`) is kept in the calibration, so that a recording of
another eye with the same name is noticed.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import CalibrationError
from scleraforce.base.units import from_si
from scleraforce.calibration.calibration import Calibration
from scleraforce.calibration.found_walls import FoundWalls
from scleraforce.fit import unknowns
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.library import Library
from scleraforce.reading.frame_checks import no_wall_of_an_eye
from scleraforce.reading.trained_ranges import covers_modulus
from scleraforce.recordings import clock_offsets
from scleraforce.recordings.forces_under_frames import (
    UNRELATED,
    clock_doubts,
    contact_force,
    label_frames,
    labels_n,
)
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.calibration_file import (
    Appearance,
    CalibrationSummary,
    appearance_of,
    known_of_eye,
    other_eye,
)
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, parse_study, preset_toml
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import (
    dent_measures,
    segmented_boundaries,
    surface_places,
)

LOOKED_AT = 24  # moments of a recording, of many the evenly chosen ones
FITTED = 8  # of them
# Of the stated thickness: 0.94 to 1.07 is seen in virtual eyes of the figures' groups
# that no soft layer covers; an index of 1.38 makes 0.72 of it
THINNEST = 0.85
INDEX = (1.25, 1.5)  # a ratio of thicknesses between which an index explains
REFUSED = 0.5  # of the fitted frames, above which the eye is refused
SEEN = 0.5  # of the moments that show a wall, below which frames may be transposed
TURNED_FRAMES = 3  # that are looked at transposed
LABELLED = 0.5  # of the moments that must have a label

# minus the logarithm of the probability that unrelated dents fall with the force: 1 %
TURNED = 4.6

Walls = Mapping[int, Segmentation]  # by the number of the moment


def check_recording(
    recording: Recording,
    study: Study,
    found_walls: FoundWalls,
    with_forces: bool = True,
) -> None:
    """Raise a `CalibrationError` if a recording contradicts its frames.

    Its log fits them at other times, not at all, or upside down; most of its frames
    have no label; or the wall is much thinner than stated.
    """
    moments = recording.moments
    walls = seen_walls(recording, found_walls)
    place = recording.path
    _check_orientation(recording, walls)

    if recording.forces is not None and with_forces:
        label_frames(recording, study.classes)  # refuses a wrong sign or unit
        _check_labels(recording)
        _check_dents(recording, walls, study)

    stated_m = recording.info.eye.thickness_m
    shown_m = _thickness_m(walls)
    if stated_m and shown_m < THINNEST * stated_m:
        um = from_si(shown_m, "um"), from_si(stated_m, "um")
        index = recording.info.scan.refractive_index or 1.0
        between = INDEX[0] < stated_m / shown_m < INDEX[1]
        cause = (
            f"oct.refractive_index is {index:g}: is the depth corrected already? Then"
            " it is 1"
            if index > 1.0 and between
            else "check oct.depth_m, oct.refractive_index and eye.thickness_m"
        )
        raise CalibrationError(
            f"{place / 'recording.toml'}: eye.thickness_m: {um[1]:.0f} µm, but"
            f" {len(moments)} frames show a wall of {um[0]:.0f} µm; {cause}"
        )


def _check_orientation(recording: Recording, walls: Walls) -> None:
    """Raise a `CalibrationError` if hardly a wall is seen in frames as they are, and
    one in frames that are transposed.
    """
    if sum(wall.usable for wall in walls.values()) >= SEEN * len(walls):
        return

    scan = recording.info.scan
    scale = replace(scan, rows=scan.columns, columns=scan.rows).scale
    places = [*walls][:: max(1, len(walls) // TURNED_FRAMES)][:TURNED_FRAMES]
    entries = [recording.moments[place][0] for place in places]
    found = [find_wall(recording.frame(entry).T.copy(), scale) for entry in entries]
    if all(wall.usable for wall in found):
        raise CalibrationError(
            f"{recording.path}: hardly a wall is seen, but one where rows and columns"
            " of the frames are exchanged: they are transposed; import them with"
            " `axes=frame,lateral,depth`"
        )


def _check_labels(recording: Recording) -> None:
    log = recording.forces
    labels = labels_n(recording)
    known = [isinstance(label, float) for label in labels]
    if log is None or sum(known) >= LABELLED * len(known) or not any(known):
        return

    first_s, last_s = (recording.frames[place].time_s for place in (0, -1))
    raise CalibrationError(
        f"{recording.path / 'forces.csv'}: {len(known) - sum(known)} of"
        f" {len(known)} frames have no label: forces from {log.time_s[0]:g} to"
        f" {log.time_s[-1]:g} s, frames from {first_s:g} to {last_s:g} s; give the"
        " whole log, mend the clocks (import `clock_offset_s=auto`), or import the"
        " frames that it covers"
    )


def _check_dents(recording: Recording, walls: Walls, study: Study) -> None:
    log = recording.forces
    info = recording.info.force
    assert log is not None
    assert info is not None
    first = replace(recording, frames=tuple(each[0] for each in recording.moments))
    scale = recording.info.scan.scale
    dents = np.full((2, len(first.frames)), np.nan)
    for index, wall in walls.items():
        if wall.usable:
            dents[:, index] = dent_measures(*surface_places(wall, scale))

    times_s = np.array([frame.time_s for frame in first.frames])
    given = log.time_s, contact_force(log, info)
    doubts = clock_doubts(first, study.classes, dents)
    turned = clock_offsets.relation(times_s, -dents, *given)
    if doubts and UNRELATED in doubts[0].words and (turned or 0.0) >= TURNED:
        raise CalibrationError(
            f"{recording.path}: the surface rises where the needle pushes it down: the"
            " frames are upside down (import `flip=rows`)"
        )
    if doubts:
        raise CalibrationError(
            f"{recording.path}: labels contradict the dents: {doubts[0]}"
        )


def seen_walls(recording: Recording, walls: FoundWalls) -> Walls:
    """Return the walls of the first frames of evenly chosen moments."""
    moments = recording.moments
    count = min(len(moments), LOOKED_AT)
    found = dict[int, Segmentation]()

    for index in np.linspace(0, len(moments) - 1, count).astype(np.intp).tolist():
        entry = moments[index][0]
        found[index] = walls.of_frame(recording, entry, recording.frame(entry))

    return found


def _thicknesses_m(walls: Walls) -> Floats:
    each = walls.values()
    return np.array([w.thickness_m for w in each if w.usable and w.inner_found])


def _thickness_m(walls: Walls) -> float:
    found = _thicknesses_m(walls)
    found = found[np.isfinite(found)]
    return float(np.median(found)) if len(found) else np.inf


def checked_calibration(
    calibration: Calibration,
    summary: CalibrationSummary,
    recordings: Sequence[Recording],
    study: Study,
    library: Library,
    found_walls: FoundWalls,
    advance: Callable[[int], object] = lambda _: None,
) -> Calibration:
    """Return a calibration with what each eye's frames show; raise a `CalibrationError`
    if a reader would refuse them, or the modulus.
    """
    eyes = dict(calibration.eyes)
    for recording in recordings:
        name = recording.info.eye_name
        eye = eyes[name]
        known = known_of_eye(recording.info.setup, summary, name)
        _check_modulus(recording, known, study)
        shown = _appearance(recording, known, study, library, found_walls)
        if eye.appearance is not None and shown is not None:
            other = other_eye(eye.appearance, shown)
            if other:
                raise CalibrationError(
                    f"{recording.path}: eye.id: {name}: {other}, in another recording"
                    " of that name; are both of one eye?"
                )
        eyes[name] = eye.with_appearance(eye.appearance or shown)
        advance(1)

    return replace(calibration, eyes=eyes)


def _check_modulus(recording: Recording, setup: Setup, study: Study) -> None:
    living = parse_study(preset_toml("living")).reader
    modulus = setup.eye.modulus
    if modulus is None or covers_modulus(setup, study.reader, any_pressure=True):
        return
    if covers_modulus(setup, living):
        return

    low, high = (from_si(end, "mpa") for end in study.reader.youngs_modulus_pa.bounds)
    raise CalibrationError(
        f"{recording.path}: Young's modulus would be"
        f" {from_si(modulus.mean_pa, 'mpa'):.3g} MPa, which no reader of such eyes"
        f" takes ({low:g} to {high:g} MPa): check the clocks (import"
        " `clock_offset_s=auto`), the unit and sign of the force, eye.thickness_m,"
        " oct.width_m and oct.depth_m"
    )


def _appearance(
    recording: Recording,
    setup: Setup,
    study: Study,
    library: Library,
    found_walls: FoundWalls,
) -> Appearance | None:
    """Return what frames show beside the eye that was found; raise a `CalibrationError`
    if a reader would refuse most of them.
    """
    scale = recording.info.scan.scale
    usable = [w for w in seen_walls(recording, found_walls).values() if w.usable]
    if not usable or recording.info.scan.planes:
        return None

    walls = library.for_stiffening(setup.eye.stiffening or 0.0)
    near = walls.nearest_contact(setup.needle.polar_rad)
    prior = prior_of(setup, study.reader, study.eye.radius_m)
    smoothing_m = study.calibration.surface_smoothing_m
    reasons = list[str]()
    sizes = list[float]()
    places = np.linspace(0, len(usable) - 1, min(FITTED, len(usable))).astype(np.intp)

    for wall in (usable[place] for place in places.tolist()):
        seen = segmented_boundaries(wall, scale)
        fit = fit_boundaries(near, seen.lateral_m, seen.depth_m, prior, smoothing_m)
        if fit is None:
            continue
        reason = no_wall_of_an_eye(fit, prior)
        if reason:
            reasons.append(reason)
        else:
            sizes.append(float(np.exp(fit.unknown[unknowns.SIZE])))

    if len(reasons) > REFUSED * len(places):
        raise CalibrationError(
            f"{recording.path}: a reader would refuse {len(reasons)} of {len(places)}"
            f" frames with this calibration: {_usual(reasons)}; {_cause(reasons)}"
        )

    return appearance_of(_thicknesses_m(dict(enumerate(usable))).tolist(), sizes)


# of the reader's reasons, in words that they hold: what usually is wrong then
CAUSES = {
    "curvature": (
        "the scale or the eye's size is wrong: check oct.width_m and oct.depth_m, and"
        " that the frames are not transposed (import `axes`)"
    ),
    "thick, not": (
        "check oct.refractive_index (1 if the scanner has corrected the depth, about"
        " 1.38 if not), oct.depth_m and eye.thickness_m"
    ),
    "": (
        "are the frames upside down or mirrored (import `flip`), transposed (import"
        " `axes`), or of another width (oct.width_m)?"
    ),
}


def _usual(reasons: Sequence[str]) -> str:
    return Counter(reasons).most_common(1)[0][0]


def _cause(reasons: Sequence[str]) -> str:
    kinds = [next(word for word in CAUSES if word in reason) for reason in reasons]
    return CAUSES[Counter(kinds).most_common(1)[0][0]]
