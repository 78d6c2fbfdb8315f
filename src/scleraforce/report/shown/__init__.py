"""What `scleraforce show` says: of a study, library, data set, model, recording, calibration or decision log."""
