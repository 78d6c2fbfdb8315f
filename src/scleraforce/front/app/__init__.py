"""The app: import, look, correct, calibrate and read in a browser; long computations
run as commands.
"""
