"""Formats in, formats out: what scanners, robots and other programs write, as frames and force logs, and back."""
