"""The `[globe]` section of a study: whether the virtual eyes of `simulate` and `phantom` keep their pressure."""

from dataclasses import dataclass

from scleraforce.study.fields import check_fields, option, quantity

__all__ = ["GlobeStudy"]


@dataclass(frozen=True)
class GlobeStudy:
    """An open globe (infused or vented), as in the paper, or a sealed one, whose pressure rises with the dent.

    `rigidity_pa13_per_m3` is k of `rigidity_law` (`eye.globe`); the default is that of enucleated human eyes (van der
    Werff 1981).
    """

    kind: str = option("open", "open", "sealed")
    rigidity_pa13_per_m3: float = quantity(0.03, "mmhg13_per_ul", 1e-4, 1.0)
    rigidity_law: str = option("cube-root", "cube-root", "logarithmic")

    def __post_init__(self) -> None:
        check_fields(self)
