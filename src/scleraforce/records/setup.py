"""An experiment, as far as it is known: the eye, the needle on it, and the scan beside
the needle.
"""

from dataclasses import dataclass, field, fields, replace
from math import pi, remainder
from typing import TYPE_CHECKING, TypeVar

from scleraforce.records.eye import UNCERTAIN, Eye, Modulus
from scleraforce.records.globe import Globe
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

if TYPE_CHECKING:
    from scleraforce.records.study import Study

Part = TypeVar("Part", Eye, Needle, Scan)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What a reading is told of an experiment.

    The scan has the direction of the B-scan that is read; a reading's frames bring
    their own size.
    """

    eye: Eye = field(default_factory=Eye)
    needle: Needle = field(default_factory=Needle)
    scan: Scan = field(default_factory=Scan)

    def turned(self, turn_rad: float) -> "Setup":
        """Return the experiment beside a plane at another angle about the needle's
        axis, whose gap is unknown.
        """
        direction_rad = self.scan.direction_rad
        if direction_rad is not None:
            direction_rad += turn_rad
            # both may be up to a turn, and a scan's direction no more than that
            if abs(direction_rad) > 2.0 * pi:
                direction_rad = remainder(direction_rad, 2.0 * pi)

        scan = replace(self.scan, direction_rad=direction_rad)
        return replace(self, scan=scan, needle=replace(self.needle, gap_m=None))

    def completed_by(self, stated: "Setup") -> "Setup":
        """Return the given inputs, completed by the stated ones, also by a globe of the
        same kind.

        >>> given = Setup(needle=Needle(gap_m=0.4e-3))
        >>> stated = Setup(eye=Eye(iop_pa=266.0), needle=Needle(gap_m=0.5e-3))
        >>> both = given.completed_by(stated)
        >>> both == Setup(eye=Eye(iop_pa=266.0), needle=Needle(gap_m=0.4e-3))
        True
        """
        return Setup(
            eye=_completed_eye(self.eye, stated.eye),
            needle=_completed(self.needle, stated.needle),
            scan=replace(
                _completed(self.scan, stated.scan),
                planes=self.scan.planes or stated.scan.planes,
                transposed=self.scan.transposed or stated.scan.transposed,
            ),
        )


NOTHING_KNOWN = Setup()


def completed_by_study(setup: Setup, study: "Study") -> Setup:
    """Return an experiment with the study's modulus, IOP and gap, and the middle of its
    polar angles, where these are not declared.

    A study has no thickness and no name of one eye; its globe is applied where the wall
    is bent.
    """
    low, high = study.needle.polar_angle_rad.bounds
    of_study = Setup(
        eye=Eye(
            modulus=Modulus.stated(study.eye.youngs_modulus_pa), iop_pa=study.eye.iop_pa
        ),
        needle=Needle(gap_m=study.needle.gap_m, polar_rad=(low + high) / 2),
    )
    return setup.completed_by(of_study)


def _completed(given: Part, stated: Part) -> Part:
    """Return a record with the stated values where none is given."""
    missing = {
        item.name: getattr(stated, item.name)
        for item in fields(given)
        if getattr(given, item.name) is None
    }
    return replace(given, **missing)


def _completed_eye(given: Eye, stated: Eye) -> Eye:
    """Return the given eye, completed by the stated one; an uncertainty is that of its
    own value.
    """
    eye = _completed(given, stated)
    sds = {
        sd: getattr(given, sd)
        for value, sd in UNCERTAIN.items()
        if getattr(given, value) is not None
    }
    globe = _completed_globe(given.globe, stated.globe)
    return replace(eye, globe=globe, **sds)


def _completed_globe(given: Globe | None, stated: Globe | None) -> Globe | None:
    """Return the given globe, else the stated one; of two of one kind each value that
    is given, else the stated one. The cube-root law is what nobody declares.
    """
    if given is None or stated is None or given.kind != stated.kind:
        return given or stated
    rigidity = given if given.rigidity_told else stated
    is_usual = given.law == RIGIDITY_LAWS[0]
    leak_time_s = given.leak_time_s
    return replace(
        rigidity,
        law=stated.law if is_usual else given.law,
        leak_time_s=stated.leak_time_s if leak_time_s is None else leak_time_s,
    )
