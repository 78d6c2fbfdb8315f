"""What the segmentation does to boundaries, measured on drawn eyes."""
