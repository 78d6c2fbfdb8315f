"""From pixels to the two boundaries of the wall, and whether they can be judged.

Pure: no file, no clock, no socket. Imports `records` and `base`.

Public:
    conjunctiva: `second_surface_m`
    find_wall: `find_wall`
    frame_light: `as_logarithmic`, `imaged_columns`
    needle_in_frame: `SeenNeedle`, `needle_entry`
    wall: `SeenWall`, `Segmentation`, `draw_overlay`, `without_wall`
    wall_in_metres: `Boundaries`, `Observation`, `assumed_inner_row`, `boundary_slice`,
        `boundary_slices`, `check_mask_size`, `dent_measures`, `given_wall`,
        `observe_points`, `segmented_boundaries`, `stretch_of`, `surface_places`
    wall_network: `BEYOND_SHARE`, `FINDER_FRAMES`, `FINDER_ROWS`, `FINDER_WALL`,
        `FrameWindow`, `WallFinder`, `reduced_columns`, `reduced_frame`, `rows_about`
"""
