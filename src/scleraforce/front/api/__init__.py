"""The functions of `import scleraforce as sf`, one module for each task."""
