"""Virtual eyes, light and pushes that make raw B-scans, force logs and recordings.

Writes files. Imports `calibration` and the rows below it.

Public:
    drawn_bscan: `draw_shaft`, `render_bscan`
    needle_pushes: `NeedlePath`
    tissue_light: `Pose`, `sample_conjunctiva`, `sample_optics`
    virtual_eye: `BentSections`, `LinearSections`, `SimulatedEye`, `check_eye_name`,
        `checked_virtual_eye`, `eye_name`, `paper_eyes`, `scan_plane`, `simulate_eye`,
        `study_sections`, `write_vtu`
    virtual_recording: `in_planes`, `plan_moving_phantom`, `plan_phantom`,
        `write_phantom`
"""
