"""Recordings of scleraforce in napari: frames, walls to correct, forces."""
