"""Levels of a scene's tissue, against the sclera's backscatter."""

from dataclasses import dataclass

import numpy as np

from scleraforce.laboratory.scenes.picture import level
from scleraforce.laboratory.scenes.window import Curve
from scleraforce.study import SceneTissueStudy


@dataclass(frozen=True, kw_only=True)
class Light:
    """What is drawn into a scene's tissue.

    `snr_db`: of the sclera at the surface over the mean noise; `stretch`: of optical over geometric depth.
    """

    study: SceneTissueStudy
    snr_db: float
    stretch: float
    rng: np.random.Generator

    def of(self, values_db: float | Curve) -> Curve:
        """Return intensities over the mean noise of levels against the sclera."""
        return level(self.snr_db + values_db)
