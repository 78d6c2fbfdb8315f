"""The eye: mesh of the wall, contact, geometry."""
