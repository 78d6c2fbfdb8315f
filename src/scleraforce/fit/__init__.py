"""Which wall of the library n frames and planes show, forces known or not.

Pure: no file, no clock, no socket. Imports `library`, `records` and `base`.

Public:
    compiled_fit: `COLUMNS`, `CORRELATED_M`, `OUTER_SD_M`
    curve_placement: `PlacedCurves`, `PlacesOnFrame`, `curve_depths`, `place_curves`,
        `pose_derivatives`
    frames_of_an_eye: `DeclaredErrors`, `EyeToFit`, `JointFit`, `ShownFrame`,
        `fit_forces`, `fit_shape`
    least_squares: `StoppingRule`, `WallColumns`, `cauchy_weight`, `gauss_newton`
    one_frame: `BoundaryFit`, `NO_WALL_M`, `fit_boundaries`, `law_of`, `library_walls`,
        `positive_share`
    planes_of_a_moment: `PlanesFit`, `SeenPlane`, `SpatialPlace`, `fit_planes`
    prior_of_an_eye: `FORCE_BY_LOG_THICKNESS`, `FREE_SD`, `KNOWN_SD`,
        `LIBRARY_RADIUS_M`, `Prior`, `SHINE_MEAN_M`, `SHINE_SD_M`, `form_size`,
        `prior_of`
    unknowns: `DEPTH`, `FORM`, `FORMS`, `GAP`, `INNER_OFFSET`, `IOP`, `LATERAL`,
        `MODULUS`, `NAMES`, `ROTATION`, `SIZE`, `SOFT_M`, `THICKNESS`, `TIP`,
        `shining`
"""
