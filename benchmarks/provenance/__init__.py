"""Provenance of a page's figures: their stamp, and a check that today's code would
still make them.
"""
