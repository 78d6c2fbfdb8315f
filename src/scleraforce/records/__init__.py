"""The words of the domain: eye, needle, scan, frame, study, and their files.

Imports `base` alone.

Public:
    calibration_file: `Appearance`, `CALIBRATION_FORMAT`, `CalibratedEye`,
        `CalibrationFile`, `CalibrationSummary`, `WRITER`, `appearance_doubt`,
        `appearance_of`, `choice_of_eye`, `decode_file`, `foreign_modulus`,
        `globe_entry`, `known_of_eye`, `open_calibration`, `other_eye`,
        `parse_calibration_file`, `population_modulus`, `read_calibration`,
        `summary_of`, `write_calibration`
    decoder: `Source`, `decode_record`, `format_record`, `parse_json_record`,
        `parse_record`
    eye: `Eye`, `FOUND_BY_CALIBRATION`, `ForceDiscrepancy`, `GROWTH_SCALE`,
        `LEAST_MODULUS_SD`, `LEVEL_SCALE`, `MODULUS_SOURCES`, `Modulus`,
        `NO_DISCREPANCY`, `OWN_SOURCES`, `POPULATION_SD`, `REFERENCE_N`, `UNCERTAIN`,
        `beside_middle`, `open_doubts`
    fields: `NEEDLE_FORCE`, `QUANTITIES`, `Sampled`, `TableForm`, `Unit`,
        `allowed_bounds`, `check_kind`, `check_number`, `check_quantity`, `check_value`,
        `computed`, `declared`, `field_key`, `field_unit`, `fixed`, `formed`,
        `map_numbers`, `name_fault`, `not_in_files`, `one_line`, `option`
    frame: `Frame`, `FrameSource`, `MASK_SD_ROWS`, `Mask`, `Moment`, `NOT_JUDGED`,
        `NO_WALL`, `OpenedFrame`, `Pixels`, `WALL`, `check_frame`, `frame_digest`
    globe: `CONSTANT_PRESSURE`, `Globe`, `OPEN`, `PressureLaw`, `REFERENCE_RIGIDITY`,
        `SAME_SLOPE_PA`, `SEALED`, `UNKNOWN`, `level_growth`, `level_of`,
        `pressure_of_level`, `sealed_law`, `study_law`
    missing_inputs: `missing_inputs`
    model_folder: `CARD_FILE`, `COMMON_FILES`, `FILES`, `LIBRARY_FILE`, `ModelFolder`,
        `NETWORK_FILE`, `Origin`, `RECORD_FILE`, `SHIPPED`, `SHIPPED_LIVING`,
        `SHIPPED_READER`, `SHIPPED_WALL_FINDER`, `STUDY_FILE`, `WALL_FINDER`,
        `check_place`, `check_provenance`, `folder_session`, `folder_study`,
        `model_folder`, `model_name`, `origin_folder`, `origin_of`, `path_or_bundled`,
        `read_folder`, `sha256`, `write_folder`
    motion: `Motion`
    needle: `Needle`, `gauge_diameter_m`, `is_gauge`, `lean_ends`, `nearest_gauge`,
        `one_lean`
    remark: `Remark`, `SEVERITY_OF`, `Severity`, `numbered`, `sentences`
    recording_info: `ForceInfo`, `RecordingInfo`
    scan: `PixelScale`, `Plane`, `Scan`, `check_frame_counts`, `check_planes`,
        `parse_plane`
    setup: `NOTHING_KNOWN`, `Setup`, `completed_by_study`
    study: `CalibrationStudy`, `Choice`, `ClassesStudy`, `EyeStudy`, `LibraryStudy`,
        `MechanicsStudy`, `MeshStudy`, `NetworkStudy`, `OctStudy`, `PRESETS`,
        `PhantomStudy`, `Range`, `RawReaderStudy`, `ReaderStudy`, `Sampled`,
        `SceneEyeStudy`, `SceneOverStudy`, `SceneScannerStudy`, `SceneTissueStudy`,
        `SceneWindowStudy`, `ScenesStudy`, `SliceStudy`, `Study`, `SupportsStudy`,
        `WallFinderStudy`, `draw`, `fixed`, `format_study`, `parse_study`,
        `preset_toml`, `read_study`, `refuse_unused`, `study_hash`
    study_of_eye: `CorneaStudy`, `FormStudy`, `GLOBES`, `RIGIDITY_LAWS`,
        `check_relaxation`, `relaxation_terms`, `relaxation_text`
    tissue_relaxation: `HoldFinding`, `MOST_BEFORE_N`, `Matrix`, `Relaxation`,
        `matrix_rows`
    verdict: `Verdict`, `upper_end`
"""
