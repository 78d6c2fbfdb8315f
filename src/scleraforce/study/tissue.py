"""The `[tissue]` section of a study: how the wall of the virtual eyes of `simulate` and `phantom` stiffens."""

from dataclasses import dataclass

from scleraforce.study.fields import check_fields, quantity


@dataclass(frozen=True)
class TissueStudy:
    """The wall's material beside Young's modulus and Poisson's ratio, in finite strain.

    `stiffening` is b of `mechanics.stiffening`, without a unit; 0: neo-Hookean. In tension, at a strain of 5 %, the
    tangent modulus is 0.92 E with b = 0, and 0.93, 1.12 and 1.62 E with 1, 10 and 30.
    """

    stiffening: float = quantity(0.0, None, 0.0, 200.0)

    def __post_init__(self) -> None:
        check_fields(self)
