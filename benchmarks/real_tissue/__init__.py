"""Our mechanics beside published theory and measurement: the tables of docs/real_tissue.md."""
