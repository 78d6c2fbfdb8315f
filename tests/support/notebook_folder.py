"""A folder with what the examples of the public functions read: a study, a recording, a library, data and a model.

The walls are those of the analytic library: nothing is solved.
"""

from pathlib import Path
from shutil import copytree

from analytic_frames import GAP_M, IOP_PA, LIBRARY, MODULUS_PA, SMALL_LIBRARY, THICKNESS_M, tip_of, wall_section
from analytic_library import solve_analytic
from fixed_reader import write_fixed_reader

from scleraforce.dataset import generate_dataset
from scleraforce.laboratory.phantom import plan_phantom, write_phantom
from scleraforce.laboratory.virtual_eye import PhantomEye
from scleraforce.library.cache import cached_library
from scleraforce.study import read_study

STUDY = """
[library]
thicknesses = 4
tension = { min = 3e-3, max = 0.1 }
tensions = 4
tips = 24

[dataset]
contacts = 10

[[dataset.group]]
thickness_um = 600
images = 200
max_force_mn = 60

[network]
hidden = [20]
epochs = 2
"""


def write_notebook_folder(folder: Path) -> None:
    """Write study.toml, eye-a, responses, dataset and reader; below `cache`, the library of the study for the user."""
    (folder / "study.toml").write_text(STUDY)
    study = read_study(folder / "study.toml")
    eye = PhantomEye(
        id="eye-a", thickness_m=THICKNESS_M, youngs_modulus_pa=MODULUS_PA, iop_pa=IOP_PA, gap_m=GAP_M, polar_rad=0.61
    )
    plan = plan_phantom(eye, (0.010, 0.020, 0.040), study, seed=0)
    write_phantom(folder / "eye-a", plan, _sections, study)
    cache = folder / "cache" / "scleraforce" / "libraries"
    cached_library(study, folder=cache, workers=1, solve=solve_analytic)
    copytree(next(cache.glob("*.zarr")), folder / "responses")
    generate_dataset(study, folder / "dataset", library=LIBRARY, workers=1)
    write_fixed_reader(folder / "reader", SMALL_LIBRARY, [0.0, 1.0] + [0.0] * 14)


def _sections(forces_n):
    return [wall_section(tip_of(force_n), surface_m=0.0, lateral_m=0.0) for force_n in forces_n]
