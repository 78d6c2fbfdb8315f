"""Reads the moments of one eye, one after the other: frames in, answers and a memory
out.

Every door reads frames here: `read` and `evaluate`, the control loop of the monitor
(by the network alone), its second opinion, the app and notebooks. The reader of an eye
does not change. The memory that is handed on holds what moments tell about later ones:
the tissue's memory and a leak (`reading.tissue_memory`), and the last forces, which
show a rise or a fall (`reading.force_trend`). A moment that cannot be judged leaves the
memory as it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from scleraforce.base.arrays import Counts
from scleraforce.base.errors import CalibrationError, InputError
from scleraforce.base.units import from_si
from scleraforce.fit.unknowns import SIZE
from scleraforce.reading.answer import Answer
from scleraforce.reading.force_trend import (
    DENTS,
    NOISE_WINDOWS,
    OUTSIDE,
    DentForce,
    ForceRise,
    TrendLimits,
    rise_of,
    time_to_bound,
    unexplained_fall,
)
from scleraforce.reading.load_model import suited_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.reading.tissue_memory import Leak, TissueMemory
from scleraforce.reading.trained_ranges import CLASSIFIER, other_needle
from scleraforce.records.calibration_file import (
    CalibrationSummary,
    appearance_doubt,
    appearance_of,
    choice_of_eye,
    foreign_modulus,
    known_of_eye,
)
from scleraforce.records.eye import Eye
from scleraforce.records.frame import Pixels
from scleraforce.records.missing_inputs import missing_inputs
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale, Plane
from scleraforce.records.setup import Setup
from scleraforce.records.verdict import upper_end
from scleraforce.wall.wall import Segmentation

Methods = Literal["both", "network"]

THICKNESS_M = 0.6e-3  # of the wall, if unknown

SURFACE = 0.2  # depth of the apex, of the frame's

# counts; the tissue's are added
NOISE = (0, 400)

TISSUE = (600, 1600)

WARMING_FRAMES = 20

TREND = TrendLimits()
RISE_MOMENTS = NOISE_WINDOWS * TREND.rate_frames  # kept to estimate noise and slope

IN_ORDER = "the frames of a recording, read together, show what was before"

OF_POPULATION = Remark(
    "population-modulus",
    "the modulus is the population's, not this eye's own",
    ("modulus",),
)


@dataclass(frozen=True, eq=False)
class MomentFrame:
    """The frame of one plane in memory.

    `pixels` (row, column). `plane`: None of the only one. `wall`: in place of the one
    that is found.
    """

    pixels: Pixels
    plane: Plane | None = None
    wall: Segmentation | None = None


@dataclass(frozen=True, eq=False)
class OpenedMoment:
    """The frames of one moment in memory, all of one size and `scale`.

    `time_s`: on a clock that all moments share, None of a single one, whose history is
    not known. `held_s`: time since the needle's push, None: not known. `iop_pa`:
    pressure at rest at this moment, None: the eye's. `travel_m`: the needle's travel
    along its axis, None: not known. `pierced`: whether the needle had gone through the
    wall, None: nobody says.
    """

    frames: tuple[MomentFrame, ...]
    scale: PixelScale
    time_s: float | None = None
    held_s: float | None = None
    iop_pa: float | None = None
    travel_m: float | None = None
    pierced: bool | None = None

    @property
    def planes(self) -> tuple[Plane, ...]:
        """The planes of the frames; () of a single frame."""
        return tuple(frame.plane for frame in self.frames if frame.plane is not None)


@dataclass(frozen=True, eq=False)
class Memory:
    """What the moments so far tell of the next one; `EyeReader` makes and reads it.

    `time_s`: of the last moment that could be judged, None before it. `forces`: times,
    s, and forces, N, of the last moments. `dents`: their elastic forces. `punctures_s`:
    when the force fell as nothing but a puncture explains. In a monitor the decision
    follows the trend, and the last three stay empty.
    """

    tissue: TissueMemory
    leak: Leak
    time_s: float | None = None
    forces: tuple[tuple[float, float], ...] = ()
    dents: tuple[DentForce, ...] = ()
    punctures_s: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class EyeReader:
    """Reads the moments of one eye with a model.

    Attributes:
        model: a reader that suits the eye.
        setup: what is known of the eye, the needle and the scan.
        by: "both": network and fit. "network": the network alone, which takes a
            millisecond or two and reads single frames.
        asked: the reader that was asked for. None: `model`.
        foreign: why the modulus is not the eye's own, although a calibration is given.
        stated_pa: the pressure of moments that state another one than the eye's.
    """

    model: Reader
    setup: Setup
    by: Methods = "both"
    asked: Reader | None = None
    foreign: Remark | None = None
    stated_pa: float | None = None

    @classmethod
    def of(
        cls, model: Reader, setup: Setup, calibration: CalibrationSummary | None = None
    ) -> "EyeReader":
        """Return the reader of an eye, with the values of its calibration, and with the
        bundled model that was trained for it.

        Raises:
            InputError: nothing names the eye that the calibration is asked for.
            CalibrationError: the calibration is of linear mechanics.
        """
        foreign = None
        if calibration is not None:
            eye = _name_of(setup.eye, calibration)
            check_mechanics(calibration, model)
            setup = known_of_eye(setup, calibration, eye)
            if model.fixed_modulus_pa is None:
                foreign = foreign_remark(calibration, eye)

        return cls(suited_reader(model, setup), setup, "both", model, foreign)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What limits all answers for this eye."""
        remarks = list(other_reader(self.asked, self.model, self._pressure_words))
        scan = self.setup.scan
        gauge = self.setup.needle.gauge
        if None in (scan.rows, scan.columns, scan.width_m, scan.depth_m):
            remarks += other_needle(self.model.study, gauge)
        else:
            remarks += self.model.limits(self.setup, scan, gauge)
        if self.foreign is not None:
            remarks.append(self.foreign)
        is_classifier = self.model.kind == CLASSIFIER
        remarks += missing_inputs(self.setup, forces=False, classifier=is_classifier)
        return tuple(remarks)

    def at(self, iop_pa: float | None) -> "EyeReader":
        """Return the reader of the eye at another pressure at rest; None: its own."""
        if iop_pa is None or iop_pa == self.setup.eye.iop_pa:
            return self
        setup = replace(self.setup, eye=_at_pressure(self.setup.eye, iop_pa))
        model = suited_reader(self.asked or self.model, setup)
        return replace(self, model=model, setup=setup, stated_pa=iop_pa)

    @property
    def _pressure_words(self) -> str:
        """Words for the frames of a stated pressure."""
        if self.stated_pa is None:
            return ""
        return f"at {from_si(self.stated_pa, 'mmhg'):.3g} mmHg: "

    def with_eye(self, eye: Eye) -> "EyeReader":
        """Return the reader for the same eye as it is known now; this one, if the model
        cannot read such an eye.
        """
        setup = replace(self.setup, eye=eye)
        if self.model.refusal(setup) is not None:
            return self
        return replace(self, setup=setup)

    def start(self, *, monitored: bool = False) -> Memory:
        """Return the memory before the first moment.

        `monitored`: anything may have been before, all moments follow each other, and
        the monitor's decision follows the trend of the force.
        """
        begin = TissueMemory.monitored if monitored else TissueMemory.unknown
        tissue = begin(self.setup, self.model.study.needle.max_force_n)
        return Memory(tissue, Leak())

    def scale_of(self, lateral_m: float, depth_m: float) -> PixelScale:
        """Return the scale of frames whose pixels have this size as stored."""
        return PixelScale(
            lateral_m=lateral_m,
            depth_m=depth_m,
            refractive_index=self.setup.scan.refractive_index or 1.0,
        )

    def warm(self, moments: int = WARMING_FRAMES) -> None:
        """Read frames of the study's size, so that the first real one takes no longer
        than the others.
        """
        scanner = self.model.study.oct
        scale = PixelScale.of(scanner)
        pixels = warming_frame(
            (scanner.rows, scanner.columns),
            scale,
            self.model.study.eye.radius_m,
            self.setup.eye.thickness_m,
        )
        scale = self.scale_of(scale.lateral_m, scale.depth_m)
        moment = OpenedMoment((MomentFrame(pixels),), scale)
        memory = self.start()
        for _ in range(moments):
            self.read(moment, memory)

    def read(
        self, moment: OpenedMoment, memory: Memory
    ) -> tuple[tuple[Answer, ...], Memory]:
        """Return an answer for each frame of a moment, and the memory after it.

        The frames of several planes are read by one fit, and each has the force of all.
        A moment before the last one begins a new sequence. Errors are those of
        `Reader.read`.
        """
        before_s = memory.time_s
        time_s = moment.time_s
        goes_back = before_s is not None and time_s is not None and time_s < before_s
        if goes_back and not memory.tissue.of_monitor:
            memory = self.start()
        if len(moment.frames) == 1:
            return self._read(moment, memory)

        # a fit depends in its last digits on the order of planes
        planes = moment.planes
        order = sorted(
            range(len(planes)),
            key=lambda number: (planes[number].direction_rad, planes[number].offset_m),
        )
        frames = tuple(moment.frames[number] for number in order)
        answers, after = self._read(replace(moment, frames=frames), memory)
        by_number = dict(zip(order, answers, strict=True))
        return tuple(by_number[number] for number in range(len(order))), after

    def _read(
        self, moment: OpenedMoment, memory: Memory
    ) -> tuple[tuple[Answer, ...], Memory]:
        now = self.at(moment.iop_pa)
        if self.by == "network":
            (frame,) = moment.frames
            elastic: tuple[Answer, ...] = (
                now.model.read_live(frame.pixels, moment.scale, now.setup),
            )
            leak = memory.leak
        else:
            elastic, leak = self._by_both(now, moment, memory.leak)

        bounds_n = self.model.study.classes.bounds_n
        felt = [
            memory.tissue.read(one, bounds_n, moment.time_s, moment.held_s)
            for one in elastic
        ]
        answers = tuple(answer for answer, _ in felt)
        after = Memory(
            felt[0][1],
            leak,
            moment.time_s if answers[0].usable else memory.time_s,
            memory.forces,
            memory.dents,
            memory.punctures_s,
        )
        if memory.tissue.of_monitor:
            return answers, after

        answers, after = self._with_trend(answers, moment, after)
        remarks = () if self.foreign is None else (OF_POPULATION,)
        if answers[0].usable:
            remarks = (*remarks, *self._without_history(moment))
        if remarks:
            answers = tuple(
                replace(one, remarks=(*one.remarks, *remarks)) for one in answers
            )
        return answers, after

    def _by_both(
        self, now: "EyeReader", moment: OpenedMoment, leak: Leak
    ) -> tuple[tuple[Answer, ...], Leak]:
        """Return the answers by both methods, of the elastic force, and the leak after
        them.

        `now`: the reader at the pressure that is stated of the moment.
        """
        pixels = [frame.pixels for frame in moment.frames]
        walls = [frame.wall for frame in moment.frames]
        planes = moment.planes

        def read(setup: Setup) -> tuple[Answer, ...]:
            return now.model.read_together(pixels, moment.scale, setup, planes, walls)

        if moment.iop_pa is None:
            return leak.read(read, self.setup, moment.time_s, moment.held_s)
        answers = read(now.setup)
        return answers, leak.at_pressure(
            moment.iop_pa, self.setup.eye, answers, moment.time_s
        )

    def _with_trend(
        self, answers: tuple[Answer, ...], moment: OpenedMoment, memory: Memory
    ) -> tuple[tuple[Answer, ...], Memory]:
        """Return the answers with the time to the bound and a remark on a fall that
        looks like a puncture, and the memory with the forces of this moment.
        """
        first = answers[0]
        dent_n = first.dent_force_n
        time_s = moment.time_s
        if time_s is None or first.force_n is None or dent_n is None:
            return tuple(self._to_bound(one, None) for one in answers), memory

        forces = (*memory.forces, (time_s, first.force_n))[-RISE_MOMENTS:]
        dents = (*memory.dents, DentForce(time_s, dent_n, moment.travel_m))[-DENTS:]
        memory = replace(memory, forces=forces, dents=dents)
        rise = rise_of(forces, TREND.rate_frames)
        answers = tuple(self._to_bound(one, rise) for one in answers)

        # a fall between held pushes, which nobody saw, is no puncture
        fall = unexplained_fall(dents, TREND)
        if fall is None or not fall.pierced or moment.pierced is False:
            return answers, memory

        remark = Remark(
            "pierced",
            f"the force fell from {from_si(fall.from_n, 'mn'):.1f} to"
            f" {from_si(fall.to_n, 'mn'):.1f} mN within"
            f" {from_si(fall.within_s, 'ms'):.0f} ms, faster than a needle goes back:"
            " the wall may be pierced",
        )
        answers = tuple(replace(one, remarks=(*one.remarks, remark)) for one in answers)
        punctures_s = (*memory.punctures_s, dents[-OUTSIDE].at_s)
        return answers, replace(memory, punctures_s=punctures_s)

    def _to_bound(self, answer: Answer, rise: ForceRise | None) -> Answer:
        """Return an answer with the time until its force reaches the highest class."""
        upper_n = upper_end(answer.verdict)
        if not answer.usable or answer.force_n is None or upper_n is None:
            return answer
        bound_n = self.model.study.classes.bounds_n[-1]
        to_bound = time_to_bound(rise, answer.force_n, upper_n, bound_n)
        return replace(answer, to_bound=to_bound)

    def _without_history(self, moment: OpenedMoment) -> tuple[Remark, ...]:
        """Return remarks on a single frame whose history matters."""
        eye = self.setup.eye
        leaks = eye.leak_time_s is not None and moment.iop_pa is None
        relaxes = eye.relaxation is not None and eye.relaxation.matters
        if moment.time_s is not None or not (leaks or relaxes):
            return ()
        if not self.model.reads_force:
            return ()

        remarks = list[Remark]()
        if leaks:
            words = f"a single frame is read as if nothing had leaked; {IN_ORDER}"
            remarks.append(Remark("no-history", words, ("leak_time_s",)))
        if relaxes and moment.held_s is None:
            words = (
                f"a single frame is read as those that calibrated the eye; {IN_ORDER}"
            )
            remarks.append(Remark("no-history", words, ("relaxation",)))
        return tuple(remarks)


def other_reader(
    asked: Reader | None, model: Reader, at_pressure: str = ""
) -> tuple[Remark, ...]:
    """Return a remark if another model reads than the one that was asked for;
    `at_pressure` begins its words.
    """
    if asked is None or asked.path == model.path:
        return ()
    words = (
        f"read with the bundled reader {model.name}, which was trained for such eyes"
    )
    return (Remark("other-reader", at_pressure + words),)


def foreign_remark(calibration: CalibrationSummary, eye: str) -> Remark | None:
    """Return a remark if a calibration has no modulus of an eye's own."""
    words = foreign_modulus(calibration, eye)
    return None if words is None else Remark("population-modulus", words, ("modulus",))


def check_mechanics(calibration: CalibrationSummary, model: Reader) -> None:
    """Raise a `CalibrationError` for a calibration of linear mechanics, whose moduli
    are no reader's.
    """
    if model.fixed_modulus_pa is None and calibration.mechanics == "linear":
        raise CalibrationError(
            f"{calibration.path}: mechanics: linear; {model.path} reads with finite"
            " strain: calibrate with `mechanics=finite-strain`"
        )


def other_eye(
    answers: Sequence[Answer], calibration: CalibrationSummary, eye: str
) -> tuple[Remark, ...]:
    """Return a remark if frames show another eye than the calibration's."""
    usable = [answer for answer in answers if answer.usable]
    walls = [answer.segmentation for answer in usable if answer.segmentation]
    fits = [answer.fit for answer in usable if answer.fit is not None]
    shown = appearance_of(
        [wall.thickness_m for wall in walls if wall.inner_found],
        [float(np.exp(fit.unknown[SIZE])) for fit in fits],
    )
    doubt = appearance_doubt(calibration, eye, shown)
    return (Remark("other-eye", doubt, ("name",)),) if doubt else ()


def warming_frame(
    shape: tuple[int, int],
    scale: PixelScale,
    radius_m: float,
    thickness_m: float | None = None,
) -> Counts:
    """Return a raw B-scan (row, column) of the wall of an eye at rest, the same at each
    call.
    """
    rows, columns = shape
    rng = np.random.default_rng(0)
    lateral_m = (np.arange(columns) + 0.5 - columns / 2) * scale.lateral_m
    falls_m = radius_m - np.sqrt(np.maximum(radius_m**2 - lateral_m**2, 0.0))
    depth_m = (
        np.arange(rows)[:, None] + 0.5 - SURFACE * rows
    ) * scale.depth_m - falls_m
    is_tissue = (depth_m > 0.0) & (
        depth_m < (thickness_m or THICKNESS_M) * scale.refractive_index
    )
    noise, tissue = (
        rng.integers(*counts, shape, dtype=np.uint16) for counts in (NOISE, TISSUE)
    )

    return noise + np.where(is_tissue, tissue, np.uint16(0))


def _at_pressure(eye: Eye, iop_pa: float) -> Eye:
    """Return an eye at another pressure at rest, as sure as its own; also as it was
    before learning.
    """
    unlearned = eye.unlearned and _at_pressure(eye.unlearned, iop_pa)
    return replace(eye, iop_pa=iop_pa, iop_assumed=None, unlearned=unlearned)


def _name_of(eye: Eye, calibration: CalibrationSummary) -> str:
    """Return the name of an eye that a calibration is asked for."""
    if eye.name is None:
        raise InputError(
            "eye: missing; no recording.toml beside the frame names it;"
            f" {choice_of_eye(calibration)}"
        )
    return eye.name
