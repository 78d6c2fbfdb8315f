"""What a recording is written from: what its sources state, what was told, and what was asked for."""

from dataclasses import dataclass, replace
from math import radians
from typing import TYPE_CHECKING, Any

import numpy as np

from scleraforce.errors import InputError, StudyError
from scleraforce.formats.frame_times import told_times
from scleraforce.formats.gather import Gathered, check_overlap, on_one_clock
from scleraforce.formats.greys import MOST_BITS, Greys
from scleraforce.formats.importing.questions import QUESTIONS, Asker
from scleraforce.formats.importing.told import OPTION, ImportAnswers
from scleraforce.recording.info import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo
from scleraforce.recording.pixels import Sourced
from scleraforce.recording.scan import Scan, Times
from scleraforce.units import from_si, to_si

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from scleraforce.recording.tables import ForceLog

# What options act on: their names by those of their values.
ACT_ON = {
    "a force log": {
        "axis": "--axis", "contact_sign": "--contact-sign", "average_s": "--average-s",
        "clock_offset_s": "--clock-offset-s",
    },
    "a force log of text": {"columns": "--column"},
    "a ROS bag": {"image_topic": "--image-topic", "force_topic": "--force-topic", "by_arrival": "--by-arrival"},
    "an .npz file": {"array": "--array"},
    "frames whose axes are not fixed": {"axes": "--axes"},
}  # fmt: skip
SAME_SCALE = 0.001  # scales that differ by less are rounded
ANSWER = "answer"  # the source of a value that was typed on the terminal


@dataclass(frozen=True, eq=False)
class Complete:
    """All that a recording is written from.

    Attributes:
        gathered: what the sources hold.
        times: of the frames, on the clock of the log.
        log: on the same clock.
        origin_s: where that clock begins, on the sources' own.
        info: what recording.toml says.
        sources: who states each value, by the name of its option.
    """

    gathered: Gathered
    times: Times
    log: "ForceLog | None"
    origin_s: float
    info: RecordingInfo
    sources: dict[str, str]

    def with_notes(self, notes: "Sequence[str]") -> "Complete":
        """Return the same with further notes."""
        return replace(self, gathered=replace(self.gathered, notes=(*self.gathered.notes, *notes)))


def complete(
    gathered: Gathered,
    greys: Greys,
    answers: ImportAnswers,
    origins: "Mapping[str, str]",
    asker: Asker,
    measured: "Callable[[OctInfo], float | None]",
) -> Complete:
    """Bring together what was told, what sources state and what another recording has, and ask for the rest.

    Args:
        gathered: the sources.
        greys: how their pixels become counts.
        answers: what was told.
        origins: who told it, by the names of the answers; another recording gives way to what the sources state.
        asker: who is asked.
        measured: returns the wall's thickness as the frames show it, um, at the scale of the recording.

    Raises:
        InputError: something stays open, an option has nothing to act on, or a value is none that a recording may have.
    """
    _check_used(gathered, origins)
    times = told_times(gathered.scan, answers.times, answers.rate_hz) or gathered.scan.times
    needed = _needed(gathered, answers, times)
    stated = _stated(gathered, greys)
    known = {
        name: (value, origins.get(name, ANSWER))
        for name in needed
        if (value := getattr(answers, name)) is not None and (name not in stated or origins.get(name) == OPTION)
    }
    known = stated | known
    _check_contradictions(gathered.scan, needed - set(known))
    questions = {name: question for name, question in QUESTIONS.items() if name in needed - set(known)}
    if "bits" in questions:
        few = f"pixels are up to {greys.high - greys.low:g}, which needs more bits"
        questions["bits"] = replace(questions["bits"], fault=lambda bits: None if greys.fit(bits) else few)
    while True:
        answered = {name: (value, ANSWER) for name, value in asker.missing(questions).items()}
        try:
            done = _completed(gathered, greys, answers, times, stated, known | answered)
            break
        except InputError as fault:
            if not questions:
                raise
            asker.again(fault)
    return _with_thickness(done, answers, origins, asker, measured)


def _with_thickness(
    done: Complete,
    answers: ImportAnswers,
    origins: "Mapping[str, str]",
    asker: Asker,
    measured: "Callable[[OctInfo], float | None]",
) -> Complete:
    """Ask for the wall's thickness where nobody has told it; say what it costs where it stays open."""
    name, value = "thickness_um", answers.thickness_um
    if value is not None:
        return replace(done, sources=done.sources | {name: origins.get(name, ANSWER)})
    found: list[float | None] = []

    def offered() -> float | None:
        found.append(measured(done.info.oct))
        return found[-1]

    value = asker.missing({name: replace(QUESTIONS[name], offered=offered)}).get(name)
    if value is None:
        note = "the wall's thickness is not stated: `calibrate` needs it, and readings are less sure (--thickness-um)"
        return done.with_notes([note])
    info = replace(done.info, eye=replace(done.info.eye, thickness_m=to_si(value, "um")))
    source = "measured on the first frames" if value in found else ANSWER
    return replace(done, info=info, sources=done.sources | {name: source})


def _completed(
    gathered: Gathered,
    greys: Greys,
    answers: ImportAnswers,
    times: Times | None,
    stated: dict[str, tuple[Any, str]],
    known: dict[str, tuple[Any, str]],
) -> Complete:
    """Bring together what is known, each value with who states it.

    Raises:
        InputError: a value is none that a recording may have, or does not go with the others.
    """
    values = {name: value for name, (value, _) in known.items()}
    info = _info(gathered, answers, values)
    if not greys.fit(info.oct.bits):
        raise InputError(f"{gathered.scan.names[0]}: pixels up to {greys.high:g}; --bits says {info.oct.bits}")
    if times is None:
        rate_hz = values.get("rate_hz")
        times = told_times(gathered.scan, None, rate_hz) if rate_hz else Times(np.zeros(1), "a single frame")
    assert times is not None
    if "rate_hz" in known:
        times = replace(times, source=known["rate_hz"][1])
    offset_s = values.get("clock_offset_s", answers.clock_offset_s or 0.0)
    moved, log, origin_s = on_one_clock(times, gathered.log, offset_s)
    check_overlap(moved, log)
    sources = {name: known[name][1] for name in QUESTIONS if name in known} | {"times": times.source}
    scan = gathered.scan
    faults = [fault for fault in (scan.scale_fault, scan.times_fault) if fault]
    doubts = (*faults, *_other_scales(stated, known), *_outside(moved, log))
    return Complete(gathered, moved, log, origin_s, info, sources).with_notes(doubts)


def _check_used(gathered: Gathered, origins: "Mapping[str, str]") -> None:
    """Check that each option that was given has something to act on; those of another recording need not.

    Raises:
        InputError: one has nothing.
    """
    kinds = {kind for _, kind in gathered.files}
    there = {
        "a force log": gathered.log is not None,
        "a force log of text": "log" in kinds,
        "a ROS bag": "bag" in kinds,
        "an .npz file": any(path.suffix.lower() == ".npz" for path, _ in gathered.files),
        "frames whose axes are not fixed": bool(kinds - {"thorlabs", "log"}),
    }
    for what, options in ACT_ON.items():
        unused = [option for name, option in options.items() if origins.get(name) == OPTION and not there[what]]
        if unused:
            raise InputError(f"{unused[0]}: acts on {what}, which is not among the sources; leave it out")


def _check_contradictions(scan: Scan, missing: set[str]) -> None:
    """Check that options give what the source contradicts itself in.

    Raises:
        InputError: they do not.
    """
    for fault, options in ((scan.scale_fault, ("width_mm", "depth_mm")), (scan.times_fault, ("rate_hz",))):
        if fault and missing.intersection(options):
            named = " and ".join(f"--{name.replace('_', '-')}" for name in options)
            raise InputError(f"{fault}; give {named}")


def _needed(gathered: Gathered, answers: ImportAnswers, times: Times | None) -> set[str]:
    """Return the names of the options whose values this recording takes."""
    needed = {"width_mm", "depth_mm", "refractive_index", "bits", "eye", "gauge", "gap_mm"}
    if times is None and len(gathered.scan.names) > 1:
        needed.add("rate_hz")
    if gathered.log is not None:
        needed |= {"axis", "contact_sign"}
        by_bag = gathered.one_clock and answers.rate_hz is None
        if not by_bag and answers.times is None:
            needed.add("clock_offset_s")
    return needed


def _stated(gathered: Gathered, greys: Greys) -> dict[str, tuple[Any, str]]:
    """Return what the sources themselves state, and where it stands."""
    scan, log = gathered.scan, gathered.log
    found: dict[str, tuple[Any, str]] = {}
    extents = {"width_mm": (scan.lateral_pixel_m, scan.columns), "depth_mm": (scan.depth_pixel_m, scan.rows)}
    for name, (pixel, count) in extents.items():
        if isinstance(pixel, Sourced):
            found[name] = (float(f"{from_si(pixel.value * count, 'mm'):.7g}"), pixel.source)
    if greys.scaled:
        found["bits"] = (MOST_BITS, "scaled to them")
    elif scan.bits is not None:
        found["bits"] = (scan.bits, "file")
    axes = [] if log is None else [name.removesuffix("_n") for name in log.columns if name.endswith("_n")]
    if len(axes) == 1:
        found["axis"] = (axes[0], "the only force of the log")
    return found


def _other_scales(stated: dict[str, tuple[Any, str]], known: dict[str, tuple[Any, str]]) -> list[str]:
    """Say where a scale was told that is not what the source states."""
    return [
        f"{QUESTIONS[name].words}: {known[name][0]:g} mm ({known[name][1]}), where {source} states {value:g} mm"
        for name, (value, source) in stated.items()
        if name in ("width_mm", "depth_mm") and abs(known[name][0] - value) > SAME_SCALE * value
    ]


def _outside(times: Times, log: "ForceLog | None") -> list[str]:
    """Say how many frames have no force beside them."""
    if log is None:
        return []
    count = int(np.count_nonzero((times.time_s < log.time_s[0]) | (times.time_s > log.time_s[-1])))
    words = f"{count} frames were taken before or after the forces: they have no label and are not evaluated;"
    return [f"{words} mend the clocks (--clock-offset-s) if they should be"] if count else []


def _info(gathered: Gathered, answers: ImportAnswers, values: dict[str, Any]) -> RecordingInfo:
    scan = gathered.scan
    try:
        oct_info = OctInfo(
            columns=scan.columns,
            rows=scan.rows,
            bits=values["bits"],
            width_m=to_si(values["width_mm"], "mm"),
            depth_m=to_si(values["depth_mm"], "mm"),
            refractive_index=values["refractive_index"],
        )
        eye = EyeInfo(
            values["eye"],
            thickness_m=to_si(answers.thickness_um, "um"),
            iop_pa=to_si(answers.iop_mmhg, "mmhg"),
            globe=answers.globe,
        )
        polar_rad = None if answers.polar_angle_deg is None else radians(answers.polar_angle_deg)
        gap_m = to_si(values["gap_mm"], "mm")
        needle = NeedleInfo(gauge=values["gauge"], slice_gap_m=gap_m, polar_angle_rad=polar_rad)
        return RecordingInfo(eye, oct_info, needle, None if gathered.log is None else _force_info(answers, values))
    except StudyError as fault:
        raise InputError(f"{scan.names[0]}: {fault}; tell the right one") from fault


def _force_info(answers: ImportAnswers, values: dict[str, Any]) -> ForceInfo:
    info = ForceInfo(values["axis"], int(values["contact_sign"]))
    return info if answers.average_s is None else replace(info, average_s=answers.average_s)
