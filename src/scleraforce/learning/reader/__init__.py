"""Training of the reader on walls that are drawn afresh from the response library."""
