"""The words of the domain: eye, needle, scan, frame, study, and their files.

Imports `base` alone.

Public:
    calibration_file: `Appearance`, `CALIBRATION_FORMAT`, `CalibrationFile`,
        `CalibrationSummary`, `EyeSummary`, `WRITER`, `appearance_doubt`,
        `appearance_of`, `choice_of_eye`, `decode_file`, `foreign_modulus`,
        `globe_entry`, `known_of_eye`, `open_calibration`, `other_eye`,
        `parse_calibration_file`, `population_modulus`, `read_calibration`,
        `summary_of`, `write_calibration`
    decoder: `Source`, `decode_record`, `format_record`, `parse_json_record`,
        `parse_record`
    eye: `EyeInfo`, `ForceDiscrepancy`, `Known`, `LEAST_MODULUS_SD`, `MODULUS_SOURCES`,
        `Modulus`, `NOTHING_KNOWN`, `NO_DISCREPANCY`, `OWN_SOURCES`, `POPULATION_SD`,
        `REFERENCE_N`, `beside_middle`, `completed_eye`, `one_lean`, `open_doubts`,
        `stated_eye`, `stated_globe`
    fields: `NEEDLE_FORCE`, `QUANTITIES`, `TableForm`, `Unit`, `allowed_bounds`,
        `check_number`, `check_quantity`, `computed`, `field_key`, `field_unit`,
        `fixed`, `formed`, `map_numbers`, `name_fault`, `not_in_files`, `one_line`
    frame: `NOT_JUDGED`, `NO_WALL`, `Pixels`, `ScaledFrame`, `SourcedValue`, `WALL`,
        `check_frame`, `frame_digest`
    globe: `Globe`, `KnownGlobe`, `OPEN`, `OPEN_GLOBE`, `REFERENCE_RIGIDITY`,
        `SAME_SLOPE_PA`, `SEALED`, `UNKNOWN`, `known_globe`, `sealed_globe`,
        `study_globe`
    model_folder: `CARD_FILE`, `COMMON_FILES`, `FILES`, `LIBRARY_FILE`, `ModelFolder`,
        `NETWORK_FILE`, `Origin`, `RECORD_FILE`, `SHIPPED`, `SHIPPED_LIVING`,
        `SHIPPED_READER`, `SHIPPED_WALL_FINDER`, `STUDY_FILE`, `WALL_FINDER`,
        `check_place`, `check_provenance`, `folder_session`, `folder_study`,
        `model_folder`, `model_name`, `origin_folder`, `origin_of`, `path_or_bundled`,
        `read_folder`, `sha256`, `write_folder`
    needle: `NeedleInfo`, `nearest_gauge`
    recording_info: `ForceInfo`, `RecordingInfo`, `known_of_recording`
    scan: `OctInfo`, `PixelScale`, `Plane`, `Scanner`, `check_frame_counts`,
        `check_planes`, `parse_plane`
    study: `CalibrationStudy`, `Choice`, `ClassesStudy`, `LibraryStudy`,
        `MechanicsStudy`, `MeshStudy`, `NetworkStudy`, `OctStudy`, `PRESETS`,
        `PhantomStudy`, `Range`, `RawReaderStudy`, `ReaderStudy`, `Sampled`,
        `SceneEyeStudy`, `SceneOverStudy`, `SceneScannerStudy`, `SceneTissueStudy`,
        `SceneWindowStudy`, `ScenesStudy`, `SliceStudy`, `Study`, `SupportsStudy`,
        `WallFinderStudy`, `draw`, `fixed`, `format_study`, `parse_study`,
        `preset_toml`, `read_study`, `refuse_unused`, `study_hash`
    study_of_eye: `CorneaStudy`, `FormStudy`, `GLOBES`, `RIGIDITY_LAWS`,
        `check_relaxation`, `relaxation_terms`, `relaxation_text`
    tissue_relaxation: `HoldFinding`, `KnownRelaxation`, `MOST_BEFORE_N`, `Matrix`,
        `matrix_rows`
    verdict: `Verdict`, `upper_end`
"""
