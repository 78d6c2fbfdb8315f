"""The monitor as it runs, from outside: `benchmarks/bench_monitor.py` runs its
parts.
"""
