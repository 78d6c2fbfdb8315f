"""Training of the classifier on simulated slices (paper, section 2.4)."""
