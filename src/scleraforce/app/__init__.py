"""The app: import, look, correct, calibrate and read in a browser; what takes long runs as a command of its own."""
