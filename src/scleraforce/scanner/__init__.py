"""A scanner, measured on its own frames: what a simulation needs to draw frames like them."""
