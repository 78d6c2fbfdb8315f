"""The monitor's benchmarks: `python -m monitor` lists their questions."""
