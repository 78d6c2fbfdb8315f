"""The `[globe]` section of a study: whether the virtual eyes of `simulate` and `phantom` keep their pressure."""

from dataclasses import dataclass, replace

from scleraforce.study.fields import check_fields, option, quantity

GLOBES = ("open", "sealed")
RIGIDITY_LAWS = ("cube-root", "logarithmic")


@dataclass(frozen=True)
class GlobeStudy:
    """An open globe (infused or vented), as in the paper, or a sealed one, whose pressure rises with the dent.

    `rigidity_pa13_per_m3` is k of `rigidity_law` (`eye.globe`); the default is that of enucleated human eyes (van der
    Werff 1981).
    """

    kind: str = option("open", *GLOBES)
    rigidity_pa13_per_m3: float = quantity(0.03, "mmhg13_per_ul", 1e-4, 1.0)
    rigidity_law: str = option("cube-root", *RIGIDITY_LAWS)

    def __post_init__(self) -> None:
        check_fields(self)

    def told(self, kind: str | None, rigidity_pa13_per_m3: float | None) -> "GlobeStudy":
        """Return the globe with what was told of it; None: nothing.

        Raises:
            StudyError: a value is out of bounds, as in a study file.
        """
        told = {"kind": kind, "rigidity_pa13_per_m3": rigidity_pa13_per_m3}
        return replace(self, **{name: value for name, value in told.items() if value is not None})  # type: ignore[arg-type]
