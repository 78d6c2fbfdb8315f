"""Figures and pages that describe studies, recordings, models and answers.

Imports every package below `front`.

Public:
    described_paths: `thing_at`
    description: `Description`
    evaluation_page: `write_answers_page`
    figure_files: `check_figure_path`, `write_figure`
    figures_beside: `figure_encoder`
    frame_figures: `AnsweredFrame`, `MOST`, `WORST`, `answered_frames`,
        `draw_computed_walls`, `draw_montage`, `draw_overview`, `draw_scanner`,
        `draw_segmentation`, `draw_sheet`, `draw_slice_pairs`, `sheet_frame`,
        `shown_on_sheet`
    html_pages: `NOTHING`, `PageTable`, `class_names`, `confusion_table`, `frame_table`,
        `provenance_table`, `shown_frames`, `write_evaluation_html`, `write_page`
    model_figures: `draw_curves`, `draw_model`, `draw_network`, `draw_simulation`
    recording_figures: `draw_calibration`, `draw_force_log`, `draw_modulus_over_frames`,
        `draw_observed_points`, `draw_recording`
"""
