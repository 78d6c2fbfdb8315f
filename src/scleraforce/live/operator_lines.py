"""The lines that a monitor's operator reads at its start."""

from collections.abc import Iterator

from scleraforce.base.units import from_si
from scleraforce.live.monitor import MonitorSettings
from scleraforce.live.monitor_request import Address
from scleraforce.reading.reading_models import Reader
from scleraforce.records.eye import MODULUS_SOURCES
from scleraforce.records.globe import UNKNOWN
from scleraforce.records.setup import Setup

UNKNOWN_GLOBE = (
    "unknown: give `globe`; intervals are wider and withdrawals come earlier"
)


def start_lines(
    reader: Reader, settings: MonitorSettings, address: Address, code: str
) -> Iterator[str]:
    """Yield what a monitor says that begins to listen on `address`: what it reads, its
    limits, the remarks, and at last the secrets of its reset, of which `code` is a
    line.
    """
    limits = settings.limits
    scan = settings.scan
    yield "research use only: not a medical device"
    yield f"model      {reader.words}"
    yield f"eye        {settings.eye}: {_eye_words(settings.setup)}"

    if scan.planes:
        places = [
            (
                plane.name,
                from_si(plane.offset_m, "mm"),
                from_si(plane.direction_rad, "deg"),
            )
            for plane in scan.planes
        ]
        yield "planes     " + ", ".join(
            f"{name} ({mm:g} mm, {deg:.0f}°)" for name, mm, deg in places
        )

    yield f"globe      {globe_words(settings.setup, reader.reads_force)}"
    relaxation = settings.setup.eye.relaxation
    if relaxation is not None and relaxation.matters:
        most = max(sum(relaxation.shares), sum(relaxation.other))
        lost = from_si(most, "percent")
        yield (
            f"tissue     a held needle loses up to {lost:.0f} % of its force; intervals"
            " are wide at the start"
        )

    for remark in settings.remarks:
        if remark.severity != "info":
            yield f"warning    {remark}"

    lateral_um = from_si(scan.scale.lateral_m, "um")
    depth_um = from_si(scan.scale.depth_m, "um")
    yield (
        f"frames     {scan.columns} x {scan.rows} px of {lateral_um:.2f} x"
        f" {depth_um:.2f} µm"
    )

    bound_mn = from_si(limits.bound_n, "mn")
    forces = (
        f", or where the force's interval reaches {bound_mn:.1f} mN"
        if limits.reads_force
        else ""
    )
    yield f"withdraws  at class {limits.withdraw_class}{forces}"
    yield f"listens    on {address.host}:{address.port} (OpenIGTLink)"
    yield f"black box  {settings.black_box}"
    yield code
    yield (
        f"reset      scleraforce monitor-reset `port={address.port}` asks for the code,"
        f" or for the token {settings.token}"
    )


def _eye_words(setup: Setup) -> str:
    words = "modulus unknown"
    if setup.eye.modulus is not None:
        words = (
            f"{from_si(setup.eye.modulus.mean_pa, 'mpa'):.3f} MPa"
            f" ({MODULUS_SOURCES[setup.eye.modulus.source]})"
        )

    iop = (
        "IOP unknown"
        if setup.eye.iop_pa is None
        else f"IOP {from_si(setup.eye.iop_pa, 'mmhg'):.1f} mmHg"
    )
    wall = (
        "thickness unknown"
        if setup.eye.thickness_m is None
        else f"{from_si(setup.eye.thickness_m, 'um'):.0f} µm thick"
    )
    gap = (
        "gap unknown"
        if setup.needle.gap_m is None
        else f"gap {from_si(setup.needle.gap_m, 'mm'):.2f} mm"
    )

    return ", ".join((words, iop, wall, gap))


def globe_words(setup: Setup, reads_force: bool) -> str:
    """Return the globe with which a model reads an eye, and the cost of an unknown one.

    >>> from scleraforce.records.eye import Eye
    >>> from scleraforce.records.globe import SEALED
    >>> globe_words(Setup(eye=Eye(globe=SEALED)), reads_force=True)
    'sealed, k between 0.005 and 0.06 mmHg^(1/3)/µl'
    """
    globe = UNKNOWN if setup.eye.globe is None else setup.eye.globe
    if not reads_force:
        return (
            "taken for open: a classifier knows no other, and in a sealed eye forces"
            " are read too low"
        )
    if not globe.can_be_sealed:
        return "open"

    ends = (
        globe.band
        if globe.calibrated or globe.rigidity_told
        else (globe.lowest, globe.highest)
    )
    low, high = (f"{from_si(end, 'mmhg13_per_ul'):.2g}" for end in ends)
    k = f"k between {low} and {high} mmHg^(1/3)/µl"

    if globe.calibrated:
        return (
            f"{'open or sealed' if globe.kind == 'unknown' else globe.kind}, {k}"
            " (calibrated)"
        )

    return f"sealed, {k}" if globe.kind == "sealed" else UNKNOWN_GLOBE
