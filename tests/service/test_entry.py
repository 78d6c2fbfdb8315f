import json
from dataclasses import fields, replace

import pytest
from small_monitor import READ_ENTRY, TICK_ENTRY, verdict

from scleraforce.service.clients import reading_messages
from scleraforce.service.messages import LATER, Entry


def test_an_entry_reads_as_json_with_its_own_names_but_class():
    record = READ_ENTRY.as_json()
    verdict_keys = {"class", "probabilities", "usable", "reason", "force_mn", "interval_mn"}
    assert set(record) == {field.name for field in fields(Entry)} - {"verdict"} | verdict_keys
    assert record["class"] == 1
    assert record["probabilities"] == [0.0, 0.75, 0.25]
    assert record["interval_mn"] == [11.0, 13.5]
    assert record["message"] == READ_ENTRY.message


def test_what_is_no_number_is_null_wherever_it_stands():
    nan, inf = float("nan"), float("inf")
    entry = replace(READ_ENTRY, verdict=verdict(nan, (-inf, 13.5), probabilities=(nan, inf, 0.5)), latency_ms=inf)
    record = json.loads(json.dumps(entry.as_json()), parse_constant=pytest.fail)  # NaN and Infinity are not JSON
    assert record["force_mn"] is record["latency_ms"] is None
    assert record["interval_mn"] == [None, 13.5]
    assert record["probabilities"] == [None, None, 0.5]


def test_without_a_frame_what_belongs_to_one_is_null():
    record = TICK_ENTRY.as_json()
    assert {name for name, value in record.items() if value is None} == {
        "cause", "withdrawn_s", "present_cause",
        "frame", "frame_id", "class", "probabilities", "force_mn", "interval_mn", "usable", "reason",
        "latency_ms",
    }  # fmt: skip


def test_an_entry_of_a_log_without_what_is_true_now_is_read():
    record = {name: value for name, value in READ_ENTRY.as_json().items() if name not in LATER}
    assert len(record) == len(READ_ENTRY.as_json()) - len(LATER)
    assert Entry.from_json(record) == READ_ENTRY


def test_a_frame_that_was_not_read_is_not_usable_and_another_event_is_neither():
    record = replace(READ_ENTRY, verdict=None).as_json()
    assert (record["usable"], record["class"], record["force_mn"]) == (False, None, None)
    assert Entry.from_json(record) == replace(READ_ENTRY, verdict=None)
    assert TICK_ENTRY.as_json()["usable"] is None


def test_the_sensor_holds_frame_class_probabilities_force_interval_usable_and_code():
    text, sensor = reading_messages(READ_ENTRY)
    assert text.text == json.dumps(READ_ENTRY.as_json())
    assert sensor.values == pytest.approx((3, 1, 0.0, 0.75, 0.25, 0.0125, 0.011, 0.0135, 1, 1))
    dark = replace(READ_ENTRY, verdict=verdict(predicted=2, usable=False, reason="dark", probabilities=None))
    assert [str(value) for value in reading_messages(dark)[1].values] == ["3.0", "2.0", *["nan"] * 6, "0.0", "1.0"]
    unread = reading_messages(replace(READ_ENTRY, verdict=None))[1].values
    assert [str(value) for value in unread] == ["3.0", *["nan"] * 7, "0.0", "1.0"]
