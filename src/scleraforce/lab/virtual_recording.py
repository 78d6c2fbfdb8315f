"""The virtual laboratory: recording folders of virtual eyes, as a scanner and a force
sensor would write them.
"""

import json
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from math import cos, sin, sqrt
from pathlib import Path
from typing import Any
from zlib import crc32

import cv2
import numpy as np
import scipy

from scleraforce.base.arrays import Counts, Floats
from scleraforce.base.errors import RecordingError
from scleraforce.base.units import from_si
from scleraforce.base.version import __version__
from scleraforce.base.whole_files import folder_when_whole
from scleraforce.lab import needle_pushes, virtual_eye
from scleraforce.lab.drawn_bscan import (
    Bscan,
    DrawnShaft,
    draw_shaft,
    draw_track,
    render_bscan,
)
from scleraforce.lab.tissue_light import (
    BscanOptics,
    Pose,
    PressingNeedle,
    sample_conjunctiva,
    sample_needle,
    sample_optics,
)
from scleraforce.lab.virtual_eye import (
    BentSections,
    EyeTurn,
    LeakingSections,
    LinearSections,
    SectionsAt,
    TurnedSections,
    blended,
    check_number_of_eye,
    checked_virtual_eye,
    eye_name,
    scan_plane,
)
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane, WallSection
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.mechanics.uneven_form import thickness_factor
from scleraforce.recordings.recording_writer import RecordingWriter
from scleraforce.records.eye import Eye
from scleraforce.records.fields import NEEDLE_FORCE, declared
from scleraforce.records.globe import Globe
from scleraforce.records.motion import Motion
from scleraforce.records.needle import Needle, lean_ends
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.scan import Plane, Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, draw, study_hash

OPTICS, PUSHES, SENSOR, NOISE, FRAME, DRIFT = range(6)  # the streams of a recording
NEEDLE, CONJUNCTIVA, TURN, TISSUE, PUNCTURE, PLANES = range(6, 12)

# in which a living eye moves from one place to another: between pulse and breath
DRIFT_S = 1.0


def sample_scanner(setup: Setup, study: Study, seed: int) -> tuple[BscanOptics, Pose]:
    """Draw a recording's optics and pose; needle and conjunctiva, with streams of their
    own, change nothing else.
    """
    phantom = study.phantom
    gap_m = declared(setup.needle.gap_m, "needle: gap_m")
    rng = stream(setup, seed, OPTICS)
    scanner = replace(
        sample_optics(phantom, study.oct, rng),
        needle=sample_needle(
            phantom, study.needle.outer_diameter_m, gap_m, stream(setup, seed, NEEDLE)
        ),
        conjunctiva=sample_conjunctiva(phantom, stream(setup, seed, CONJUNCTIVA)),
    )
    surface_m = draw(phantom.surface_depth_m, rng)
    tilt_rad = draw(phantom.eye_tilt_rad, rng)

    return scanner, Pose(lateral_m=0.0, depth_m=surface_m, tilt_rad=tilt_rad)


def draw_changes(setup: Setup, study: Study, seed: int, times_s: Floats) -> Floats:
    """Draw (time, 4): shift across and in depth, signal over noise, reflection; they
    change smoothly in `DRIFT_S`.
    """
    rng = stream(setup, seed, DRIFT)
    phantom = study.phantom
    ranges = (
        phantom.eye_shift_m,
        phantom.eye_shift_m,
        phantom.snr_db,
        phantom.reflection_db,
    )
    knots = np.array(
        [
            [draw(values, rng) for values in ranges]
            for _ in range(int(times_s[-1] / DRIFT_S) + 2)
        ]
    )
    before = (times_s / DRIFT_S).astype(np.intp)
    share = (1.0 - np.cos(np.pi * (times_s / DRIFT_S - before)))[
        :, None
    ] / 2  # no value leaves the range of the draws
    changing: Floats = knots[before] + share * (knots[before + 1] - knots[before])

    return changing


def draw_relaxation(setup: Setup, study: Study, seed: int) -> PronySeries:
    """Draw how the eye's tissue relaxes."""
    rng = stream(setup, seed, TISSUE)
    terms = [
        (draw(share, rng), draw(time_s, rng))
        for share, time_s in study.tissue.relaxation
    ]

    return PronySeries(
        tuple(share for share, _ in terms), tuple(time_s for _, time_s in terms)
    )


def stream_key(setup: Setup, seed: int, *numbers: int) -> tuple[int, ...]:
    """Return the entropy of a stream: eyes of different names differ, also under one
    seed.
    """
    return seed, crc32(eye_name(setup).encode()), *numbers


def stream(setup: Setup, seed: int, *numbers: int) -> np.random.Generator:
    """Return the random stream of an eye with these numbers, its kind first."""
    return np.random.default_rng(stream_key(setup, seed, *numbers))


AXIS = "fz"
CONTACT_SIGN = -1
TAIL_S = 1.5  # of the log, after the needle's last motion
# average of a label: the force of a moving needle changes sooner
HELD_AVERAGE_S = 2.0
MOVING_AVERAGE_S = 0.1
TRAVEL_FORCES = 64  # at which a travel is known
# of a moving needle: 1,000 s at 100 frames a second, some 30 GB of pictures
MOST_FRAMES = 100_000
# time of a moving needle's first frame: a label needs force samples on both sides
FIRST_S = 0.1


@dataclass(frozen=True)
class Travel:
    """Of a needle that pierces: its tip's travel from rest, its length inside, the
    track's, the plane's gap from it.
    """

    travel_m: float
    inside_m: float
    track_m: float
    gap_m: float


@dataclass(frozen=True)
class PhantomFrame:
    """One frame: time, pose, optics, the key of its random numbers; push, turn,
    needle's travel and plane, if any.
    """

    file: str
    time_s: float
    pose: Pose
    optics: BscanOptics
    seed: tuple[int, ...]
    push: needle_pushes.Push | None = None
    turn: EyeTurn | None = None
    travel: Travel | None = None
    plane: Plane | None = None
    cut: ScanPlane | None = None  # where one of several planes is in the eye


@dataclass(frozen=True)
class PhantomPlan:
    """A virtual acquisition with everything drawn and nothing computed."""

    setup: Setup
    frames: tuple[PhantomFrame, ...]
    path: needle_pushes.NeedlePath
    sensor: needle_pushes.ForceSensor
    seed: int
    # of the force, in the mechanics, off the wall's normal; a drawn needle's normal
    # part presses
    tilt_rad: float = 0.0

    @property
    def forces_n(self) -> list[float]:
        """The true force on the needle at each frame's time, in N."""
        return self._at_frames(self.path.felt_n)

    @property
    def elastic_n(self) -> list[float]:
        """The elastic force at each frame's time, in N, whose dent the frame shows."""
        return self._at_frames(self.path.elastic_n)

    def _at_frames(self, force_n: Callable[[Floats], Floats]) -> list[float]:
        return [
            float(f"{one_n:.12g}")
            for one_n in force_n(np.array([frame.time_s for frame in self.frames]))
        ]

    @property
    def lean(self) -> tuple[float | None, float | None]:
        """The angle between needle and normal, and its direction in the plane; None:
        along the normal, not known.
        """
        needle = self.frames[0].optics.needle
        if needle is None or self.tilt_rad:
            return self.tilt_rad or None, None
        return needle.from_normal

    def normal_at(self, time_s: Floats) -> Floats:
        """Return the part of the elastic force that the wall's mechanics take, in N,
        shape of `time_s`.
        """
        return (
            1.0 if self.tilt_rad else cos(self.lean[0] or 0.0)
        ) * self.path.elastic_n(time_s)

    @property
    def normal_n(self) -> list[float]:
        """The same at each frame's time."""
        return self._at_frames(self.normal_at)

    @property
    def turns(self) -> list[EyeTurn]:
        """The eye's turn in each frame; empty if it keeps still."""
        return [frame.turn for frame in self.frames if frame.turn is not None]


def plan_phantom(
    setup: Setup, forces_n: Sequence[float], study: Study, seed: int
) -> PhantomPlan:
    """Draw an acquisition of pushes: scanner, sensor, place and tissue once; light,
    timing and shift in each frame.
    """
    checked_virtual_eye(setup)
    _check_forces(setup, forces_n)
    phantom = study.phantom
    scanner, place = sample_scanner(setup, study, seed)
    planned = needle_pushes.plan_pushes(
        tuple(forces_n), phantom, stream(setup, seed, PUSHES)
    )
    frames = []

    for index, push in enumerate(planned):
        rng = stream(setup, seed, FRAME, index)
        own = sample_optics(phantom, study.oct, rng)

        optics = replace(
            scanner,
            snr_db=own.snr_db,
            reflection_db=own.reflection_db,
            shadows=own.shadows,
        )
        if optics.conjunctiva is not None:
            # it has moved over the wall: its waves lie elsewhere
            phase_rad = float(
                stream(setup, seed, CONJUNCTIVA, index).uniform(-np.pi, np.pi)
            )
            optics = replace(
                optics, conjunctiva=replace(optics.conjunctiva, phase_rad=phase_rad)
            )

        shift_m = draw(phantom.eye_shift_m, rng)
        pose = Pose(
            lateral_m=draw(phantom.eye_shift_m, rng),
            depth_m=place.depth_m + shift_m,
            tilt_rad=place.tilt_rad,
        )
        key = stream_key(setup, seed, FRAME, index, 1)
        frames.append(
            PhantomFrame(f"{index + 1:04d}.png", push.frame_s, pose, optics, key, push)
        )

    return _with_turns(
        setup,
        frames,
        needle_pushes.path_of_pushes(planned, draw_relaxation(setup, study, seed)),
        study,
        seed,
    )


def plan_moving_phantom(
    setup: Setup,
    forces_n: Sequence[float],
    study: Study,
    seed: int,
    motion: Motion,
) -> PhantomPlan:
    """Draw a virtual acquisition of a needle that a robot moves while frames are taken
    at a steady rate.

    A needle that pierces does so after the forces, which may then be none. What
    `draw_changes` draws changes smoothly; all else is drawn once.
    """
    checked_virtual_eye(setup)
    rate_hz = motion.rate_hz
    ramp_n_per_s = motion.ramp_n_per_s
    hold_s = motion.hold_s
    puncture_n = motion.puncture_n
    _check_forces(setup, [*forces_n, *([] if puncture_n is None else [puncture_n])])
    if puncture_n is not None and not puncture_n > max(forces_n, default=0.0):
        raise RecordingError(
            f"eye {setup.eye.name}: puncture: {from_si(puncture_n, 'mn'):g} mN; must be"
            " above 0 and above the forces before it"
        )

    given = {
        "rate": (rate_hz, 0.1, 1000.0),
        "ramp": (ramp_n_per_s, 1e-5, 100.0),
        "hold": (hold_s, 0.0, 3600.0),
    }
    for name, (value, low, high) in given.items():
        if not low <= value <= high:
            raise RecordingError(
                f"eye {setup.eye.name}: {name}: {value:g} (SI); must be between"
                f" {low:g} and {high:g}"
            )

    scanner, place = sample_scanner(setup, study, seed)
    relaxation = draw_relaxation(setup, study, seed)
    rng = stream(setup, seed, PUSHES)
    path = needle_pushes.plan_path(
        tuple(forces_n), ramp_n_per_s, hold_s, study.phantom, relaxation, rng
    )

    if puncture_n is not None:
        path = needle_pushes.plan_puncture(
            path, puncture_n, ramp_n_per_s, hold_s, stream(setup, seed, PUNCTURE)
        )

    count = int((path.times_s[-1] - FIRST_S) * rate_hz + 1e-6) + 1
    if count > MOST_FRAMES:
        raise RecordingError(
            f"eye {setup.eye.name}: {count} frames; may have {MOST_FRAMES}: give a"
            " lower rate, a steeper ramp, shorter holds"
        )

    times_s = [
        round(FIRST_S + index / rate_hz, needle_pushes.TIME_DIGITS)
        for index in range(count)
    ]
    drift = draw_changes(setup, study, seed, np.array(times_s))
    digits = max(4, len(str(count)))
    frames = []

    for index, (lateral_m, shift_m, snr_db, reflection_db) in enumerate(drift.tolist()):
        pose = Pose(
            lateral_m=lateral_m,
            depth_m=place.depth_m + shift_m,
            tilt_rad=place.tilt_rad,
        )
        optics = replace(scanner, snr_db=snr_db, reflection_db=reflection_db)
        key = stream_key(setup, seed, FRAME, index, 1)
        frames.append(
            PhantomFrame(
                f"{index + 1:0{digits}d}.png", times_s[index], pose, optics, key
            )
        )

    return _with_turns(setup, frames, path, study, seed)


def in_planes(plan: PhantomPlan, planes: Sequence[Plane], study: Study) -> PhantomPlan:
    """Return a plan of frames in several planes at once, of a scanner whose axis passes
    the needle's at the eye's gap.

    The side is drawn; the eye shifts and tilts in two directions.
    """
    if (
        plan.turns
        or plan.path.puncture
        or study.mechanics.kind == "linear"
        or study.globe.leak_time_s
    ):
        raise RecordingError(
            "planes: of an eye that keeps still, does not leak and is not pierced, with"
            " `mechanics=finite-strain`"
        )

    setup = plan.setup
    scanned = scan_plane(setup)
    rng = stream(setup, plan.seed, PLANES)
    frames = list[PhantomFrame]()
    side_rad = rng.uniform(-np.pi, np.pi)
    tilt_rad = draw(study.phantom.eye_tilt_rad, rng)
    aside_m = scanned.gap_m * np.array([np.cos(side_rad), np.sin(side_rad)])

    for moment, force_n in zip(plan.frames, plan.forces_n, strict=True):
        contact_m = aside_m + np.array(
            [moment.pose.lateral_m, draw(study.phantom.eye_shift_m, rng)]
        )
        tilt = np.array([moment.pose.tilt_rad, tilt_rad])

        for number, plane in enumerate(planes):
            along = np.array([np.cos(plane.direction_rad), np.sin(plane.direction_rad)])
            across = np.array([-along[1], along[0]])
            gap_m = plane.offset_m - float(across @ contact_m)
            check_number_of_eye(setup, "gap_m", abs(gap_m))
            cut = replace(
                scanned,
                gap_m=gap_m,
                direction_rad=scanned.direction_rad + plane.direction_rad,
                tilt_rad=scanned.tilt_rad + float(across @ tilt),
            )
            pose = replace(
                moment.pose,
                lateral_m=float(along @ contact_m),
                tilt_rad=float(along @ tilt),
            )

            optics = moment.optics
            if optics.needle is not None:
                optics = replace(optics, needle=optics.needle.in_plane(along, gap_m))

            file = f"{Path(moment.file).stem}-{number + 1}.png"
            frame = replace(
                moment,
                file=file,
                pose=pose,
                optics=optics,
                seed=(*moment.seed, number),
                plane=plane,
            )
            frames.append(_pressed(replace(frame, cut=cut), abs(gap_m), force_n, study))

    return replace(plan, frames=tuple(frames))


def _check_forces(setup: Setup, forces_n: Sequence[float]) -> None:
    if not forces_n or not all(
        np.isfinite(force_n) and force_n >= 0.0 for force_n in forces_n
    ):
        raise RecordingError(
            f"eye {setup.eye.name}: forces: {list(forces_n)}; give at least one,"
            " none negative"
        )

    largest_mn = NEEDLE_FORCE.from_si(max(forces_n))
    if largest_mn > (NEEDLE_FORCE.high or 0.0):
        raise RecordingError(
            f"eye {setup.eye.name}: forces: {largest_mn:g} mN; up to"
            f" {NEEDLE_FORCE.high:g} mN can be simulated, more than a wall bears"
        )


def _with_turns(
    setup: Setup,
    frames: Sequence[PhantomFrame],
    path: needle_pushes.NeedlePath,
    study: Study,
    seed: int,
) -> PhantomPlan:
    """Return the plan of frames with a drawn sensor, and with the eye's turns unless it
    keeps still.
    """
    if virtual_eye.farthest_turn_rad(study.phantom) > 0.0:
        times_s = np.array([frame.time_s for frame in frames])
        turns = virtual_eye.draw_turns(
            study.phantom, times_s, stream(setup, seed, TURN)
        )
        frames = [
            replace(frame, turn=turn) for frame, turn in zip(frames, turns, strict=True)
        ]

    sensor = needle_pushes.sample_sensor(study.phantom, stream(setup, seed, SENSOR))
    gap_m = declared(setup.needle.gap_m, "needle: gap_m")
    plan = PhantomPlan(setup, tuple(frames), path, sensor, seed, study.needle.tilt_rad)
    pressed = (
        _pressed(frame, gap_m, force_n, study)
        for frame, force_n in zip(frames, plan.forces_n, strict=True)
    )

    return replace(plan, frames=tuple(pressed))


def _pressed(
    frame: PhantomFrame, gap_m: float, force_n: float, study: Study
) -> PhantomFrame:
    """Return a frame whose conjunctiva, if any, the needle compresses."""
    layer = frame.optics.conjunctiva
    radius_m = 0.5 * study.needle.outer_diameter_m
    if layer is None:
        return frame

    press = PressingNeedle(
        force_n=max(force_n, 0.0),
        radius_m=radius_m,
        gap_m=gap_m,
        lateral_m=frame.pose.lateral_m,
    )
    return replace(
        frame, optics=replace(frame.optics, conjunctiva=replace(layer, press=press))
    )


def needle_tip(frame: PhantomFrame, section: WallSection) -> Floats:
    """Return the needle's tip, at the section's surface: lateral from the middle, below
    the top edge, (2,), m.
    """
    nearest = int(np.abs(section.outer[:, 0]).argmin())
    return frame.pose.place_points(np.array([[0.0, section.outer[nearest, 1]]]))[0]


def plan_sections(
    plan: PhantomPlan, sections_at: SectionsAt
) -> tuple[Sequence[WallSection], Sequence[float]]:
    """Return the section in each frame of a plan, and the pressure, Pa.

    Raises:
        RecordingError: the eye turns and the sections cannot.
    """
    if plan.path.puncture is not None:
        return _pierced_sections(plan, sections_at)

    cuts = [frame.cut for frame in plan.frames if frame.cut is not None]
    if cuts:
        if not isinstance(sections_at, BentSections):
            raise RecordingError(
                f"eye {plan.setup.eye.name}: of several planes, and its sections are of"
                " one"
            )

        return sections_at.cut(plan.normal_n, cuts), sections_at.pressures_pa(
            plan.normal_n
        )
    if isinstance(sections_at, LeakingSections):
        return sections_at.along(
            plan.normal_at, [frame.time_s for frame in plan.frames]
        )

    found_pa = virtual_eye.pressures_pa(
        plan.setup, sections_at, plan.normal_n, plan.turns
    )
    if not plan.turns:
        return sections_at(plan.normal_n), found_pa
    if not isinstance(sections_at, TurnedSections):
        raise RecordingError(
            f"eye {plan.setup.eye.name}: it turns, and its sections have one contact"
        )

    return sections_at.turned(plan.normal_n, plan.turns), found_pa


def _pierced_sections(
    plan: PhantomPlan, sections_at: SectionsAt
) -> tuple[Sequence[WallSection], Sequence[float]]:
    """Return sections, in which friction pulls the wall outwards by the dent that it
    makes inwards, and pressures.
    """
    found = _still(plan, sections_at)
    pressed_n = np.abs(plan.normal_n).tolist()
    rest, *pressed = found([0.0, *pressed_n])
    # of the wall at rest, and under the opposite force
    mirrored = np.array([2.0, -1.0])

    return [
        blended([rest, section], mirrored) if normal_n < 0.0 else section
        for normal_n, section in zip(plan.normal_n, pressed, strict=True)
    ], virtual_eye.pressures_pa(plan.setup, found, pressed_n)


def _still(plan: PhantomPlan, sections_at: SectionsAt) -> LinearSections | BentSections:
    if isinstance(sections_at, LeakingSections) or not isinstance(
        sections_at, LinearSections | BentSections
    ):
        raise RecordingError(
            f"eye {plan.setup.eye.name}: puncture: of an eye that keeps still and does"
            " not leak"
        )

    return sections_at


def with_travel(plan: PhantomPlan, sections_at: SectionsAt) -> PhantomPlan:
    """Return a plan whose frames have the needle's travel if it pierces: beyond, it is
    as fast as just before.
    """
    puncture = plan.path.puncture
    if puncture is None:
        return plan

    gap_m = declared(plan.setup.needle.gap_m, "needle: gap_m")
    normal = 1.0 if plan.tilt_rad else cos(plan.lean[0] or 0.0)
    grid_n = np.linspace(0.0, puncture.force_n, TRAVEL_FORCES)
    grid_m = np.array(_still(plan, sections_at).travels_m((normal * grid_n).tolist()))
    slope = (grid_m[-1] - grid_m[-2]) / (grid_n[-1] - grid_n[-2])

    def travel_m(force_n: Floats) -> Floats:
        """Return the tip's travel, of a force below 0 as far outwards."""
        beyond_m = slope * np.maximum(np.abs(force_n) - puncture.force_n, 0.0)
        return np.asarray(
            np.sign(force_n) * (np.interp(np.abs(force_n), grid_n, grid_m) + beyond_m)
        )

    times_s = np.array([frame.time_s for frame in plan.frames])
    tip_m = travel_m(np.interp(times_s, puncture.driven_s, puncture.driven_n))
    inside = plan.path.pierced(times_s) & (times_s < puncture.out_s)
    length_m = np.where(
        inside, np.maximum(tip_m - travel_m(plan.path.elastic_n(times_s)), 0.0), 0.0
    )
    lengths_m = np.column_stack(
        [tip_m, length_m, np.maximum.accumulate(length_m)]
    ).tolist()
    travels = [
        Travel(travel_m, inside_m, track_m, gap_m)
        for travel_m, inside_m, track_m in lengths_m
    ]
    frames = (
        replace(frame, travel=travel)
        for frame, travel in zip(plan.frames, travels, strict=True)
    )

    return replace(plan, frames=tuple(frames))


# a frame of a plan, and the section under its force -> its counts (row, column)
FrameRenderer = Callable[[PhantomFrame, WallSection], Counts]


def render_frame(frame: PhantomFrame, section: WallSection, study: Study) -> Bscan:
    """Form one frame of a plan, from the section under its force, with the needle's
    shaft and track, if any.
    """
    needle = frame.optics.needle
    tip_m = needle_tip(frame, section)
    travel = frame.travel
    angle_rad = frame.pose.tilt_rad + (needle.angle_rad if needle else 0.0)
    shaft: DrawnShaft | None = None

    if needle is not None:
        inside_m = (travel.inside_m if travel else 0.0) * np.array(
            [-sin(angle_rad), cos(angle_rad)]
        )
        shaft = draw_shaft(needle, tip_m + inside_m, frame.pose.tilt_rad, study.oct)

    if travel is not None and travel.track_m:
        across_m2 = (0.5 * study.needle.outer_diameter_m) ** 2 - travel.gap_m**2
        # it closes behind the needle
        cut_m = sqrt(max(across_m2, 0.0)) if travel.inside_m else 0.0
        track = draw_track(tip_m, angle_rad, cut_m, travel.track_m, study.oct)
        shaft = track if shaft is None else shaft.over(track)

    return render_bscan(
        frame.pose.place(section),
        study.oct,
        frame.optics,
        np.random.default_rng(frame.seed),
        shaft,
    )


def write_phantom(
    out: Path,
    plan: PhantomPlan,
    sections_at: SectionsAt,
    study: Study,
    progress: Callable[[int], object] | None = None,
    *,
    tell_globe: bool = True,
    render: FrameRenderer | None = None,
) -> None:
    """Write a virtual acquisition as a recording folder with `truth.json`; equal plans
    give equal bytes. `render` forms the frames in place of the study's scanner.
    """
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise RecordingError(
            f"{out}: exists already; remove it or choose another folder"
        )

    comment = (
        f"A virtual acquisition, made by scleraforce {__version__}; truth.json has all"
        " its parameters."
    )
    plan = with_travel(plan, sections_at)
    info = _info(plan, study, tell_globe)
    more = tuple(_more_columns(plan.frames[0]))

    with (
        folder_when_whole(out) as part,
        closing(RecordingWriter(part, info, comment, more)) as writer,
    ):
        sections, found_pa = plan_sections(plan, sections_at)
        axis = ("fx", "fy", "fz").index(AXIS)
        noise = stream(plan.setup, plan.seed, NOISE)
        log = needle_pushes.sense(
            plan.path,
            plan.sensor,
            axis,
            CONTACT_SIGN,
            plan.path.times_s[-1] + TAIL_S,
            noise,
        )
        (part / "forces.csv").write_text(
            needle_pushes.format_log(log), encoding="utf-8"
        )
        truth = json.dumps(
            phantom_truth(plan, study, found_pa), indent=1, allow_nan=False
        )
        (part / "truth.json").write_text(truth + "\n", encoding="utf-8")

        for frame, section in zip(plan.frames, sections, strict=True):
            values = tuple(_more_columns(frame).values())
            pixels = (
                render_frame(frame, section, study).frame
                if render is None
                else render(frame, section)
            )
            writer.add(frame.file, frame.time_s, pixels, values)

            if progress is not None:
                progress(1)


def _more_columns(frame: PhantomFrame) -> dict[str, str]:
    """Return what frames.csv states of a frame beside its file and time."""
    if frame.plane is not None:
        return {"plane": frame.plane.name}
    return {} if frame.travel is None else {"travel_m": f"{frame.travel.travel_m:.6f}"}


def _info(plan: PhantomPlan, study: Study, tell_globe: bool) -> RecordingInfo:
    eye = plan.setup.eye
    needle = plan.setup.needle
    scan = plan.setup.scan
    globe = study.globe.kind if tell_globe else None
    leak_time_s = study.globe.leak_time_s if globe and study.globe.leak_time_s else None
    planes = tuple(
        dict.fromkeys(frame.plane for frame in plan.frames if frame.plane is not None)
    )
    average_s = MOVING_AVERAGE_S if plan.frames[0].push is None else HELD_AVERAGE_S

    return RecordingInfo(
        Eye(
            eye.name,
            thickness_m=eye.thickness_m,
            iop_pa=eye.iop_pa,
            globe=None
            if globe is None
            else Globe.declared(globe, leak_time_s=leak_time_s),
        ),
        Scan(
            **asdict(study.oct),
            direction_rad=scan.direction_rad or 0.0,
            tilt_rad=scan.tilt_rad,
            planes=planes,
        ),
        Needle(
            diameter_m=study.needle.outer_diameter_m,
            gap_m=None if planes else needle.gap_m,
            polar_rad=needle.polar_rad,
            lean_rad=lean_ends(plan.lean[0]),
            lean_azimuth_rad=plan.lean[1],
        ),
        ForceInfo(AXIS, CONTACT_SIGN, average_s),
    )


def phantom_truth(
    plan: PhantomPlan, study: Study, pressures_pa: Sequence[float]
) -> dict[str, Any]:
    """Return the content of `truth.json` for a plan and the computed pressures of its
    frames.
    """
    modules = {"numpy": np, "scipy": scipy, "opencv": cv2}
    versions = {
        "scleraforce": __version__,
        **{name: module.__version__ for name, module in modules.items()},
    }

    return {
        "simulated": True,
        "versions": versions,
        "study_hash": study_hash(study),
        "seed": plan.seed,
        "mechanics": asdict(study.mechanics),
        "tissue": {**asdict(study.tissue), "relaxation": plan.path.relaxation.terms},
        "globe": asdict(study.globe),
        "eye": _eye_truth(plan.setup),
        "form": {
            key: value for key, value in asdict(study.form).items() if value is not None
        },
        "thickness_at_contact_m": _thickness_at(
            plan.setup, scan_plane(plan.setup).contact, study
        ),
        "needle": {**asdict(study.needle), "lean_rad": plan.lean[0]},
        "sensor": asdict(plan.sensor),
        **(
            {}
            if plan.frames[0].push
            else {
                "path": {"times_s": plan.path.times_s, "forces_n": plan.path.forces_n}
            }
        ),
        **({"puncture": asdict(plan.path.puncture)} if plan.path.puncture else {}),
        "frames": [
            {
                "file": frame.file,
                "time_s": frame.time_s,
                "force_n": force_n,
                "elastic_force_n": elastic_n,
                "pressure_pa": pressure_pa,
                "target": study.classes.classify(force_n),
                **({"push": asdict(frame.push)} if frame.push else {}),
                "pose": asdict(frame.pose),
                **(
                    {"pierced": frame.time_s > plan.path.puncture.time_s}
                    if plan.path.puncture
                    else {}
                ),
                **({"needle": asdict(frame.travel)} if frame.travel else {}),
                **(
                    {"plane": frame.plane.name, "cut": asdict(frame.cut)}
                    if frame.plane and frame.cut
                    else {}
                ),
                **(
                    {"turn": _turn_truth(plan.setup, frame.turn, study)}
                    if frame.turn
                    else {}
                ),
                "optics": asdict(frame.optics),
                "seed": list(frame.seed),
            }
            for frame, force_n, elastic_n, pressure_pa in zip(
                plan.frames, plan.forces_n, plan.elastic_n, pressures_pa, strict=True
            )
        ],
    }


def _eye_truth(setup: Setup) -> dict[str, Any]:
    plane = scan_plane(setup)
    return {
        "id": setup.eye.name,
        "thickness_m": setup.eye.thickness_m,
        "youngs_modulus_pa": setup.eye.modulus_pa,
        "iop_pa": setup.eye.iop_pa,
        "gap_m": plane.gap_m,
        **asdict(plane.contact),
        "direction_rad": plane.direction_rad,
        "tilt_rad": plane.tilt_rad,
    }


def _turn_truth(setup: Setup, turn: EyeTurn, study: Study) -> dict[str, float]:
    contact = virtual_eye.turned_plane(scan_plane(setup), turn).contact
    return {
        **asdict(turn),
        **asdict(contact),
        "thickness_at_contact_m": _thickness_at(setup, contact, study),
    }


def _thickness_at(setup: Setup, contact: Contact, study: Study) -> float:
    thickness_m = declared(setup.eye.thickness_m, "eye: thickness_m")
    return thickness_m * float(thickness_factor(study.form, contact.normal))
