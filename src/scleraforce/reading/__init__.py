"""One moment to one answer: force and class by network and fit.

Of other packages it needs NumPy, OpenCV, ONNX Runtime, Numba and msgspec only. Reads
the files of models. Imports `fit` and the rows below it.

Public:
    answer: `Answer`, `Answers`, `Reading`, `fit_reading`, `unusable_answer`
    eye_reader: `OF_POPULATION`, `EyeReader`, `Memory`, `MomentFrame`, `OpenedMoment`,
        `check_mechanics`, `foreign_remark`, `other_eye`, `other_reader`,
        `warming_frame`
    force_network: `CONTACT`, `ForceNetwork`, `GIVEN`, `GIVEN_INPUT`, `GivenEyes`,
        `HISTOGRAM`, `SLICES`, `given_inputs`, `given_modulus`, `histogram_reading`,
        `ratio_edges`
    force_trend: `DENTS`, `DentForce`, `NOISE_WINDOWS`, `OUTSIDE`, `TimeToBound`,
        `TrendLimits`, `rise_of`, `risen_force`, `time_to_bound`, `unexplained_fall`
    frame_checks: `no_wall_of_an_eye`, `read_by_fit`
    interval_widths: `FEW_EYES`, `Factors`, `GLOBE_TRAITS`, `IntervalScore`,
        `IntervalStretch`, `LARGEST`, `NO_FACTORS`, `SMALLEST`, `eye_count`,
        `find_stretches`, `intervals_record`, `of_each_modulus`, `score_reading`,
        `share_of_new_eye`, `stretched_factors`, `weights_of_eyes`
    load_model: `bundled_finder`, `load_classifier`, `load_force_reader`, `load_reader`,
        `load_wall_finder`, `opened_reader`, `suited_reader`
    needle_lean: `MOST_LEAN_RAD`
    reading_models: `Classifier`, `ForceReader`, `INPUT`, `OUTPUT`,
        `RawReader`, `Reader`, `SHIFTS`
    recorded_wall: `recorded_wall`
    tissue_memory: `LIGHT_N`, `Leak`, `TissueMemory`
    trained_ranges: `CLASSIFIER`, `KINDS`, `READER`, `covers_modulus`, `limit_remarks`,
        `other_needle`, `radius_fault`, `reading_ranges`, `untrained_values`
"""
