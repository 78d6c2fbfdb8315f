"""The groups of golden answers; each module states its pieces of work and computes the
answers of one piece.
"""
