"""Fitting: the wall of the response library that lies best on a frame."""
