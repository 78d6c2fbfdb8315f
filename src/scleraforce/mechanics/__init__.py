"""From forces to deformation: meshes, bent walls, and their cut by a B-scan's plane.

Pure: no file, no clock, no socket. Imports `records` and `base`.

Public:
    axisymmetric_wall: `AxisymmetricPath`, `EvenWall`, `LARGEST_POLAR_RAD`,
        `axisymmetric_path`, `base_shift`
    contact_and_section: `Contact`, `ScanPlane`, `SliceWindow`, `WallSection`
    elastic_force: `driven_back`
    finite_strain_wall: `LoadPath`, `bend_eye`
    graded_mesh: `study_mesh`, `supported_mesh`
    hexahedral_mesh: `HexMesh`, `build_mesh`, `locate`
    linear_wall: `LinearWall`, `tip_displacement`
    load_path_tracing: `PathEnd`, `Progress`
    loads_and_supports: `study_springs`
    meridian_elements: `MeridianSize`, `meridian_mesh`
    mesh_section: `SNAP`, `WALL`, `columns_crossed`, `cut_sections`, `fill_section`,
        `slice_window`
    small_matrices: `dilatations`, `inverses`
    summed_elements: `sum_elements`
    tissue_material: `ELASTIC`, `PronySeries`, `burst_tension`, `lame_constants`,
        `line_weights`
    uneven_form: `thickness_factor`
"""
