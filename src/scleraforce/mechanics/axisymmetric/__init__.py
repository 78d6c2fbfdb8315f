"""Finite strain about the needle axis: a wall of revolution, its mesh, its loads, its load path."""
