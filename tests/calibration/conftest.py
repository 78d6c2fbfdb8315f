"""A small virtual laboratory: coarse walls, factored once for all tests of the
package.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import LIBRARY, moving

from ideal_boundaries import virtual_sections
from scleraforce.calibration.filter.eye_filter import EyeSession, begin
from scleraforce.lab.virtual_eye import scan_plane
from scleraforce.lab.virtual_recording import plan_phantom, write_phantom
from scleraforce.library import Library
from scleraforce.library.plane_cut import cut_surfaces
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import MeshStudy, Study
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import changed, wall_of

STUDY = replace(Study(), mesh=MeshStudy(divisions=4))
FORCES_N = (0.002, 0.030, 0.012, 0.045, 0.020, 0.038)


@dataclass(frozen=True)
class Laboratory:
    study: Study = STUDY

    @cache  # noqa: B019 - a laboratory stays to the end
    def wall(self, thickness_m: float) -> LinearWall:
        mesh = self.study.mesh
        size = (mesh.divisions, mesh.level)
        grid = build_mesh(self.study.eye.radius_m, thickness_m, *size)
        return LinearWall(grid, self.study.eye.poisson_ratio)

    def begun(self, eye: Setup, **changed: object) -> EyeSession:
        """An eye before its first frame; its force sensor has no offset and does not
        drift.
        """
        study = replace(STUDY, calibration=replace(STUDY.calibration, **changed))
        no_error = np.diag([1e-18, 1e-18])
        return begin(study, self.stated(eye), zero_covariance=no_error)

    def stated(self, eye: Setup) -> Setup:
        plane = scan_plane(eye)
        return Setup(
            eye=Eye(iop_pa=eye.eye.iop_pa, thickness_m=eye.eye.thickness_m, globe=OPEN),
            needle=Needle(gap_m=plane.gap_m, polar_rad=plane.contact.polar_rad),
            scan=Scan(direction_rad=plane.direction_rad, tilt_rad=plane.tilt_rad),
        )

    def frames(
        self,
        eye: Setup,
        forces_n: list[float],
        rng: np.random.Generator,
        noise_m: float = 5e-6,
    ) -> list[tuple[Boundaries, float]]:
        """Boundaries and forces of an eye that shifts by up to 0.2 mm between frames,
        and is turned a little.
        """
        sections = virtual_sections(
            self.wall(wall_of(eye).thickness_m), eye, forces_n, self.study
        )
        made = moving(sections, rng, noise_m, self.study)
        return list(zip(made, forces_n, strict=True))


@pytest.fixture(scope="session")
def laboratory() -> Laboratory:
    return Laboratory()


@pytest.fixture(scope="session")
def eye() -> Setup:
    return Setup(
        eye=Eye(
            "virtual", thickness_m=0.7e-3, modulus=Modulus.stated(0.27e6), iop_pa=266.0
        ),
        needle=Needle(gap_m=0.5e-3, polar_rad=0.6, azimuth_rad=0.4),
    )


@pytest.fixture(scope="session")
def virtual_folder(
    laboratory: Laboratory, eye: Setup, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A recording of the eye in linear mechanics, under `FORCES_N`."""
    path = tmp_path_factory.mktemp("linear") / "virtual"
    wall = laboratory.wall(wall_of(eye).thickness_m)
    write_phantom(
        path,
        plan_phantom(eye, FORCES_N, STUDY, 3),
        lambda forces_n: virtual_sections(wall, eye, forces_n, STUDY),
        STUDY,
    )
    return path


@pytest.fixture(scope="session")
def library() -> Library:
    """The library of the made-up eye."""
    return LIBRARY


@pytest.fixture(scope="module")
def made_up_walls() -> Iterator[None]:
    """Let `sf.calibrate` take the library of the made-up eye."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(
            "scleraforce.front.api.calibrating.library_for", lambda *_: LIBRARY
        )
        yield


@pytest.fixture(scope="session")
def made_up(eye: Setup) -> Setup:
    """The eye in the closed form of the library, which is one of revolution."""
    return changed(eye, name="made-up", polar_rad=0.0, azimuth_rad=None)


@pytest.fixture(scope="session")
def made_up_folder(made_up: Setup, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of the made-up eye under `FORCES_N`."""
    path = tmp_path_factory.mktemp("made-up") / "made-up"

    def sections_at(forces_n: Sequence[float]) -> list[WallSection]:
        ones = np.ones(len(forces_n))
        modulus_pa = wall_of(made_up).youngs_modulus_pa
        ratios = (
            wall_of(made_up).iop_pa / modulus_pa * ones,
            np.array(forces_n) / modulus_pa,
        )
        walls = LIBRARY.curves(wall_of(made_up).thickness_m * ones, *ratios).curves_sbnc
        return [cut_surfaces(wall, wall_of(made_up).gap_m) for wall in walls]

    plan = plan_phantom(made_up, FORCES_N, Study(), 3)
    write_phantom(path, plan, sections_at, Study())
    return path
