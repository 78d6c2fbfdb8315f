"""The functions of `import scleraforce as sf`, one module for each task.

Imports `front.report` and every package below `front`.

Public:
    calibrating: `calibrate`, `library_for`, `recalibrate_intervals`
    evaluation_table: `by_eye`, `evaluate_to_table`
    exporting: `export`
    importing: `PREVIEW`, `import_recording`, `picture_dents`, `write_imported`
    monitoring: `monitor`
    progress: `by_percent`
    public_names: `MODULE_OF`, `names_on_demand`
    reading_frames: `FrameReading`, `check_calibrated`, `evaluate`, `eye_of_arguments`,
        `finder_of`, `frame_readings`, `load_model`, `read`, `save_wall`,
        `scaled_frame`, `segment`, `segmented_frame`, `summary_of_calibration`,
        `utc_now`
    simulating: `declared_study`, `given_values`, `phantom`, `simulate`
    training: `generate`, `library_of`, `train`
"""
