"""Seeded faults in copies of a tree, and the share of them that its tests find."""
