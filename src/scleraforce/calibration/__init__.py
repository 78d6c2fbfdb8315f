"""Calibration: Young's modulus from recordings by a reduced-order unscented Kalman
filter.
"""
