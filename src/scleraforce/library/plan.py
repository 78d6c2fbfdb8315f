"""What a library holds: its axes, and one load path for each pair of thickness and IOP ratio."""

import json
from dataclasses import asdict, dataclass
from hashlib import sha256
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from scleraforce.study import LibraryStudy, Study

__all__ = ["LibraryPlan", "plan_library"]

Floats = NDArray[np.float64]

TIP_GRADING = 1.5  # tips stand like the numbers 0, 1, 2 ... to this power


@dataclass(frozen=True)
class LibraryPlan:
    """All that the load paths of a library depend on, and nothing else of the study."""

    radius_m: float
    poisson_ratio: float
    needle_radius_m: float
    grid: LibraryStudy

    @property
    def thickness_m(self) -> Floats:
        """Wall thicknesses (t,), m."""
        return np.geomspace(*self.grid.thickness_m.bounds, self.grid.thicknesses)

    @property
    def iop_ratio(self) -> Floats:
        """Ratios IOP/E (p,)."""
        return np.geomspace(*self.grid.iop_ratio.bounds, self.grid.iop_ratios)

    @property
    def tip_m(self) -> Floats:
        """Tips at which every path is stored (d,), m; the first is 0."""
        tips: Floats = self.grid.max_tip_m * np.linspace(0.0, 1.0, self.grid.tips) ** TIP_GRADING
        return tips

    @property
    def nodes(self) -> int:
        """Nodes of a boundary."""
        return 2 * self.grid.elements + 1

    @property
    def paths(self) -> int:
        """Number of load paths; path number k has thickness k // iop_ratios and ratio k % iop_ratios."""
        return self.grid.thicknesses * self.grid.iop_ratios

    def wall(self, path: int) -> tuple[float, float]:
        """Return the thickness, m, and the IOP ratio of a path.

        >>> plan = plan_library(Study())
        >>> tuple(float(value) for value in plan.wall(0))
        (0.00035, 8e-05)
        """
        thickness, ratio = divmod(path, self.grid.iop_ratios)
        return float(self.thickness_m[thickness]), float(self.iop_ratio[ratio])

    @property
    def recipe(self) -> str:
        """The plan as JSON, the same for equal plans."""
        return json.dumps(asdict(self), sort_keys=True)

    @property
    def key(self) -> str:
        """SHA-256, in hexadecimal, of the recipe and of the source code that turns it into load paths."""
        digest = sha256(self.recipe.encode())
        package = files("scleraforce")
        sources = [package / "library" / "plan.py", package / "library" / "build.py"]
        sources += [entry for entry in (package / "mechanics").iterdir() if entry.name.endswith(".py")]
        for source in sorted(sources, key=lambda entry: entry.name):
            digest.update(source.name.encode() + b"\0" + source.read_bytes())
        return digest.hexdigest()


def plan_library(study: Study) -> LibraryPlan:
    """Return the plan that a study asks for; `[library]`, and of `[eye]` and `[needle]` the sizes and nu matter."""
    eye, needle = study.eye, study.needle
    return LibraryPlan(eye.radius_m, eye.poisson_ratio, 0.5 * needle.outer_diameter_m, study.library)
