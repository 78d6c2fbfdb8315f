"""The steps of `segmentation.wall` as compiled loops, which work in memory that is kept from frame to frame."""
