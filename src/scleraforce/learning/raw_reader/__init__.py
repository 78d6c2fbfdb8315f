"""Training of the raw reader: on slices of the library's walls first, then on drawn raw frames of them."""
