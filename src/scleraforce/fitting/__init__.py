"""Fitting: a wall laid on a frame, by least squares that a wrong stretch of a boundary cannot pull."""
