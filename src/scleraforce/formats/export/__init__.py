"""Recordings and answers in the formats of other programs."""
