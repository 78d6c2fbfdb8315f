"""Our mechanics beside published theory and measurement: the tables of README.md."""
