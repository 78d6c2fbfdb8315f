import json
from dataclasses import fields, replace

import pytest

from scleraforce.service.entry import Entry

FRAME = Entry(
    number=3, time_s=1.8e9, at_s=12.5, event="frame", state="WATCHING", code=1, sub_code=0, cause=None,
    message="OK:\n“12 mN”", frame=3, frame_id=77, predicted=1, probabilities=(0.0, 0.75, 0.25), force_mn=12.5,
    interval_mn=(11.0, 13.5), usable=True, reason=None, latency_ms=0.75, lost=2,
)  # fmt: skip


def test_an_entry_reads_as_json_with_its_own_names_but_class():
    record = json.loads(FRAME.text)
    assert set(record) == {field.name for field in fields(Entry)} - {"predicted"} | {"class"}
    assert record["class"] == 1
    assert record["probabilities"] == [0.0, 0.75, 0.25]
    assert record["interval_mn"] == [11.0, 13.5]
    assert record["message"] == FRAME.message
    assert record == FRAME.as_json()


def test_an_entry_is_one_line():
    assert "\n" not in FRAME.text


def test_what_is_no_number_is_null_wherever_it_stands():
    nan, inf = float("nan"), float("inf")
    entry = replace(FRAME, force_mn=nan, interval_mn=(-inf, 13.5), probabilities=(nan, inf, 0.5), latency_ms=inf)
    record = json.loads(entry.text, parse_constant=pytest.fail)  # NaN and Infinity are not JSON
    assert record["force_mn"] is record["latency_ms"] is None
    assert record["interval_mn"] == [None, 13.5]
    assert record["probabilities"] == [None, None, 0.5]


def test_without_a_frame_what_belongs_to_one_is_null():
    tick = Entry(
        number=1,
        time_s=1.8e9,
        at_s=12.5,
        event="tick",
        state="NOT_READY",
        code=13,
        sub_code=0,
        cause=None,
        message="no good frame yet",
    )
    record = tick.as_json()
    assert {name for name, value in record.items() if value is None} == {
        "cause", "frame", "frame_id", "class", "probabilities", "force_mn", "interval_mn", "usable", "reason",
        "latency_ms",
    }  # fmt: skip
