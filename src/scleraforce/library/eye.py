"""One eye of the response library: the force of a dent and the dent of a force, in SI units."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from scleraforce.arrays import Floats
from scleraforce.library.responses import Library, check_inside
from scleraforce.library.sealed import iop_ratio_at_dent, iop_ratio_under_force
from scleraforce.mechanics.globe import OPEN_GLOBE, Globe
from scleraforce.units import HumanUnit

DENTS, ROUNDS = 400, 2  # of the search for the deepest dent: each round divides the interval around it


@dataclass(frozen=True, eq=False)
class LibraryEye:
    """One eye of a `Library` (`Library.eye`). Dents count from the undented wall at the pressure under the needle.

    `iop_pa` is the pressure without the needle. Arguments of the methods are numbers or arrays, answers of their shape.
    """

    library: Library
    thickness_m: float
    youngs_modulus_pa: float
    iop_pa: float
    globe: Globe = OPEN_GLOBE

    @cached_property
    def max_dent_m(self) -> float:
        """Deepest dent, m: the library's, or where the pressure of a sealed globe runs away or leaves the library."""
        low, high = 0.0, float(self.library.tip_m[-1])
        for _ in range(ROUNDS):
            dents_m = np.linspace(low, high, DENTS)
            beyond = np.isnan(self._ratios(dents_m))
            if not beyond.any():
                return high
            low, high = (float(dents_m[np.argmax(beyond) - back]) for back in (1, 0))
        return low

    @cached_property
    def max_force_n(self) -> float:
        """Largest force of the dents up to `max_dent_m`, N, at most the library's F/E."""
        forces_n = self.force_n(np.linspace(0.0, self.max_dent_m, DENTS))
        return min(float(forces_n.max()), self.library.max_force_ratio * self.youngs_modulus_pa)

    def force_n(self, dent_m: Floats | float) -> Floats:
        """Return the force, N, on dents, m; beyond `max_dent_m` raise `InputError`."""
        dents_m = self._checked("dent", dent_m, self.max_dent_m, "mm", "mm")
        forces: Floats = self.library.forces(*self._walls(self._ratios(dents_m)), dents_m)
        return (forces * self.youngs_modulus_pa).reshape(np.shape(dent_m))[()]

    def dent_m(self, force_n: Floats | float) -> Floats:
        """Return the dent, m, under forces, N: the first one on loading; above `max_force_n` raise `InputError`."""
        ratios = self._checked("force", force_n, self.max_force_n, "mn", "mN") / self.youngs_modulus_pa
        resting = np.full(len(ratios), self.iop_pa / self.youngs_modulus_pa)
        globe = self.globe.over(self.youngs_modulus_pa)
        under = iop_ratio_under_force(self.library, *self._walls(resting), ratios, globe)
        dents_m = np.minimum(self.library.tips(*self._walls(under), ratios), self.max_dent_m)
        return dents_m.reshape(np.shape(force_n))[()]

    def pressure_pa(self, dent_m: Floats | float) -> Floats:
        """Return the pressure under the needle, Pa, at dents, m; errors as of `force_n`."""
        ratios = self._ratios(self._checked("dent", dent_m, self.max_dent_m, "mm", "mm"))
        return (ratios * self.youngs_modulus_pa).reshape(np.shape(dent_m))[()]

    def _walls(self, iop_ratio: Floats) -> tuple[Floats, Floats]:
        return np.full(len(iop_ratio), self.thickness_m), iop_ratio

    def _ratios(self, dents_m: Floats) -> Floats:
        resting = np.full(len(dents_m), self.iop_pa / self.youngs_modulus_pa)
        return iop_ratio_at_dent(self.library, *self._walls(resting), dents_m, self.globe.over(self.youngs_modulus_pa))

    @staticmethod
    def _checked(name: str, values: Floats | float, most: float, unit: HumanUnit, printed: str) -> Floats:
        found = np.asarray(values, dtype=np.float64).reshape(-1)
        check_inside(name, found, 0.0, most, unit, printed, "this eye's")
        return np.clip(found, 0.0, most)
