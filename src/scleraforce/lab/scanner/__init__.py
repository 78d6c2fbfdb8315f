"""A scanner, measured on frames of an eye at rest."""
