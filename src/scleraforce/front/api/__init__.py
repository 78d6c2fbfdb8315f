"""The functions of `import scleraforce as sf`, one module for each task.

Imports `front.report` and every package below `front`.

Public:
    calibrating: `library_for`, `recalibrate_intervals`
    evaluation_table: `by_eye`, `evaluate_to_table`
    importing: `PREVIEW`, `picture_dents`, `write_imported`
    progress: `by_percent`
    public_names: `MODULE_OF`, `names_on_demand`
    reading_frames: `FrameReading`, `check_calibrated`, `eye_of_arguments`, `finder_of`,
        `frame_readings`, `load_model`, `read`, `save_wall`, `scaled_frame`,
        `segmented_frame`, `summary_of_calibration`, `utc_now`
    simulating: `declared_study`, `given_values`
"""
