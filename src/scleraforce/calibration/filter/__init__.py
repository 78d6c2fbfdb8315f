"""The reduced-order unscented Kalman filter over the frames of an eye.

Pure: no file, no clock, no socket. Imports `fit` and the rows below it.

Public:
    eye_filter: `EyeFilter`, `EyeSession`, `EyeState`, `FrameStep`, `PARAMETERS`,
        `RIGIDITY`, `SkippedFrame`, `UNSEEN`, `begin`, `known_after`,
        `known_globe_after`, `parameter_moments`, `predicted_points`, `rigidity_after`,
        `step`
    eye_parameters: `WallState`, `mean_and_sd`, `polar_spread_rad`, `stated_globe`,
        `stated_wall`, `with_modulus`
    library_sections: `LibrarySections`, `library_eye`
    section_registration: `BY_POLAR`, `PoseBelief`, `first_belief`, `place_section`
"""
