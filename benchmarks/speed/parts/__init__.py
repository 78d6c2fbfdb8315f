"""Measurements: a module for each table, with a function `measure(run)` that returns
it.
"""
