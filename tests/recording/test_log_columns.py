"""Which column of a log is which."""

from pathlib import Path

import pytest

from scleraforce.errors import InputError
from scleraforce.recording.force_log import LogColumn, columns_by_header, parse_column, required_columns
from scleraforce.recording.scan import UnansweredError

OURS = ["time_s", "fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"]


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (OURS, {ours: ours.rpartition("_")[2] for ours in OURS}),
        (["Time (ms)", "Fx [N]", "Fz [mN]", "Tz (Nmm)"], {"time_s": "ms", "fx_n": "N", "fz_n": "mN", "tz_nm": "Nmm"}),
        (["timestamp_us", "force_z_N", "torque_x_Nm"], {"time_s": "us", "fz_n": "N", "tx_nm": "Nm"}),
        (["Timestamp", "Fx", "Fy", "Fz"], {}),
        (["elapsed time (s)", "Temperature (C)", "Force Z (gf)"], {"time_s": "s", "fz_n": "gf"}),
        (["Zeit [s]", "Kraft_Z_mN"], {"time_s": "s", "fz_n": "mN"}),
        (["t / ms", "F_z(mN)"], {"time_s": "ms", "fz_n": "mN"}),
        (["Temps (s)", "Force Z / mN"], {"time_s": "s", "fz_n": "mN"}),
        (["Zeit in s", "F_z in mN", "Kraft X [N]"], {"time_s": "s", "fz_n": "mN", "fx_n": "N"}),
        (["Time, s", "FZ,mN"], {"time_s": "s", "fz_n": "mN"}),
        (["time_s", "z-Kraft [mN]", "Moment X (Nmm)"], {"time_s": "s", "fz_n": "mN", "tx_nm": "Nmm"}),
        (["Time (s)", "Fz (μN)", "FY (MN)"], {"time_s": "s", "fz_n": "μN"}),
        (["Time (s)", "Fz (counts)", "Fy (V)", "fx_raw", "Fz LSB"], {"time_s": "s"}),
        (["F_t", "position_z_mm", "mz_mT", "Fzn"], {}),
    ],
)
def test_a_header_that_names_units_answers_for_itself(names: list[str], found: dict[str, str]) -> None:
    assert {column.ours: column.unit for column in columns_by_header(names, {})} == found


def test_of_two_columns_that_say_the_same_the_first_counts() -> None:
    assert columns_by_header(["host_time_s", "time_s", "Fz [N]"], {})[0].name == "host_time_s"


def test_rostopic_gives_capture_stamps_in_ns_and_si() -> None:
    names = ["%time", "field.header.seq", "field.header.stamp", "field.wrench.force.z", "field.wrench.torque.x"]
    assert columns_by_header(names, {}) == [
        LogColumn("time_s", "field.header.stamp", "ns"),
        LogColumn("fz_n", "field.wrench.force.z", "N"),
        LogColumn("tx_nm", "field.wrench.torque.x", "Nm"),
    ]


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("fz=F:N", 1.0), ("fz=F:mN", 1e-3), ("fz=F:uN", 1e-6), ("fz=F:gf", 9.80665e-3), ("fz=F:kgf", 9.80665),
        ("fz=F:lbf", 4.4482216152605), ("tx=T:Nm", 1.0), ("tx=T:Nmm", 1e-3), ("tx=T:lbf-in", 0.1129848290276167),
        ("time=t:s", 1.0), ("time=t:ns", 1e-9), ("time=seq:500Hz", 0.002),
    ],
)  # fmt: skip
def test_units_are_as_large_as_they_are(text: str, factor: float) -> None:
    assert parse_column(text).factor == pytest.approx(factor, rel=1e-12)


def test_a_name_may_have_colons_and_equals_signs() -> None:
    assert parse_column("fz=a=b:c:N") == LogColumn("fz_n", "a=b:c", "N")
    assert parse_column(parse_column("fz=a=b:c:N").answer()) == parse_column("fz=a=b:c:N")


@pytest.mark.parametrize("text", ["fz=F", "fz:N", "f=F:N", "fz=F:Nm", "fz=F:iso", "time=t:N", "fz=:N", "time=t:0Hz"])
def test_a_column_that_is_not_stated_well_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="--column"):
        parse_column(text)


def test_what_a_header_leaves_open_is_asked_for_with_its_names() -> None:
    names = ["stamp", "A", "B"]
    with pytest.raises(
        UnansweredError, match=r"log\.csv: which column is the time, and which a force.*'stamp', 'A', 'B'"
    ):
        required_columns(Path("log.csv"), [], names)
    with pytest.raises(UnansweredError, match=r"which column is a force.*give --column fz=NAME:UNIT") as found:
        required_columns(Path("log.csv"), [parse_column("time=stamp:s")], names)
    assert found.value.forms == ("fz=NAME:UNIT",)
    with pytest.raises(InputError, match="no column 'C'; there are 'stamp', 'A', 'B'"):
        required_columns(Path("log.csv"), [parse_column("time=C:s")], names)
