"""The sessions before the monitor: which eyes a reader meets, what its tables count."""

from monitor_sessions.declarations import DECLARATIONS
from monitor_sessions.eyes import KINDS, may_meet
from monitor_sessions.play import Outcome, Ramp
from monitor_sessions.table import ramp_table
from scleraforce.records.study import Study, parse_study, preset_toml


def test_a_readers_study_decides_which_eyes_it_meets() -> None:
    for study, met in (
        (Study(), ["open", "sealed"]),
        (parse_study(preset_toml("living")), ["living"]),
    ):
        assert [kind for kind in KINDS if may_meet(kind, study.reader)] == met


def test_a_ramp_counts_as_stopped_only_below_the_bound_and_is_compared_with_the_same_ramp():
    declared = Outcome(
        ramps=[Ramp(0, 0.01, 28e-3, -0.2, "BOUND"), Ramp(1, 0.01, 31e-3, 0.1, "RISING")]
    )
    unknown = Outcome(
        ramps=[Ramp(0, 0.01, 22e-3, -0.8, "BOUND"), Ramp(1, 0.01, None, None, None)]
    )
    of = {"declared": declared, "found": Outcome(), "unknown": unknown}
    lines = ramp_table({"sealed": of}).splitlines()
    head, _, *rows = (
        [cell.strip() for cell in line.strip("|").split("|")] for line in lines
    )
    first, _, last = (dict(zip(head, row, strict=True)) for row in rows)
    assert first["stopped below 30 mN"] == "1 of 2"
    assert first["at 10 mN/s"] == "28.0 / 29.5 / 31.0"
    assert last["stopped below 30 mN"] == "1 of 2"
    assert last["earlier than declared, mN"] == "6.0 / 6.0"
    assert last["causes"] == "1 `BOUND`, 1 never"
    assert last["globe"] == DECLARATIONS["unknown"]
