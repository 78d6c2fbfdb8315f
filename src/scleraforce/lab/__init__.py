"""The virtual laboratory: eyes, light and pushes that make raw B-scans, force logs and
whole recordings.
"""
