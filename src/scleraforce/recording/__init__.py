"""Recordings: folders of frames and force logs, their labels, and a virtual laboratory
that makes them.
"""
