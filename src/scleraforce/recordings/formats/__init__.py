"""Readers of foreign formats: pictures, volumes, bags, force logs.

Reads files. Imports `recordings`, `records` and `base`.

Public:
    dicom_files: `read_dicom`
    foreign_force_logs: `BEHIND_MARK`, `BRACKETS`, `CLOCK_NAMES`, `LogColumn`, `STATUS`,
        `STATUS_MEANINGS`, `columns_by_header`, `parse_column`, `read_force_text`
    image_files: `MATROSKA`, `TIFF_MARKS`, `read_film`, `read_frame`, `read_image`,
        `read_numpy`
    log_text: `CLOCKS`, `FORCE`, `TIME`, `TORQUE`, `clock_of`, `quantity_of`,
        `read_log_text`, `seconds_of`, `unit_factor`
    picture_streams: `FrameTimes`, `GreyMap`, `MOST_BITS`, `OtherPictureError`,
        `PictureSource`, `PictureStream`, `SECONDS`, `TOP`, `UnansweredError`,
        `check_bytes`, `check_grey_range`, `check_kinds`, `checked_pictures`,
        `find_greys`, `in_order`, `joined_files`, `one_grey`, `parse_axes`, `rising`
    pixels_without_value: `NOT_FINITE`
    ros_bags: `joined_logs`, `read_bag`
    tiff_files: `read_tiff`
    volume_files: `read_metaimage`, `read_nifti`, `read_nrrd`, `read_thorlabs`
    zarr_files: `read_zarr`
"""
