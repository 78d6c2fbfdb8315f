"""The settings of a monitor, from what its user declares: the same for the command and
for `sf.monitor`.
"""

import re
from dataclasses import replace
from datetime import UTC, datetime
from secrets import token_hex
from typing import Final

from platformdirs import user_state_path

from scleraforce.base.errors import InputError
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor import MonitorSettings
from scleraforce.live.monitor_request import MonitorRequest, StatedLimits
from scleraforce.reading.eye_reader import (
    check_mechanics,
    foreign_remark,
    other_reader,
)
from scleraforce.reading.load_model import load_reader, suited_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.reading.trained_ranges import READER
from scleraforce.records.calibration_file import (
    choice_of_eye,
    known_of_eye,
    read_calibration,
)
from scleraforce.records.needle import gauge_diameter_m, is_gauge, nearest_gauge
from scleraforce.records.remark import Remark
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup

EYE_NAME: Final = "eye-1"
# device names that OpenIGTLink can send and a table needs no quotes for
DEVICE_NAME = re.compile(r"[\w.+-]{1,20}", re.ASCII)
# a scanner may use more bits than the model's study states, and its recording must stay
# readable
MOST_BITS = 16


def prepare_monitor(request: MonitorRequest) -> tuple[Reader, MonitorSettings]:
    """Return the reader and the settings of the monitor that is asked for.

    Raises:
        InputError: the model cannot serve the loop or was not trained for the eye, a
            value is stated twice or of no use to a monitor, or one is missing.
    """
    # the loop has no time for a finder; the second opinion loads its own
    asked = load_reader(request.model, finder=None)
    if not asked.serves_loop:  # it would be its own second opinion
        raise InputError(
            f"{asked.path}: kind: {asked.kind}; the monitor needs a reader: nothing"
            " else in this model could check what its network reads in the loop"
        )

    _refuse_unused(request)
    setup, other_modulus = _with_calibration(request, asked)
    if request.resume is not None and not request.learn_eye:
        raise InputError("`resume`: needs `learn_eye`")
    if request.learn_eye:
        setup = _with_prior_to_learn(asked, setup, request)

    reader = suited_reader(asked, setup)
    _check_planes(reader, request)
    # a class is read in one way only
    expects_opinion = request.second_opinion and reader.reads_force
    if setup.eye.radius_m is not None and not expects_opinion:
        raise InputError(
            "eye.radius_m: only the second opinion reads with it, and there is none;"
            " leave it out"
        )
    if reason := reader.refusal(setup):  # all frames would be unusable
        raise InputError(f"{reader.path}: {reason}")

    scan = _session_scan(reader, setup.scan)
    begun = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    # of the scan, a reading is told the direction alone: frames bring their own size
    setup = replace(setup, scan=Scan(direction_rad=scan.direction_rad))
    return reader, MonitorSettings(
        eye=setup.eye.name or EYE_NAME,
        setup=setup,
        limits=_limits(reader, setup, scan, request.limits, expects_opinion),
        scan=scan,
        address=request.address,
        console=request.console,
        black_box=(
            request.black_box or user_state_path("scleraforce") / "monitor" / begun
        ),
        record=request.record,
        learns=request.learn_eye,
        token=token_hex(16),  # it cannot be guessed
        remarks=(
            *other_reader(asked, reader),
            *other_modulus,
            *_unknown_lean(setup),
            *reader.limits(setup, scan, setup.needle.gauge),
        ),
    )


def _refuse_unused(request: MonitorRequest) -> None:
    """Raise an `InputError` that names a declared field that no monitor uses."""
    eye = request.setup.eye
    needle = request.setup.needle
    scan = request.setup.scan
    calibrated = request.calibration is not None
    refused = {
        "eye.globe.leak_time_s: a monitor follows no leak; leave it out": (
            eye.leak_time_s is not None
        ),
        "eye.discrepancy: the calibration gives it; leave out one of the two": (
            calibrated and eye.discrepancy is not None
        ),
        "eye.calibrated_lean_rad: the calibration gives it; leave out one of the two": (
            calibrated and eye.calibrated_lean_rad is not None
        ),
        (
            "needle.azimuth_rad: nothing to a reading, whose walls are of revolution;"
            " leave it out"
        ): needle.azimuth_rad is not None,
        (
            "needle.lean_azimuth_rad: of the lateral axis of a single plane; leave it"
            " or scan.planes out"
        ): needle.lean_azimuth_rad is not None and scan.planes,
        (
            "scan.transposed: frames are read as the scanner sends them, their rows"
            " going down into the eye; leave it out"
        ): scan.transposed,
        (
            f"scan.bits: a monitor takes pixels of up to {MOST_BITS} bits, whatever a"
            " scanner uses of them; leave it out"
        ): scan.bits not in (None, MOST_BITS),
    }

    for reason, holds in refused.items():
        if holds:
            raise InputError(reason)

    diameter_m = needle.diameter_m
    if diameter_m is not None and not is_gauge(diameter_m):
        gauge = nearest_gauge(diameter_m)
        raise InputError(
            f"needle.diameter_m: {diameter_m:g}; recordings of a session state the"
            f" gauge, and that of the nearest, {gauge}, is"
            f" {gauge_diameter_m(gauge):g} m"
        )


def _with_calibration(
    request: MonitorRequest, reader: Reader
) -> tuple[Setup, list[Remark]]:
    """Return the experiment with what the calibration found of the eye, and a remark
    if that is not the eye's own.
    """
    setup = request.setup
    if request.calibration is None:
        return setup, []

    # 380 ms: not without a calibration
    from scleraforce.front.api.reading_frames import check_calibrated

    check_calibrated(setup, calibrated=True)
    summary = read_calibration(request.calibration)
    check_mechanics(summary, reader)
    eye = setup.eye.name
    if eye is None:
        raise InputError(f"`eye`: missing; {choice_of_eye(summary)}")

    foreign = foreign_remark(summary, eye)
    remarks = [] if foreign is None else [foreign]
    return known_of_eye(setup, summary, eye), remarks


def _with_prior_to_learn(
    reader: Reader, setup: Setup, request: MonitorRequest
) -> Setup:
    """Return the experiment with the prior of an E that is to be learned."""
    # 430 ms: not unless an eye is learned
    from scleraforce.live.companions.eye_learning import resumed_eye

    eye = setup.eye
    refused = {
        f"{reader.path} is a {reader.kind}, which reads no force": (
            not reader.reads_force
        ),
        "needs the second opinion (`second_opinion`)": not request.second_opinion,
        "E is given with `youngs_modulus_pa`": request.setup.eye.modulus is not None,
        "the calibration has this eye's own E": eye.has_own_modulus,
        "`iop_pa` is missing: E is found beside the known pressure": eye.iop_pa is None,
        "`eye` is missing: `resume` needs its name": (
            request.resume is not None and eye.name is None
        ),
        "it learns from a single plane; leave it or `planes` out": setup.scan.planes,
    }

    for reason, holds in refused.items():
        if holds:
            raise InputError(f"`learn_eye`: {reason}")

    population = reader.study.calibration.prior()
    setup = replace(setup, eye=replace(eye, modulus=eye.modulus or population))
    if request.resume is not None and eye.name is not None:
        return resumed_eye(setup, request.resume, eye.name)

    return setup


def _check_planes(reader: Reader, request: MonitorRequest) -> None:
    """Raise an `InputError` unless a model can read the planes of a scanner that takes
    several, each named like a device.
    """
    planes = request.setup.scan.planes
    if not planes:
        return

    named = next(
        (plane.name for plane in planes if not DEVICE_NAME.fullmatch(plane.name)), None
    )
    if named is not None:
        raise InputError(
            f"`planes`: {named!r} cannot name a device; use 1 to 20 of the characters"
            " A-Z a-z 0-9 . _ + -"
        )
    if reader.kind != READER:
        raise InputError(
            f"`planes`: {reader.path} is a {reader.kind}, which reads single planes"
        )
    if request.setup.needle.gap_m is not None:
        raise InputError("`gap_m`: several planes show their gaps; leave it out")


def _session_scan(reader: Reader, declared: Scan) -> Scan:
    """Return the frames of a session: as declared, else as in the model's study."""
    study = reader.study.oct
    return replace(
        declared,
        columns=declared.columns or study.columns,
        rows=declared.rows or study.rows,
        width_m=declared.width_m or study.width_m,
        depth_m=declared.depth_m or study.depth_m,
        refractive_index=declared.refractive_index or study.refractive_index,
        bits=MOST_BITS,
    )


def _limits(
    reader: Reader,
    setup: Setup,
    scan: Scan,
    stated: StatedLimits,
    expects_opinion: bool,
) -> MonitorLimits:
    return MonitorLimits(
        withdraw_class=stated.withdraw_class or reader.classes - 1,
        bound_n=stated.bound_n or reader.study.classes.bounds_n[-1],
        unusable_frames=stated.unusable_frames,
        unusable_opinions=stated.unusable_opinions,
        loss_in_window_s=stated.loss_in_window_s,
        reaction_s=stated.reaction_s,
        retraction_m_s=stated.retraction_m_s,
        reports_pierced=stated.reports_pierced,
        stiffness_n_m=reader.steepest_n_m(setup) or MonitorLimits.stiffness_n_m,
        size=scan.shape,
        scale_m=(scan.scale.lateral_m, scan.scale.depth_m),
        reads_force=reader.reads_force,
        expects_opinion=expects_opinion,
    )


def _unknown_lean(setup: Setup) -> list[Remark]:
    if setup.needle.lean_rad is not None or setup.eye.has_calibrated_modulus:
        return []
    words = (
        "the needle's lean is not given: forces are their parts along the wall's normal"
        " (docs/limits.md)"
    )
    return [Remark("lean-unknown", words, ("lean_rad",))]
