"""What is not known of an experiment, and what each missing input costs: one list for
import, calibration, reading, the app and reports.

Figures: `python -m figures missing-inputs` on 20 eyes for IOP, thickness, gap and
globe; docs/limits.md for the relaxation.
"""

from scleraforce.records.remark import Remark
from scleraforce.records.setup import Setup

MISSING = "missing-input"

# by the fields of records, with the keys of recording.toml
COSTS = {
    "iop_pa": (
        "the IOP is not stated (eye.iop_pa): virtual eyes are read 1.2 instead of 0.2"
        " mN off; `calibrate` finds it together with E, and 0.2 mN remain"
    ),
    "globe": (
        "open or sealed is not stated (eye.globe): open virtual eyes are read 1.8"
        " instead of 0.2 mN off, and intervals cover both; a calibration may find it"
    ),
    "gap_m": (
        "the gap of the B-scan is not stated (needle.slice_gap_m): virtual eyes are"
        " read 0.3 instead of 0.2 mN off"
    ),
    "thickness_m": (
        "the wall's thickness is not stated (eye.thickness_m): `calibrate` needs it;"
        " virtual eyes are read 0.3 instead of 0.2 mN off, and nothing checks the wall"
    ),
    "relaxation": (
        "relaxing tissue is neither stated nor excluded (eye.relaxation): of tissue"
        " that loses 27 %, 30 mN are read as little as 22; a calibration on held pushes"
        " may find it"
    ),
    "clock_offset_s": (
        "the offset between the clocks of frames and forces is not known"
        " (`clock_offset_s`): at 15 mN/s a label is 1.5 mN off for each 0.1 s"
    ),
}
# A classifier reads every eye with one modulus, pressure and gap, and an open globe.
READ_BY_CLASSIFIER = ("thickness_m",)


def missing_inputs(
    setup: Setup,
    *,
    forces: bool,
    classifier: bool = False,
    clock_known: bool = True,
) -> tuple[Remark, ...]:
    """Return a remark on each input that is not declared, with what it costs.

    Args:
        setup: what is known, by declaration or by a calibration.
        forces: there is a force log.
        classifier: the model is a classifier, which uses the thickness alone.
        clock_known: the offset between the clocks of frames and log is known, as it is
            of every recording; False while one is made.

    >>> from scleraforce.records.eye import Eye
    >>> known = Setup(eye=Eye(iop_pa=266.0, thickness_m=6e-4))
    >>> for remark in missing_inputs(known, forces=False):
    ...     print(remark.fields)
    ('globe',)
    ('gap_m',)
    ('relaxation',)
    """
    eye = setup.eye
    values = {
        "iop_pa": eye.declared_iop_pa,
        "globe": eye.globe,
        "gap_m": setup.scan.planes or setup.needle.gap_m,
        "thickness_m": eye.thickness_m,
        "relaxation": eye.relaxation,
    }
    missing = [
        name
        for name, value in values.items()
        if value is None and (not classifier or name in READ_BY_CLASSIFIER)
    ]
    if forces and not clock_known:
        missing.append("clock_offset_s")

    return tuple(Remark(MISSING, COSTS[name], (name,)) for name in missing)
