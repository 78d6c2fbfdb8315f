"""Readers of foreign formats: pictures, volumes, bags, force logs."""
