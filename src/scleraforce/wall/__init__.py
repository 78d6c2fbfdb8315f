"""Segmentation: the wall's boundaries in a raw B-scan, in pixels and in metres, and
whether they can be judged.
"""
