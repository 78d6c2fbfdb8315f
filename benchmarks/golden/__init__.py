"""Golden answers: what the code answers today, frozen, and how far later code moves
from it.
"""
