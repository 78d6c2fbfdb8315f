"""Keywords of everyday use, in place of a record that would hold one value alone.

`sf.read(model, frame, iop_pa=2000.0)` is `sf.read(model, frame,
eye=sf.Eye(iop_pa=2000.0))`. All public functions take these keywords by this one
helper.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, TypedDict, TypeVar

from scleraforce.base.errors import InputError
from scleraforce.front.api.progress import check_rigidity
from scleraforce.reading.needle_lean import MOST_LEAN_RAD
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.fields import check_quantity
from scleraforce.records.globe import Globe
from scleraforce.records.needle import Needle, lean_ends
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup

Part = TypeVar("Part", bound=Any)


class ScanShorthand(TypedDict, total=False):
    """Fields of a `Scan`."""

    width_m: float | None
    depth_m: float | None
    refractive_index: float | None


class EyeShorthand(TypedDict, total=False):
    """Fields of an `Eye`, and the gap of its `Needle`; `globe` by its kind, the modulus
    without its uncertainty.
    """

    youngs_modulus_pa: float | None
    iop_pa: float | None
    thickness_m: float | None
    globe: Literal["open", "sealed"] | str | None
    gap_m: float | None


class SetupShorthand(EyeShorthand, ScanShorthand, total=False):
    """Fields of an eye, a needle and a scan."""


OF_EYE = ("iop_pa", "thickness_m")
OF_NEEDLE = ("gap_m",)
OF_SCAN = ("width_m", "depth_m", "refractive_index")
MODULUS = "youngs_modulus_pa"
GLOBE = "globe"
KEYWORDS = (MODULUS, GLOBE, *OF_EYE, *OF_NEEDLE, *OF_SCAN)


def setup_of_options(given: Mapping[str, Any]) -> Setup:
    """Return what options of the command line, by the names of their arguments, declare
    of an eye, a needle and the direction of a plane; a lean may be "unknown".
    """
    modulus_pa = given["youngs_modulus_pa"]
    globe = given["globe"]
    rigidity = given["rigidity_pa13_per_m3"]
    lean_rad = given["lean_rad"]
    check_rigidity(globe, rigidity)

    return Setup(
        eye=Eye(
            modulus=None if modulus_pa is None else Modulus.stated(modulus_pa),
            iop_pa=given["iop_pa"],
            thickness_m=given["thickness_m"],
            globe=None if globe is None else Globe.declared(globe, rigidity),
            stiffening=given["stiffening"],
        ),
        needle=Needle(
            gap_m=given["gap_m"],
            polar_rad=given["polar_angle_rad"],
            lean_rad=(
                (0.0, MOST_LEAN_RAD) if lean_rad == "unknown" else lean_ends(lean_rad)
            ),
        ),
        scan=Scan(direction_rad=given["plane_direction_rad"]),
    )


def declared_setup(
    eye: Eye | str | None,
    needle: Needle | None,
    scan: Scan | None,
    shorthand: Mapping[str, Any],
    names: Sequence[str] = KEYWORDS,
) -> Setup:
    """Return an experiment of its records and of keywords, which may be of these
    `names`; an eye may be its name.

    Raises:
        InputError: a keyword and its record state one value, or it is out of bounds.
        TypeError: there is no such keyword.

    >>> declared_setup("eye-a", None, None, {"iop_pa": 2000.0}).eye.iop_pa
    2000.0
    """
    for name in shorthand:
        if name not in names:
            raise TypeError(
                f"unexpected keyword {name!r}; docs/python.md lists the records and"
                " their short forms"
            )

    given = {name: value for name, value in shorthand.items() if value is not None}
    of_eye = {name: value for name, value in given.items() if name in OF_EYE}
    if MODULUS in given:
        check_quantity(MODULUS, given[MODULUS])
        of_eye["modulus"] = Modulus.stated(given[MODULUS])
    for name in OF_NEEDLE:
        if name in given:
            check_quantity(name, given[name])
    if GLOBE in given:
        of_eye[GLOBE] = Globe.declared(given[GLOBE])

    if MODULUS in given and isinstance(eye, Eye) and eye.modulus is not None:
        raise stated_twice(MODULUS, "eye.modulus")

    named = Eye(eye) if isinstance(eye, str) else eye
    for name, part, kind in (
        ("eye", named, Eye),
        ("needle", needle, Needle),
        ("scan", scan, Scan),
    ):
        if part is not None and not isinstance(part, kind):
            raise InputError(
                f"{name}: found {type(part).__name__} {part!r:.40}; expected"
                f" {kind.__name__}{', or its name' * (kind is Eye)}"
            )
    return Setup(
        eye=with_values(named or Eye(), of_eye, "eye"),
        needle=with_values(
            needle or Needle(),
            {name: given[name] for name in OF_NEEDLE if name in given},
            "needle",
        ),
        scan=with_values(
            scan or Scan(),
            {name: given[name] for name in OF_SCAN if name in given},
            "scan",
        ),
    )


def with_values(record: Part, given: Mapping[str, Any], name: str) -> Part:
    """Return a record with the given values but for None; it must not state them
    itself.
    """
    told = {field: value for field, value in given.items() if value is not None}
    for field in told:
        if getattr(record, field) not in (None, ()):
            raise stated_twice(field, name)
    return replace(record, **told)


def stated_twice(keyword: str, record: str) -> InputError:
    """Return the error of a value that a keyword and a record both state."""
    return InputError(
        f"{keyword}: stated twice, by the keyword and by {record}; leave out one of the"
        " two"
    )
