"""The `[supports]` section of a study: what holds the virtual eyes of `simulate` and `phantom`."""

from dataclasses import dataclass

from scleraforce.study.fields import check_fields, option, quantity


@dataclass(frozen=True, kw_only=True)
class SupportsStudy:
    """The paper's clamped base; or what an eye has in the head: an elastic bed, straps of the rectus muscles, or both.

    `bed`, `bed-and-straps`: a whole globe whose lower half lies on springs, so many Pa for a metre that the wall goes
    into them and (shear) along them. `straps`: beside the clamped base; `strap_stiffness_n_per_m` is that of one
    muscle. `medial_azimuth_rad`: where the medial rectus is inserted; superior, lateral and inferior follow, a quarter
    turn each.

    The bed's defaults: an eye gives way by some tenths of a millimetre under 0.1 N, as under an air-puff tonometer, and
    turns about its axis by 1 degree under 0.6 g cm (Simonsz, Vision Research 24, 1984, 961). Straps: muscles, passive
    or held in the primary position, of 0.03 to 1 g a degree each (20 N/m is 0.4).
    """

    kind: str = option("clamped", "clamped", "bed", "straps", "bed-and-straps")
    bed_stiffness_pa_per_m: float = quantity(1.4, "kpa_per_mm", 1e-3, 1e6)
    bed_shear_stiffness_pa_per_m: float = quantity(0.04, "kpa_per_mm", 1e-3, 1e6)
    strap_stiffness_n_per_m: float = quantity(20.0, None, 0.0, 1e6)
    medial_azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def has_bed(self) -> bool:
        """Whether the eye is a whole globe on a bed."""
        return self.kind in ("bed", "bed-and-straps")

    @property
    def has_straps(self) -> bool:
        """Whether the rectus muscles hold the eye, too."""
        return self.kind in ("straps", "bed-and-straps")
