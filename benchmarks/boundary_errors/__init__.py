"""Errors of the segmentation's boundaries, measured on drawn eyes."""
