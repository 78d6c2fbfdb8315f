"""The functions of `import scleraforce as sf`, one module for each task.

Imports `front.report` and every package below `front`.

Public:
    calibrating: `CalibrationMethod`, `calibrate`, `library_for`,
        `recalibrate_intervals`
    evaluation_table: `by_eye`, `evaluate_to_table`
    exporting: `export`
    importing: `ImportRequest`, `import_recording`, `import_result`, `picture_dents`,
        `write_imported`
    monitor_settings: `prepare_monitor`
    monitoring: `monitor`
    opened_frames: `finder_of`, `located`, `opened_frame`
    progress: `Bars`, `Counting`, `by_percent`
    public_names: `MODULE_OF`, `names_on_demand`
    reading_frames: `FrameReading`, `SequenceReader`, `check_calibrated`, `evaluate`,
        `followed_recordings`, `listed_time`, `load_model`, `read`, `save_wall`,
        `segment`, `segmented_frame`, `summary_of_calibration`, `utc_now`
    shorthand: `setup_of_options`
    simulating: `declared_study`, `given_values`, `phantom`, `simulate`
    training: `generate`, `library_of`, `train`
"""
