"""The eye that a monitor learns: a process beside the second opinion narrows the
posterior of E by the dents' shape.

The joint fit takes seconds, an opinion must not wait for it. So the second opinion only
chooses frames, and a process of low priority, which dies with it, fits them. A frame
teaches `SETTLES_S` after it came, unless a withdrawal followed; after a puncture, what
was learned since the contact began is dropped.
"""

import os
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from math import inf, log
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from scleraforce.base.errors import InputError
from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.base.units import from_si
from scleraforce.calibration.calibration import Calibration, FrameRecord, UsedRecording
from scleraforce.calibration.filter.eye_filter import PARAMETERS
from scleraforce.calibration.stiffness_from_shape import EyePosterior
from scleraforce.fit.frames_of_an_eye import ShownFrame
from scleraforce.fit.unknowns import TIP
from scleraforce.live.companions.process_channel import Channel
from scleraforce.live.companions.process_messages import EyeLearned, OpinionAsked
from scleraforce.reading.answer import Answer
from scleraforce.reading.tissue_memory import LIGHT_N
from scleraforce.records.calibration_file import (
    open_calibration,
    summary_of,
    write_calibration,
)
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import study_hash
from scleraforce.wall.wall_in_metres import segmented_boundaries

LEARNED_FILE = "learned.json"  # in the folder of a recorded session
# within which a withdrawal takes a frame away, and after which a needle has let go
SETTLES_S = 0.5
LEAST_S = 0.1  # between two frames that teach
MOST_WAITING = 50  # of them that wait
OTHER_TIP_M = 50e-6  # between the dents of two frames that teach
NICENESS = 10
# Standard deviation of the logarithm of a declared IOP: 90 % lie between half and twice
# the true one, as with a gauge that is 2 mmHg off at 2 to 4 mmHg, as low as opened and
# dissected eyes have. The shape tells IOP/E alone, so E is no surer.
IOP_SD = log(2.0) / NINETY_PERCENT
SAME_PRESSURE = 0.01  # relative: two roundings of one IOP
KEEP = "keep"
FORGET = "forget"


class EyeLearner:
    """Chooses the frames that teach, and tells what they taught; it never waits for the
    fit.
    """

    def __init__(self, link: Connection) -> None:
        self._link = link
        self._waiting = deque[tuple[float, float, ShownFrame]](maxlen=MOST_WAITING)
        self._tips_m = list[float]()  # of the frames that taught
        self._awaited = 0
        self._taken_s = -inf
        self._light_s = inf

    def hear(self, asked: OpinionAsked) -> None:
        """Take the monitor's word on a frame: one that does not teach takes away those
        just before it.
        """
        if not asked.teaches:
            self._waiting.clear()
            self._light_s = inf
        if asked.pierced:
            self._tips_m.clear()
            self._ask(FORGET)

    def show(self, asked: OpinionAsked, answer: Answer, scale: PixelScale) -> None:
        """Take a frame as the second opinion read it, if it teaches."""
        if not (
            asked.teaches
            and answer.usable
            and answer.fit is not None
            and answer.segmentation is not None
        ):
            return

        dent_n = answer.dent_force_n
        is_light = dent_n is not None and dent_n < LIGHT_N
        self._light_s = min(self._light_s, asked.at_s) if is_light else inf

        if asked.at_s - self._light_s > SETTLES_S and not self._waiting:
            # the contact ended without a puncture
            self._link.send(KEEP)
            self._light_s = inf

        tip_m = float(answer.fit.unknown[TIP])
        before = [*self._tips_m, *(waiting[1] for waiting in self._waiting)]

        is_new = all(abs(tip_m - other_m) > OTHER_TIP_M for other_m in before)
        if (
            is_new
            and answer.can_calibrate
            and not is_light
            and asked.at_s - self._taken_s >= LEAST_S
        ):
            self._taken_s = asked.at_s
            wall = segmented_boundaries(answer.segmentation, scale)
            shown = ShownFrame(lateral_m=wall.lateral_m, depth_bc=wall.depth_m)
            self._waiting.append((asked.at_s, tip_m, shown))

    def learned(self, now_s: float) -> EyeLearned | None:
        """Return what was learned since the last call; begin to learn the frames that
        have waited long enough.
        """
        found: EyeLearned | None = None
        while self._awaited and self._link.poll():
            found = self._link.recv()
            self._awaited = self._awaited - 1

        if self._awaited:
            return None

        ripe = list[ShownFrame]()
        while self._waiting and now_s - self._waiting[0][0] > SETTLES_S:
            _, tip_m, shown = self._waiting.popleft()
            self._tips_m.append(tip_m)
            ripe.append(shown)

        if ripe:
            self._ask(ripe)

        return found

    def _ask(self, what: str | list[ShownFrame]) -> None:
        self._link.send(what)
        self._awaited += 1


@contextmanager
def learning(fitting: "EyeFitting", channel: Channel) -> Iterator[EyeLearner]:
    """Start the process that fits; it does not hold the channel open, which is of this
    process.
    """
    context = get_context("fork")
    link, theirs = context.Pipe()
    process = context.Process(
        target=_fit, args=(theirs, (link, channel), fitting), daemon=True
    )
    process.start()
    theirs.close()

    try:
        yield EyeLearner(link)
    finally:
        link.close()
        process.kill()
        process.join()


class EyeFitting:
    """The posterior of an eye as learned, and the one to return to after a puncture;
    `record`: the session's recording.

    The pressure is as sure as a declared one (`IOP_SD`). The posterior is saved in the
    folder of the recording, if there is one.
    """

    def __init__(self, begun: EyePosterior, eye: str, record: Path | None) -> None:
        self._posterior = self._kept = replace(begun, iop_sd=IOP_SD)
        self._eye = eye
        self._record = record

    def take(self, asked: str | list[ShownFrame]) -> EyeLearned | None:
        """Fit frames, or do as `KEEP` or `FORGET` says; return what is learned by then,
        None after `KEEP`.
        """
        if asked == KEEP:
            self._kept = self._posterior
            return None

        if isinstance(asked, str):
            self._posterior = self._kept
        else:
            with suppress(np.linalg.LinAlgError):
                # frames that contradict each other teach nothing
                self._posterior = self._posterior.with_frames(asked)

        posterior = self._posterior
        return EyeLearned(
            setup=posterior.known_eye, frames=len(posterior.frames), fault=self._save()
        )

    def _save(self) -> str:
        """Write the posterior beside the session's recording; return why that failed,
        or "".
        """
        if (
            self._record is None
            or not self._record.is_dir()
            or self._posterior.fit is None
        ):
            return ""

        calibration = as_calibration(self._posterior, self._eye, str(self._record))
        try:
            write_calibration(calibration.to_dict(), self._record / LEARNED_FILE)
        except (InputError, OSError) as fault:
            return f"{LEARNED_FILE} was not written: {fault}"

        return ""


def _fit(
    link: Connection, others: tuple[Connection, Channel], fitting: EyeFitting
) -> None:
    """Fit the frames that come, until the other process ends."""
    for other in others:
        other.close()

    os.nice(NICENESS)
    with suppress(EOFError, BrokenPipeError):
        while True:
            if found := fitting.take(link.recv()):
                link.send(found)


def as_calibration(posterior: EyePosterior, eye: str, path: str) -> Calibration:
    """Return a posterior with a fit, of a recording, as the calibration of its eye,
    which also states the IOP.
    """
    known = posterior.setup
    modulus = posterior.modulus
    assert posterior.fit is not None
    assert known.eye.iop_pa is not None
    at = partial(
        FrameRecord,
        recording=path,
        sha256="",
        force_n=0.0,
        mean_pa=modulus.mean_pa,
        sd_pa=modulus.sd_pa,
    )
    frames = tuple(
        at(file=f"dent of {from_si(tip_m, 'mm'):.3f} mm")
        for tip_m in posterior.fit.unknown_fn[:, TIP].tolist()
    )
    words = (
        "no force was measured: E was learned by a monitor, from the shape of dents"
        " beside the IOP"
    )
    recording = UsedRecording(
        path=path,
        sha256="",
        zero_n=0.0,
        drift_n_per_s=0.0,
        remarks=(Remark("modulus-from-shape", words, ("modulus",)),),
    )
    own = posterior.calibration(eye, [recording], frames)
    own = replace(
        own,
        names=(*own.names, PARAMETERS["iop"]),
        means=(*own.means, known.eye.iop_pa),
        sds=(*own.sds, posterior.iop_sd * known.eye.iop_pa),
    )
    bounds_n = posterior.study.classes.bounds_n

    return Calibration(
        {eye: own}, study_hash(posterior.study), bounds_n, "finite-strain"
    )


def resumed_eye(setup: Setup, path: Path, eye: str) -> Setup:
    """Return the setup with the E of an earlier session as its prior, or raise
    InputError.

    The eye as it is known without that session stays beside it. A file of another eye,
    IOP or tissue is refused, and one that no monitor has learned.
    """
    file = open_calibration(path)
    eyes = summary_of(file).eyes
    place = f"`resume` {path}: eyes"
    if eye not in eyes:
        raise InputError(f"{place}: {', '.join(eyes)}; not of {eye}, the eye of `eye`")

    own = eyes[eye]
    modulus = own.eye.modulus
    stated = file.content["eyes"][eye].get("parameters", {}).get("iop_pa")
    if (
        modulus is None
        or modulus.source != "shape"
        or not own.usable
        or not isinstance(stated, dict)
        or setup.eye.iop_pa is None
    ):
        raise InputError(
            f"{place}.{eye}: no monitor has learned it; give a {LEARNED_FILE}"
        )

    iop_mmhg = from_si(float(stated["mean"]), "mmhg")
    given_mmhg = from_si(setup.eye.iop_pa, "mmhg")
    if abs(iop_mmhg - given_mmhg) > SAME_PRESSURE * given_mmhg:
        raise InputError(
            f"{place}.{eye}: learned at {iop_mmhg:.1f} mmHg; `iop_pa` is"
            f" {given_mmhg:.1f}"
        )

    stiffening = setup.eye.stiffening or 0.0
    learned = own.eye.stiffening or 0.0
    if abs(learned - stiffening) > 1e-6:
        raise InputError(
            f"{place}.{eye}: stiffening: {learned:g}; that of this eye is"
            f" {stiffening:g}"
        )

    return replace(
        setup,
        eye=replace(
            setup.eye,
            modulus=replace(modulus, source="population"),
            thickness_m=own.eye.thickness_m,
            unlearned=setup.eye.before_learning,
        ),
    )
