"""The command line: one thin file a command; each parses, calls one function, prints.

Imports every other package, lazily: a file is imported when its command runs; ONNX
Runtime, Numba, SciPy and Matplotlib when the command needs them. The entry point
`scleraforce` is `main.main`.

Only this package spells flags: messages of others name fields in backquotes, and
`field_flags` has the flag of each. Files that are written keep the fields.

Public: none.
"""
