"""Units, errors, whole files, JSON, compiled loops and worker processes.

Nothing of eyes. Imports no other package.

Public:
    arrays: `Bytes`, `Counts`, `Flags`, `Floats`, `Indices`, `Integers`, `Number`,
        `Places`, `Reals`, `Singles`
    checked_store: `CheckedStore`, `Layout`, `StoreKind`, `layout`
    compiled_loops: `compiled`, `compiled_in_place`, `compiled_part`
    errors: `CalibrationError`, `DatasetError`, `FrameError`, `InputError`, `LinkError`,
        `MessageError`, `ModelError`, `ProtocolError`, `RecordingError`,
        `ScleraforceError`, `SolverError`, `StudyError`
    foreign_settings: `leave_unread`
    kept_arrays: `kept_array`
    kept_results: `ENDING`, `check_folder`, `keep_result`, `kept_result`
    normal_distribution: `MOST_CORRELATED`, `NINETY_PERCENT`, `NORMAL_MEDIAN`,
        `correlation_of`, `is_beyond_chance`, `robust_spread`, `within_bounds`
    notebook_cards: `Row`, `data_frame`, `flat`, `grey_picture`, `html_card`, `tidy`
    onnx_network: `check_interface`, `network_session`, `run_network`
    optional_packages: `package_for`
    plain_json: `finite_json`, `parse_json`
    plain_text: `printable`, `wrapped`
    units: `HumanUnit`, `SI_PER_UNIT`, `STANDARD_GRAVITY_M_S2`, `from_si`, `to_si`
    version: `__version__`
    whole_files: `BYTE_ORDER_MARKS`, `FileKind`, `KINDS`, `MIB`, `check_regular`,
        `folder_when_whole`, `hash_sources`, `opened_regular`, `read_bytes`,
        `read_text`, `renamed_when_whole`, `write_whole`, `write_whole_folder`
    worker_processes: `ClusterWorkers`, `available_cores`, `cluster_workers`,
        `finished_result`, `one_thread`, `work_beside`, `work_in_order`, `work_units`
"""
