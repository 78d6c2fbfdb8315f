"""Every figure of speed from one run, beside what one would use instead: `make
bench`.
"""
