"""Sections: what the B-scan plane cuts out of the deformed wall, and the binary slice of it."""
