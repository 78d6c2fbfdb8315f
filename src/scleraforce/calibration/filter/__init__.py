"""The reduced-order unscented Kalman filter over the frames of an eye.

Pure: no file, no clock, no socket. Imports `fit` and the rows below it.

Public:
    eye_filter: `EyeFilter`, `EyeSession`, `EyeState`, `FrameStep`, `PARAMETERS`,
        `SkippedFrame`, `UNSEEN`, `begin`, `parameter_moments`, `predicted_points`,
        `step`
    eye_parameters: `WallState`, `polar_spread_rad`, `stated_globe`,
        `stated_polar_rad`, `stated_wall`
    section_registration: `BY_POLAR`, `first_belief`, `place_section`
"""
