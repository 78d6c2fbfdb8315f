"""The words of the domain: eye, needle, scan, frame, study, and the files of these.

Imports `base` alone.
"""
