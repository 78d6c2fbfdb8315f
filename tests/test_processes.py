"""How units are handed out to processes; `tests/dataset` and `tests/library` show the processes at work."""

from collections import deque

from scleraforce.processes import next_unit, split_runs


def test_units_are_handed_out_in_contiguous_runs_and_the_idle_help_at_the_far_end():
    runs = split_runs(range(6), 2)
    assert [next_unit(runs, 0) for _ in range(5)] == [0, 1, 2, 5, 4]
    assert [next_unit(runs, 1), next_unit(runs, 1)] == [3, None]
    assert split_runs([7], 4) == [deque([7])]
