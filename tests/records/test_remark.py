"""Remarks as data; inputs that are missing."""

from dataclasses import replace

import pytest

import scleraforce as sf
from scleraforce.records.missing_inputs import missing_inputs
from scleraforce.records.remark import numbered, sentences
from scleraforce.records.setup import Setup


def test_a_remark_is_a_sentence_with_a_severity_and_its_keys_in_json():
    remark = sf.Remark("log-slow", "20 samples a second", ("axis",)).on("eye-a")
    assert str(remark) == "eye-a: 20 samples a second"
    assert remark.on("eye-b") is remark
    assert remark.to_dict() == {
        "code": "log-slow",
        "severity": "caution",
        "words": "20 samples a second",
        "fields": ["axis"],
        "about": "eye-a",
    }
    doubt = sf.Remark("other-eye", "another eye")
    assert sentences([remark, doubt, remark]) == (str(remark), "another eye")
    assert numbered([remark, doubt, remark]) == {
        "caution 1": str(remark),
        "doubt 2": "another eye",
    }

    with pytest.raises(sf.InputError, match="code: 'log-slo' is no code of a remark"):
        sf.Remark("log-slo", "20 samples a second")


KNOWN = Setup(
    eye=sf.Eye(
        iop_pa=266.0,
        thickness_m=6e-4,
        globe=sf.Globe.declared("open"),
        relaxation=sf.Relaxation.declared(()),
    ),
    needle=sf.Needle(gap_m=5e-4),
)
CROSS = (sf.Plane("along", 0.0, 0.0), sf.Plane("across", 0.0, 1.57))


def fields_of(remarks):
    """The one field of each remark, each of which says what it costs."""
    assert {remark.code for remark in remarks} <= {"missing-input"}
    assert all(len(remark.fields) == 1 for remark in remarks)
    return [remark.fields[0] for remark in remarks]


@pytest.mark.parametrize("name", ["iop_pa", "thickness_m", "globe", "relaxation"])
def test_what_is_declared_is_not_missing(name):
    assert missing_inputs(KNOWN, forces=True) == ()
    setup = replace(KNOWN, eye=replace(KNOWN.eye, **{name: None}))
    (remark,) = missing_inputs(setup, forces=True)
    assert (remark.fields, remark.severity) == ((name,), "caution")
    assert f"eye.{name}" in remark.words


def test_several_planes_need_no_gap_and_a_classifier_needs_the_thickness_alone():
    nothing = Setup()
    every = ["iop_pa", "globe", "gap_m", "thickness_m", "relaxation"]
    assert fields_of(missing_inputs(nothing, forces=False)) == every
    assert fields_of(missing_inputs(nothing, forces=False, classifier=True)) == [
        "thickness_m"
    ]
    crossed = replace(nothing, scan=sf.Scan(planes=CROSS))
    assert fields_of(missing_inputs(crossed, forces=False)) == [
        name for name in every if name != "gap_m"
    ]


def test_the_offset_of_clocks_is_missing_where_a_log_has_none():
    found = missing_inputs(KNOWN, forces=True, clock_known=False)
    assert fields_of(found) == ["clock_offset_s"]
    assert missing_inputs(KNOWN, forces=False, clock_known=False) == ()
