"""Training of the wall finder, on drawn scenes alone."""
