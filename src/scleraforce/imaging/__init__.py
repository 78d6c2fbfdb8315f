"""Imaging: section of the deformed wall, binary slice, raw B-scan, segmentation."""
