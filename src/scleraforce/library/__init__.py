"""How any wall responds: load paths over thickness, pressure and force, interpolated.

Its file and its store are here. Imports `mechanics`, `records` and `base`.

Public:
    library_file: `load_library`, `save_library`
    library_plan: `LARGEST_POLAR_DEG`, `LITTLE_STIFFENING`, `plan_library`,
        `stiffening_place`
    library_store: `build_library`, `cached_library`, `open_library`, `solve_path`
    moving_base: `SHEARED`, `UP`, `Vector`, `bulge_at`, `find_meridian`,
        `pole_directions`, `push_of`, `section_places`, `turn_about`
    plane_cut: `Framing`, `column_laterals`, `cut_surfaces`, `draw_slices`,
        `fill_boundaries`, `highest_depths`, `section_motion`, `wall_boundaries`
    response_splines: `CubicSpline`, `SUPPORT`, `SplineTables`, `curves_at`,
        `node_before`, `state_weights`, `value_of`
    ring_cut: `meet_rings`
    sealed_eye: `iop_ratio_at_dent`, `iop_ratio_under_force`, `level_growth`,
        `level_of`, `pressure_at_dent`, `pressure_of_level`
    wall_responses: `INNER`, `Library`, `OUTER`
"""

from scleraforce.library.library_file import (
    load_library as load_library,
    save_library as save_library,
)
from scleraforce.library.wall_responses import (
    INNER as INNER,
    OUTER as OUTER,
    Library as Library,
    Responses as Responses,
)
