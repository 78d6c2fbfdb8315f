"""The eye: its mesh, loads and displacement, and what a B-scan plane cuts out of the
deformed wall.
"""
