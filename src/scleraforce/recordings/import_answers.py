"""The values of an import: options, metadata of the sources, questions for the rest,
and import.json.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import asdict, dataclass, fields, replace
from hashlib import file_digest
from pathlib import Path
from typing import Any

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import InputError, RecordingError, StudyError
from scleraforce.base.units import from_si, to_si
from scleraforce.recordings.clock_offsets import MEAN_S, ClockEstimate, estimate_clocks
from scleraforce.recordings.forces_under_frames import contact_force
from scleraforce.recordings.formats.foreign_force_logs import parse_column
from scleraforce.recordings.formats.picture_streams import (
    MOST_BITS,
    FrameTimes,
    GreyMap,
    PictureSource,
    UnansweredError,
    check_grey_range,
    parse_axes,
)
from scleraforce.recordings.formats.pixels_without_value import NOT_FINITE
from scleraforce.recordings.frame_and_force_tables import ForceLog
from scleraforce.recordings.frame_names import times_in
from scleraforce.recordings.frame_order import parse_frames_by
from scleraforce.recordings.frame_times import read_times
from scleraforce.recordings.import_record import (
    IMPORT_RECORD,
    KeptAnswers,
    read_import_record,
)
from scleraforce.recordings.import_sources import (
    OPTION,
    GatheredSources,
    ImportOptions,
    on_one_clock,
)
from scleraforce.recordings.recording_folder import read_info
from scleraforce.records.eye import UNCERTAIN, Eye
from scleraforce.records.fields import Unit, check_value, name_fault
from scleraforce.records.globe import Globe
from scleraforce.records.missing_inputs import missing_inputs
from scleraforce.records.needle import Needle, gauge_diameter_m
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.remark import Remark, sentences
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study_of_eye import GLOBES, relaxation_terms
from scleraforce.records.tissue_relaxation import Relaxation


def given_times(
    scan: PictureSource, table: Path | None, rate_hz: float | None
) -> FrameTimes | None:
    """Return the frames' times by a table, to each name its time if it names files, or
    by a rate; None without both.
    """
    if table is not None and rate_hz is not None:
        raise InputError(
            "`rate_hz`: `times` states when frames were taken; give one of them"
        )
    if rate_hz is not None:
        if not 0.0 < rate_hz < float("inf"):
            raise InputError(
                f"`rate_hz`: {rate_hz:g}; give the frames taken in a second"
            )

        steps = np.arange(len(scan.names)) if scan.steps is None else scan.steps
        return FrameTimes((steps - steps[0]) / rate_hz, "option")
    if table is None:
        return None

    stated = read_times(table)
    time_s = stated.times_of(scan)
    if time_s is None:
        time_s = stated.time_s
    if len(time_s) != len(scan.names):
        raise InputError(f"{table}: {len(time_s)} times for {len(scan.names)} frames")

    return FrameTimes(time_s, str(table))


@dataclass(frozen=True)
class Question:
    """A question in words, and the fields that answer it."""

    words: str
    answered_by: str  # as a message names them
    # returns why an answer is wrong
    fault: Callable[[Any], str | None] = lambda _: None
    optional: bool = False  # may stay open (None)
    offered: float | None = None  # the sources' suggestion
    offer: str = "the first frames show"


# By the name of the option's value, in the order in which they are asked.
QUESTIONS = {
    "width_mm": Question("width of the frames", "`width_m`"),
    "depth_mm": Question("depth of the frames, as stored", "`depth_m`"),
    "refractive_index": Question(
        "refractive index of the depth axis: 1 if the scanner has corrected it"
        " (geometric depth), otherwise the tissue's, about 1.38 (optical depth)",
        "`refractive_index`",
    ),
    "bits": Question("bits of a pixel that are used", "`bits`"),
    "rate_hz": Question("frames taken in a second", "`rate_hz` or `times`"),
    "clock_offset_s": Question(
        "force log's clock minus the frames' clock, in seconds",
        "`clock_offset_s`",
        lambda value: "give a number" if isinstance(value, str) else None,
        offer="the dents fit",
    ),
    "axis": Question("axis of the force sensor along the needle", "`axis`"),
    "contact_sign": Question("sign of that axis in contact", "`contact_sign`"),
    "eye": Question("name of the eye", "`eye`", name_fault),
    "gauge": Question("gauge of the needle", "`gauge`"),
    "gap_mm": Question(
        "distance of the B-scan plane from the needle's axis", "`gap_m`"
    ),
    "thickness_um": Question("thickness of the wall", "`thickness_m`", optional=True),
}


CLOCK_UNLESS_SEEN = Question(
    "force log's clock minus the frames' clock, in seconds, unless the dents show it",
    "`clock_offset_s`",
)


@dataclass(frozen=True)
class Asker:
    """The functions that ask a user at a terminal."""

    # adds the answer to a source's open question
    settle: Callable[[ImportOptions, UnansweredError], ImportOptions]
    # returns answers by their names in `QUESTIONS`
    missing: Callable[[Mapping[str, Question]], dict[str, Any]]
    again: Callable[[InputError], None]  # reports a wrong answer, before the next round


@dataclass(frozen=True)
class PictureMeasures:
    """What the pictures of the sources show, where the scanner's scale is known."""

    # the wall's thickness in the first frames, µm; None: not seen
    thickness_um: Callable[[Scan], float | None]
    # measures of the dent in each frame (measure, frame), NaN: not seen
    dents: Callable[[Scan], Floats]


SAME_THICKNESS = 0.15  # of the stated one: the visible one may differ by as much
CONTRADICTED = "source-contradicted"
SAME_SCALE = 0.001  # scales that differ by less are rounded
ANSWER = "answer"  # the source of a value that was typed on the terminal


@dataclass(frozen=True, eq=False)
class PreparedImport:
    """All that a recording is written from."""

    gathered: GatheredSources
    greys: GreyMap
    times: FrameTimes  # on the clock of the log
    log: ForceLog | None
    origin_s: float  # the beginning of that clock on the sources' own
    clock: "SharedClock"
    info: RecordingInfo
    sources: dict[str, str]  # of each value, by the name of its option
    remarks: tuple[Remark, ...]

    def declaring(self, declared: Setup) -> "PreparedImport":
        """Return the import with what is declared beside its answers."""
        setup = self.info.setup.completed_by(declared)
        sds = {
            sd: getattr(declared.eye, sd)
            for value, sd in UNCERTAIN.items()
            if getattr(declared.eye, value) is not None
        }
        eye = replace(setup.eye, **sds)
        info = replace(self.info, eye=eye, needle=setup.needle, scan=setup.scan)
        return replace(self, info=info)

    def with_remarks(self, remarks: Iterable[Remark]) -> "PreparedImport":
        """Return the import with further remarks."""
        return replace(self, remarks=(*self.remarks, *remarks))


# values by the name of their option, each with its source
Known = dict[str, tuple[Any, str]]


def complete_import(
    gathered: GatheredSources,
    greys: GreyMap,
    answers: ImportOptions,
    origins: Mapping[str, str],
    asker: Asker | None,
    pictures: PictureMeasures,
) -> PreparedImport:
    """Combine options (`origins`), then the sources' values, then another recording's;
    ask for the rest.
    """
    times = (
        given_times(gathered.scan, answers.times, answers.rate_hz)
        or gathered.scan.times
    )
    known, questions = open_questions(gathered, greys, answers, origins)
    open_clock = gathered.log is not None and not (
        isinstance(answers.clock_offset_s, int | float)
        or is_one_clock(gathered, answers)
    )
    if asker is None and questions:
        unless_seen = {"clock_offset_s": CLOCK_UNLESS_SEEN} if open_clock else {}
        listed = "; ".join(
            f"{question.words} ({question.answered_by})"
            for question in (questions | unless_seen).values()
        )
        raise InputError(f"neither in the sources nor among the options: {listed}")

    done = None
    while done is None:
        answered = (
            {}
            if asker is None
            else {
                name: (value, ANSWER)
                for name, value in asker.missing(questions).items()
            }
        )
        try:
            values = known | answered
            done = _completed(gathered, greys, answers, times, values, pictures, asker)
        except InputError as wrong:
            if asker is None or not (questions or open_clock):
                raise

            asker.again(wrong)

    name = "thickness_um"
    value = answers.thickness_um
    source = origins.get(name, ANSWER)

    if value is None and asker is not None:
        shown_um = pictures.thickness_um(done.info.scan)
        value = asker.missing({name: replace(QUESTIONS[name], offered=shown_um)}).get(
            name
        )
        source = "measured on the first frames" if value == shown_um else source

    if value is None:
        return done

    info = replace(
        done.info, eye=replace(done.info.eye, thickness_m=to_si(value, "um"))
    )
    done = replace(done, info=info, sources=done.sources | {name: source})
    shown_um = pictures.thickness_um(done.info.scan)
    if shown_um is not None and abs(shown_um - value) <= SAME_THICKNESS * value:
        return done

    if shown_um is None:
        words = (
            "no wall is seen in the first frames; are they upside down (`flip=rows`),"
            " or transposed (`axes`)?"
        )
        return done.with_remarks([Remark("wall-not-seen", words, ("flip", "axes"))])

    words = (
        f"the first frames show a wall of {shown_um:g} µm, where"
        f" {value:g} µm is stated ({source}): check `refractive_index`, `depth_m`"
        " and the thickness, and whether the frames are upside down (`flip=rows`)"
    )
    contradicted = ("thickness_m", "refractive_index", "depth_m", "flip")
    return done.with_remarks([Remark("thickness-contradicted", words, contradicted)])


def open_questions(
    gathered: GatheredSources,
    greys: GreyMap,
    answers: ImportOptions,
    origins: Mapping[str, str],
) -> tuple[Known, dict[str, Question]]:
    """Return the values that options (`origins`) and sources give, and the questions
    that they leave open.
    """
    _check_used(gathered, origins)
    if gathered.planes and origins.get("gap_mm") == OPTION:
        raise InputError("`gap_m`: several planes show their gaps; leave it out")

    times = (
        given_times(gathered.scan, answers.times, answers.rate_hz)
        or gathered.scan.times
    )
    needed = _needed(gathered, answers, times)
    stated = _stated(gathered, greys)
    known = stated | {
        name: (value, origins.get(name, ANSWER))
        for name in needed
        if (value := getattr(answers, name)) is not None
        and (name not in stated or origins.get(name) == OPTION)
    }
    questions = {
        name: question
        for name, question in QUESTIONS.items()
        if name in needed - set(known)
    }
    scan = gathered.scan

    for fault, names, words in (
        (scan.scale_fault, ("width_mm", "depth_mm"), "`width_m` and `depth_m`"),
        (scan.times_fault, ("rate_hz",), "`rate_hz`"),
    ):
        if fault and questions.keys() & names:
            raise InputError(f"{fault}; give {words}")

    if "rate_hz" in questions and times_in(scan.names) is not None:
        of_names = "`rate_hz`, `times` or `frames_by=times`"
        questions["rate_hz"] = replace(questions["rate_hz"], answered_by=of_names)

    if "bits" in questions:
        few = f"pixels are up to {greys.high - greys.low:g}, which needs more bits"
        questions["bits"] = replace(
            questions["bits"], fault=lambda bits: None if greys.fit(bits) else few
        )

    return known, questions


def _completed(
    gathered: GatheredSources,
    greys: GreyMap,
    answers: ImportOptions,
    times: FrameTimes | None,
    known: Known,
    pictures: PictureMeasures,
    asker: Asker | None,
) -> PreparedImport:
    values = {name: value for name, (value, _) in known.items()}
    info = _info(gathered, answers, values)
    if not greys.fit(info.scan.pixel_bits):
        raise InputError(
            f"{gathered.scan.names[0]}: pixels up to {greys.high:g}; `bits` says"
            f" {info.scan.bits}"
        )

    rate_hz = answers.rate_hz or values.get("rate_hz")
    if rate_hz is not None and answers.frames_by is None:
        _check_even(gathered.scan)
    asked = None if times else given_times(gathered.scan, None, values.get("rate_hz"))
    times = times or asked or FrameTimes(np.zeros(1), "a single frame")
    if "rate_hz" in known:
        times = replace(times, source=known["rate_hz"][1])

    sources = {name: known[name][1] for name in QUESTIONS if name in known} | {
        "times": times.source
    }
    clock = _shared_clock(gathered, times, info, answers, pictures, asker)
    if clock.source:
        sources["clock_offset_s"] = sources.get("clock_offset_s", clock.source)
    steady = replace(times, time_s=clock.drifting(times.time_s))
    moved, log, origin_s = on_one_clock(steady, gathered.log, clock.offset_s)
    return PreparedImport(
        gathered,
        greys,
        moved,
        log,
        origin_s,
        clock,
        info,
        sources,
        (
            *greys.remarks,
            *gathered.remarks,
            *clock.remarks,
            *_contradicted(gathered, greys, known),
            *_beside_log(moved, log),
        ),
    )


def _contradicted(
    gathered: GatheredSources, greys: GreyMap, known: Known
) -> Iterator[Remark]:
    """Yield remarks on sources that contradict themselves, or what is given."""
    faults = {
        ("width_m", "depth_m"): gathered.scan.scale_fault,
        ("rate_hz",): gathered.scan.times_fault,
    }
    for names, fault in faults.items():
        if fault:
            yield Remark(CONTRADICTED, fault, names)

    stated = _stated(gathered, greys)
    for name, field_name in (("width_mm", "width_m"), ("depth_mm", "depth_m")):
        value, source = stated.get(name, known[name])
        used, of_used = known[name]
        if abs(used - value) > SAME_SCALE * value:
            words = (
                f"{QUESTIONS[name].words}: {used:g} mm ({of_used}), where"
                f" {source} states {value:g} mm"
            )
            yield Remark(CONTRADICTED, words, (field_name,))


def _beside_log(times: FrameTimes, log: ForceLog | None) -> tuple[Remark, ...]:
    """Return a remark on frames before or after the forces."""
    if log is None:
        return ()

    is_outside = (times.time_s < log.time_s[0]) | (times.time_s > log.time_s[-1])
    if not is_outside.any():
        return ()

    words = (
        f"{is_outside.sum()} frames were taken before or after the forces: they have no"
        " label and are not evaluated; mend the clocks (`clock_offset_s`) if they"
        " should be"
    )
    return (Remark("frames-without-label", words, ("clock_offset_s",)),)


BY_DENTS = "the dents in the frames"  # the source of an offset
CLOCK = ("clock_offset_s",)


@dataclass(frozen=True, kw_only=True)
class SharedClock:
    """How the frames' clock is brought to that of the log.

    `offset_s` is added to the frames' times. `source`: of that value; "" if one clock
    needs none. `estimate`: by the dents; None: not needed, or not possible.
    """

    offset_s: float = 0.0
    source: str = ""
    estimate: ClockEstimate | None = None
    remarks: tuple[Remark, ...] = ()

    def drifting(self, time_s: Floats) -> Floats:
        """Return times of frames without the drift of their clock, s."""
        if self.source != BY_DENTS or self.estimate is None:
            return time_s
        return self.estimate.moved(time_s) - self.estimate.offset_s

    def entry(self) -> dict[str, Any] | None:
        """Return the estimate for `import.json`, None without one."""
        if self.estimate is None:
            return None
        names = "low_s", "high_s", "sure", "drift_s"
        found = {name: getattr(self.estimate, name) for name in names}
        return {
            "offset_s": self.offset_s,
            "by_dents_s": self.estimate.offset_s,
            **found,
        }


def _shared_clock(
    gathered: GatheredSources,
    times: FrameTimes,
    info: RecordingInfo,
    answers: ImportOptions,
    pictures: PictureMeasures,
    asker: Asker | None,
) -> SharedClock:
    """Return the offset of the clocks: the given one, 0 of one bag, else that which the
    dents show; ask if they leave it open.
    """
    given = answers.clock_offset_s
    if gathered.log is None or info.force is None:
        return SharedClock()
    if given is None and is_one_clock(gathered, answers):
        return SharedClock()

    log = gathered.log.known(info.force.axis)
    found = estimate_clocks(
        times.time_s,
        pictures.dents(info.scan),
        log.time_s,
        contact_force(log, info.force),
    )
    if isinstance(given, int | float):
        fault = f"the dents fit a clock offset of {found.words}" if found else ""
        doubted = found is not None and found.sure and not found.holds(given)
        doubt = Remark("clock-contradicted", f"{fault}, not {given:g} s", CLOCK)
        return SharedClock(
            offset_s=given,
            source=OPTION,
            estimate=found,
            remarks=(doubt,) if doubted else (),
        )

    if found is not None and found.sure:
        # A table of times is on the log's clock, as a rule. At the ends of a rest the
        # mean of a label would reach into a ramp.
        margin_s = info.force.average_s / 2 + MEAN_S
        stated = answers.times is not None and found.holds(0.0, margin_s)
        offset_s = 0.0 if stated else round(found.offset_s, 3)
        words = f"clock offset {offset_s:g} s: the dents fit {found.words}"
        return SharedClock(
            offset_s=offset_s,
            source=BY_DENTS,
            estimate=found,
            remarks=(Remark("clock-found", words, CLOCK),),
        )

    why = _unsure_words(found)
    if asker is None:
        missing = missing_inputs(info.setup, forces=True, clock_known=False)
        cost = next(remark.words for remark in missing if remark.fields == CLOCK)
        raise InputError(
            f"{cost}; {why}; `clock_offset_s=S` states the log's clock minus the"
            " frames' clock, `clock_offset_s=0` that both share one"
        )

    name = "clock_offset_s"
    question = QUESTIONS[name]
    offered = None if found is None else round(found.offset_s, 3)
    words = f"{why}. {question.words}; 0: they share one clock"
    answer = asker.missing({name: replace(question, words=words, offered=offered)})
    return SharedClock(offset_s=float(answer[name]), source=ANSWER, estimate=found)


def is_one_clock(gathered: GatheredSources, answers: ImportOptions) -> bool:
    """Return whether frames and forces have times of one bag."""
    of_table = answers.rate_hz is not None or answers.times is not None
    return gathered.one_clock and not of_table


def _unsure_words(found: ClockEstimate | None) -> str:
    if found is None:
        return "too few frames show a dent to find their offset"
    if found.parts:
        listed = ", ".join(
            f"frames {first + 1} to {last + 1}: {offset_s:.1f} s"
            for first, last, offset_s in found.parts
        )
        return (
            f"parts of the recording have offsets of their own ({listed}): a clock"
            " paused, was set, or drifts; import them one by one (`first_frame`,"
            " `last_frame`), or give each frame its time (`times`)"
        )
    if found.related:
        others = ", ".join(f"{other_s:.1f}" for other_s in found.rivals_s)
        return (
            f"the dents fit an offset of {found.offset_s:.1f} s, and nearly as well"
            f" {others} s"
        )
    return (
        f"the dents fit the log at no offset better than chance (best:"
        f" {found.offset_s:.1f} s); is it the log of these frames?"
    )


UNEVEN = 1.5  # of their median: steps of time beside which others are missing


def _check_even(scan: PictureSource) -> None:
    """Check that a rate does not replace times of uneven steps, as of lost frames."""
    if scan.times is None or len(scan.names) < 3:
        return

    steps_s = np.diff(scan.times.time_s)
    middle_s = float(np.median(steps_s))
    if float(steps_s.max()) > UNEVEN * middle_s:
        at = int(np.argmax(steps_s)) + 1
        raise InputError(
            f"{scan.names[at]}: `rate_hz`: it is {steps_s.max():.4g} s after the frame"
            f" before by {scan.times.source}, others {middle_s:.4g} s: leave `rate_hz`"
            " out, or say that frames are evenly spaced: `frames_by=order`"
        )


def _check_used(gathered: GatheredSources, origins: Mapping[str, str]) -> None:
    """Check that an option that acts on one kind of source has such a source."""
    kinds = {kind for _, kind in gathered.files}
    packed = any(path.suffix.lower() == ".npz" for path, _ in gathered.files)

    for what, there, names in (
        (
            "a force log",
            gathered.log is not None,
            ("axis", "contact_sign", "average_s", "range_n", "clock_offset_s"),
        ),
        ("a force log of text", "log" in kinds, ("columns",)),
        ("a ROS bag", "bag" in kinds, ("image_topic", "force_topic", "by_arrival")),
        ("an .npz file", packed, ("array",)),
        (
            "frames whose axes are not fixed",
            bool(kinds - {"thorlabs", "log"}),
            ("axes",),
        ),
        (
            "frames in files of their own",
            bool(kinds - {"bag", "film", "log"}),
            ("frames_by",),
        ),
    ):
        if unused := [
            name for name in names if origins.get(name) == OPTION and not there
        ]:
            raise InputError(
                f"`{unused[0]}`: acts on {what}, which is not among the"
                " sources; leave it out"
            )


def _needed(
    gathered: GatheredSources, answers: ImportOptions, times: FrameTimes | None
) -> set[str]:
    needed = {"width_mm", "depth_mm", "refractive_index", "bits", "eye", "gauge"}
    needed |= set() if gathered.planes else {"gap_mm"}
    if times is None and len(gathered.scan.names) > 1:
        needed.add("rate_hz")

    if gathered.log is not None:
        needed |= {"axis", "contact_sign"}
        if isinstance(answers.clock_offset_s, int | float):
            needed.add("clock_offset_s")

    return needed


def _stated(gathered: GatheredSources, greys: GreyMap) -> Known:
    scan = gathered.scan
    log = gathered.log
    found: Known = {}
    extents = {
        "width_mm": (scan.size.lateral_m, scan.columns),
        "depth_mm": (scan.size.depth_m, scan.rows),
    }

    for name, (pixel_m, count) in extents.items():
        if pixel_m:
            found[name] = (
                float(f"{from_si(pixel_m * count, 'mm'):.7g}"),
                scan.size.source,
            )

    if greys.scaled:
        found["bits"] = (MOST_BITS, "scaled to them")
    elif scan.bits is not None:
        found["bits"] = (scan.bits, "file")

    axes = (
        []
        if log is None
        else [name.removesuffix("_n") for name in log.columns if name.endswith("_n")]
    )
    if len(axes) == 1:
        found["axis"] = (axes[0], "the only force of the log")

    return found


def _info(
    gathered: GatheredSources, answers: ImportOptions, values: dict[str, Any]
) -> RecordingInfo:
    scan = gathered.scan
    try:
        width_m, depth_m = (
            to_si(values[name], "mm") for name in ("width_mm", "depth_mm")
        )
        used = {name: values[name] for name in ("bits", "refractive_index")} | {
            "planes": gathered.planes
        }
        oct_info = Scan(
            columns=scan.columns,
            rows=scan.rows,
            width_m=width_m,
            depth_m=depth_m,
            **used,
        )
        thickness_m = to_si(answers.thickness_um, "um")
        iop_pa = to_si(answers.iop_mmhg, "mmhg")
        gap_m = None if gathered.planes else to_si(values["gap_mm"], "mm")
        check_value("globe", answers.globe, Unit(words=GLOBES))
        eye = Eye(
            values["eye"],
            thickness_m=thickness_m,
            iop_pa=iop_pa,
            relaxation=(
                None
                if answers.relaxation is None
                else Relaxation.declared(relaxation_terms(answers.relaxation))
            ),
            globe=None if answers.globe is None else Globe.declared(answers.globe),
        )
        polar_rad = to_si(answers.polar_angle_deg, "deg")
        needle = Needle(
            diameter_m=gauge_diameter_m(values["gauge"]),
            gap_m=gap_m,
            polar_rad=polar_rad,
        )

        force = (
            None
            if gathered.log is None
            else ForceInfo(values["axis"], int(values["contact_sign"]))
        )
        if force and answers.average_s is not None:
            force = replace(force, average_s=answers.average_s)
        if force and answers.range_n is not None:
            force = replace(force, range_n=answers.range_n)

        return RecordingInfo(eye, oct_info, needle, force)
    except StudyError as fault:
        raise InputError(f"{scan.names[0]}: {fault}; correct it") from fault


# An answer that numbers and times in names do not count, which is so in one session.
IN_GIVEN_ORDER = "order"
OF_ONE_PLANE = "needle.slice_gap_m"  # several planes show their gaps


@dataclass(frozen=True)
class LikeRecording:
    """Another recording of the same laboratory, as far as a new import takes it over.

    Scanner, needle, sensor and the form of the sources are of the laboratory: `answers`
    by the names of options, `frames_by`, and `declared`, which no option states. What
    it says of its eye, of the contact and of its session is not taken over.
    """

    path: Path
    info: RecordingInfo
    kept: KeptAnswers

    @property
    def answers(self) -> dict[str, Any]:
        """Its answers by the names of options."""
        info = self.info
        sizes_m = {
            "width_mm": info.scan.width_m,
            "depth_mm": info.scan.depth_m,
            "gap_mm": info.needle.gap_m,
        }
        found: dict[str, Any] = {
            name: from_si(size_m, "mm") for name, size_m in sizes_m.items()
        }
        found |= {
            "refractive_index": info.scan.refractive_index,
            "bits": info.scan.bits,
            "gauge": info.needle.gauge,
        }

        if (force := info.force) is not None:
            found |= {
                "axis": force.axis,
                "contact_sign": str(force.contact_sign),
                "average_s": force.average_s,
                "range_n": force.range_n,
            }

        return found | replace(self.kept, frames_by=None).to_dict()

    @property
    def frames_by(self) -> str | None:
        """What orders frames by their names, where the names of new ones allow it and
        nothing else states their times; None: nothing.
        """
        frames_by = self.kept.frames_by
        return None if frames_by == IN_GIVEN_ORDER else frames_by

    @property
    def declared(self) -> Setup:
        """What is of the laboratory and has no option: how the B-scan is tilted against
        the needle.
        """
        return Setup(scan=Scan(tilt_rad=self.info.scan.tilt_rad))

    def not_copied(self, new: RecordingInfo) -> tuple[Remark, ...]:
        """Return a remark on the keys of its recording.toml that say something of its
        eye, contact or session, and that a new recording does not state.
        """
        stated = self.info.stated_keys
        known = {*new.stated_keys}
        if new.scan.planes:
            known.add(OF_ONE_PLANE)
        globe = self.info.eye.globe
        if globe and new.eye.globe and globe.kind != new.eye.globe.kind:
            # rigidity and leak of a sealed globe are nothing to an open one
            known |= {key for key, name in stated.items() if name == "globe"}

        missing = {key: name for key, name in stated.items() if key not in known}
        if not missing:
            return ()

        words = (
            f"not copied from {self.path}, because they are of its eye or session:"
            f" {', '.join(missing)} (keys of recording.toml); state those that hold"
            " here as well"
        )
        return (Remark("not-copied", words, tuple(dict.fromkeys(missing.values()))),)


def read_like(folder: Path) -> LikeRecording:
    """Return a recording whose laboratory is that of a new import.

    Raises:
        RecordingError: it cannot be read, or an answer that its import.json keeps is
            none.
    """
    info = read_info(folder / "recording.toml")
    kept = read_import_record(folder).answers
    checks: list[tuple[str, Callable[[Any], object], Any]] = [
        ("axes", parse_axes, kept.axes),
        *(("columns", parse_column, column) for column in kept.columns),
        ("grey_range", check_grey_range, kept.grey_range),
        ("frames_by", parse_frames_by, kept.frames_by),
    ]
    for name, check, answer in checks:
        if answer is None:
            continue
        try:
            check(answer)
        except InputError as fault:
            words = str(fault).removeprefix(f"`{name}`")
            raise RecordingError(
                f"{folder / IMPORT_RECORD}: answers.{name}{words}"
            ) from fault

    return LikeRecording(folder, info, kept)


def record_text(done: PreparedImport, options: ImportOptions, version: str) -> str:
    """Return the text of import.json: sources with their SHA-256, the source of each
    value, and reusable options.
    """
    files: list[dict[str, str | None]] = []
    for path, kind in done.gathered.files:
        with path.open("rb") if path.is_file() else nullcontext() as file:
            digest = None if file is None else file_digest(file, "sha256").hexdigest()
        files.append({"path": str(path), "kind": kind, "sha256": digest})

    origin = provenance(done)
    answers = asdict(options) | {"columns": origin["columns"]}
    kept = KeptAnswers(
        **{item.name: answers[item.name] for item in fields(KeptAnswers)}
    )
    answered = {"answers": kept.to_dict()}
    record = {"version": version, "files": files, **origin, **answered}

    return json.dumps(record, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def provenance(done: PreparedImport) -> dict[str, Any]:
    """Return the origins of values, times and counts."""
    greys = done.greys
    return {
        "values": done.sources,
        "clock": done.clock.entry(),
        "clock_origin_s": done.origin_s,
        "columns": [column.answer() for column in done.gathered.columns],
        "grey": {
            "low": greys.low,
            "high": greys.high,
            "scaled": greys.scaled,
            "not_finite": greys.without.get(NOT_FINITE, 0),
            "no_value": dict(greys.without),
        },
        "notes": list(sentences(done.remarks)),
        "remarks": [remark.to_dict() for remark in done.remarks],
    }
