"""The command line: one thin file a command; each parses, calls one function and
prints.

A file is imported when its command runs; ONNX Runtime, Numba, SciPy and Matplotlib only
when the command needs them.
"""
