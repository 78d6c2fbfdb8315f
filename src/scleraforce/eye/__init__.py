"""The eye: its wall as a mesh of hexahedra, and where the needle touches it."""
