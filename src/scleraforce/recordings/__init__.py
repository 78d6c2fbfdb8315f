"""Folders of frames and force logs: import, the force under each frame, export.

Reads and writes files. Imports `records` and `base`.

Public:
    clock_offsets: `MOST_FRAMES`, `estimate_clocks`, `relation`
    drawn_walls: `RecordedWalls`, `drawn_mask`, `frame_file_digest`, `mask_of`,
        `remove_wall`, `write_wall`
    exported_files: `csv_text`, `frame_rows`, `read_answers`, `with_answers`,
        `write_mcap`, `write_sequence`, `write_table`
    force_errors: `FrameForces`, `LABEL_SD_N`, `PUSH_N`, `REST_SD_N`, `ZERO_PRIOR`,
        `frame_forces`, `label_sds`, `zero_line`
    forces_under_frames: `Trial`, `UNRELATED`, `after_punctures`, `clock_doubts`,
        `contact_force`, `label_frames`, `label_remarks`, `labels_n`, `log_doubts`,
        `low_pass`, `unit_fault`, `unsure_remark`, `with_punctures`
    frame_and_force_tables: `FORCE_COLUMNS`, `FrameEntry`, `MIN_SAMPLE_RATE_HZ`
    import_answers: `Asker`, `LikeRecording`, `PictureMeasures`, `PreparedImport`,
        `Question`, `complete_import`, `given_times`, `open_questions`, `provenance`,
        `read_like`, `record_text`
    import_record: `IMPORT_RECORD`, `read_import_record`
    import_sources: `GatheredSources`, `ImportOptions`, `OPTION`, `gather_sources`,
        `source_kind`
    log_tables: `LogTable`, `NamedColumn`, `QUANTITY_OF`, `UNITS`, `first_log`,
        `holds_times`, `read_log_table`
    recording_folder: `RecordedFile`, `Recording`, `check_alone`, `open_frame`,
        `read_info`, `read_recording`, `recorded_file`, `recording_of`, `tables_digest`,
        `true_forces`
    recording_writer: `FORCE_STEP_S`, `ForceWriter`, `RecordingWriter`, `frame_files`,
        `read_written`, `write_log`
    source_files: `files_of`
"""
