"""Studies of single questions, one module each: its command `main` prints the figures
that a page quotes. `python -m figures STUDY --help` says what a study measures.
"""
