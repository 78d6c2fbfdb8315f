"""What frames with forces teach: an eye, and how wrong a reader's answers are.

Pure: no file, no clock, no socket; but for `evaluation`, which reads recordings.
Imports `reading` and the rows below it.

Public:
    answer_metrics: `ForceTrial`, `Proportion`, `SDS_OF_INTERVAL`, `SHARED_ERROR`,
        `accuracy`, `agreement`, `band_of`, `confusion_matrix`, `coverage`,
        `coverage_by_eye`, `dice`, `held_by_eye`, `mean_absolute_error`, `precision`,
        `recall`
    calibrate: `STIFFENING`, `calibrate_recordings`, `calibration_passes`
    calibration: `Calibration`, `EyeCalibration`, `FrameRecord`, `UsedRecording`,
        `calibration_lines`, `found_remarks`, `modulus_lines`, `parse_calibration`
    calibration_checks: `check_recording`, `checked_calibration`
    evaluation: `Evaluation`, `FrameAnswer`, `check_once`, `evaluate_recordings`,
        `recording_scores`
    found_walls: `FoundWalls`
    seen_frames: `CalibrationSettings`, `frame_order`
    start_of_an_eye: `ForceFrame`, `StartedEye`, `first_fit`
    stiffness_from_forces: `TissueTrial`, `eye_of_forces`, `search_stiffening`
    stiffness_from_shape: `EyePosterior`, `calibrate_without_force`
"""
