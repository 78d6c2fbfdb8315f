"""Reporting: figures and pages that show a run beside the paper."""
