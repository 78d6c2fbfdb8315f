"""Force logs of any program."""

from pathlib import Path

import numpy as np
import pytest
from foreign_files import write_log

from scleraforce.errors import InputError, RecordingError
from scleraforce.recording.force_log import (
    LogColumn,
    columns_by_header,
    parse_column,
    read_force_text,
    required_columns,
)
from scleraforce.recording.log_text import read_log_text
from scleraforce.recording.scan import UnansweredError
from scleraforce.recording.sources import source_kind

# As the demo program of ATI's Net F/T writes it: settings above, quoted values, counts, a clock of whole seconds.
ATI = """Start Time: 8/3/26 2:15 PM
RDT Sample Rate: 500
"PLEASE NOTE: The sample rate is read from the Net F/T when the program starts."
Force Units: mN
Counts per Unit Force: 1000.0
Torque Units: Nmm
Counts per Unit Torque: 2000.0
Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time
"0x0","4097","81234","1500","-2250","-40000","500","250","-1000","Aug 3, 2026 2:15:07 PM"
"0x80010000","4098","81248","1750","-2500","-41000","500","250","-1000","Aug 3, 2026 2:15:07 PM"
"0x80020000","4100","81276","2000","-2750","-42000","500","250","-1000","Aug 3, 2026 2:15:07 PM"
"0x0","4101","81290","2000","-2750","-43000","500","250","-1000","Aug 3, 2026 2:15:07 PM"
"""
# As loggers of Bota's serial sensors write it: no units.
BOTA = """host_time_s,device_timestamp,status,Fx,Fy,Fz,Mx,My,Mz,temperature_C
1786000000.125,1000,0,0.1,0.2,-0.3,0.01,0.02,0.03,31.5
1786000000.135,11000,0,0.1,0.2,-0.4,0.01,0.02,0.03,31.5
"""
ROS_FIELDS = (
    "header.seq", "header.stamp", "header.frame_id", "wrench.force.x", "wrench.force.y", "wrench.force.z",
    "wrench.torque.x", "wrench.torque.y", "wrench.torque.z",
)  # fmt: skip
ROSTOPIC = f"""%time,{",".join(f"field.{name}" for name in ROS_FIELDS)}
1786000000300000000,1,1786000000250000000,ft,0.1,0.2,-0.3,0.01,0.02,0.03
1786000000310000000,2,1786000000260000000,ft,0.1,0.2,-0.4,0.01,0.02,0.03
"""


def log_of(folder: Path, text: str, *columns: str):
    (folder / "log.csv").write_text(text)
    return read_force_text(read_log_text(folder / "log.csv"), [parse_column(column) for column in columns])


def test_an_ati_log_is_divided_by_its_counts_per_unit_and_counts_by_its_sample_rate(tmp_path: Path) -> None:
    log, columns = log_of(tmp_path, ATI)
    np.testing.assert_allclose(log.time_s - log.time_s[0], [0.0, 0.002, 0.006, 0.008])
    assert log.columns == ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
    np.testing.assert_allclose(log.wrench_sc[0], [1.5e-3, -2.25e-3, -0.04, 0.25e-3, 0.125e-3, -0.5e-3])
    answers = [column.answer() for column in columns]
    assert (answers[0], answers[3]) == ("time=RDT Sequence:500Hz", "fz=Fz:1000/mN")
    assert answers[-1] == "status=Status (hex):ati"
    assert [parse_column(answer) for answer in answers] == list(columns)


def test_a_setting_with_marks_between_its_thousands_is_refused_and_never_cut_short(tmp_path: Path) -> None:
    for count in ["1,000", "1,000,000", "1 000 000", "1.000.000", "1'000", '"1,000,000"', "1..0"]:
        for field in ["Counts per Unit Force", "RDT Sample Rate"]:
            text = (
                ATI.replace("Force: 1000.0", f"Force: {count}")
                if "Force" in field
                else ATI.replace("500\n", f"{count}\n", 1)
            )
            with pytest.raises(RecordingError, match=f"{field}: .* is not a number"):
                log_of(tmp_path, text)


def test_a_setting_may_have_a_decimal_comma_and_columns_behind_it(tmp_path: Path) -> None:
    for count in ("1000,0", "1e3", "1000,,,", "1.0E+03", "1000 counts"):
        log, _ = log_of(tmp_path, ATI.replace("Force: 1000.0", f"Force: {count}"))
        assert log.wrench_sc[0, 2] == pytest.approx(-0.04)


def test_a_setting_of_no_counts_is_asked_about(tmp_path: Path) -> None:
    with pytest.raises(UnansweredError):
        log_of(tmp_path, ATI.replace("Force: 1000.0", "Force: 0"))


def test_samples_that_an_ati_sensor_calls_saturated_are_no_forces(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, ATI)
    assert np.isnan(log.wrench_sc).all(axis=1).tolist() == [False, False, True, False]
    (note,) = log.notes
    assert note.startswith("Status (hex): 1 of 4 samples are flagged by the sensor and have no force; the first is ")
    assert note.endswith("log.csv:11: 0x80020000")


def test_numbers_that_are_no_counts_under_a_header_with_counts_are_asked_about_with_both_readings(
    tmp_path: Path,
) -> None:
    text = ATI.replace('"-41000"', '"-41.5"')
    with pytest.raises(
        UnansweredError, match=r"log\.csv:10: Fz: -41\.5 is not a count, .* fz=Fz:1000/mN or fz=Fz:mN\?"
    ):
        log_of(tmp_path, text)
    others = [f"{name.lower()}={name}:{unit}" for name, unit in
              (("Fx", "mN"), ("Fy", "mN"), ("Tx", "Nmm"), ("Ty", "Nmm"), ("Tz", "Nmm"))]  # fmt: skip
    log, _ = log_of(tmp_path, text, "fz=Fz:mN", *others)
    assert log.force_n("fz")[1] == pytest.approx(-0.0415)
    assert any("Fz: read in mN (--column), where the log states 1000/mN" in note for note in log.notes)


def test_a_factor_above_the_header_that_is_not_applied_is_asked_about(tmp_path: Path) -> None:
    for line in ["Scale Factor: 0.001", "Gain;1000", "Gain;1,000", "Sensitivity (N/V): 2.5", "Counts per N: 1e6"]:
        for name in ["Fz [N]", "Fz"]:
            text = f"Force Unit: N\n{line}\nTime (s);{name}\n0.00;1\n0.01;2\n"
            with pytest.raises(UnansweredError, match=r"log\.csv:2: .* is not applied to 'Fz.*fz=Fz"):
                log_of(tmp_path, text)
            log, _ = log_of(tmp_path, text, f"fz={name}:1000/N")
            np.testing.assert_allclose(log.force_n("fz"), [1e-3, 2e-3])


def test_other_settings_above_the_header_raise_no_question(tmp_path: Path) -> None:
    for line in ["Scale: 1.0", "Full Scale: 50 N", "Calibration date: 2026", "Sample count: 2"]:
        log, _ = log_of(tmp_path, f"{line}\nTime (s);Fz [N]\n0.00;1\n0.01;2\n")
        np.testing.assert_allclose(log.force_n("fz"), [1.0, 2.0])


def test_counts_and_volts_are_never_newtons(tmp_path: Path) -> None:
    for name in ["Fz (counts)", "Fz [V]", "Fz_raw", "Fz LSB", "Fz (mV)"]:
        text = f"time_s;{name}\n0.00;1\n0.01;2\n"
        with pytest.raises(UnansweredError, match="which column is a force"):
            log_of(tmp_path, text)
        log, _ = log_of(tmp_path, text, f"fz={name}:0.5/N")
        np.testing.assert_allclose(log.force_n("fz"), [2.0, 4.0])


def test_samples_that_a_flag_calls_faulty_are_no_forces(tmp_path: Path) -> None:
    for name, good, bad in [
        ("status", "0", "2"),
        ("Sensor Status", "0x0", "0x4"),
        ("is_valid", "1", "0"),
        ("valid", "True", "False"),
        ("overload", "0", "1"),
        ("Saturated", "no", "yes"),
        ("error_code", "0", "17"),
        ("Status", "OK", "OVERLOAD"),
        ("ft_error_flag", "False", "True"),
        ("isSaturated", "0", "1"),
        ("cable ok", "1", "0"),
        ("Status_hex", "0", "1F"),
        ("fz_valid", "1", "nan"),
        ("data ok", "yes", "no"),
        ("Status (hex)", "0", "1F"),
    ]:
        rows = "".join(f"{k / 100},{bad if k in (3, 4) else good},0.{k}\n" for k in range(9))
        log, columns = log_of(tmp_path, f"time_s,{name},fz_n\n{rows}")
        assert np.flatnonzero(np.isnan(log.force_n("fz"))).tolist() == [3, 4]
        assert columns[-1].name == name
        (note,) = log.notes
        assert note.startswith(f"{name}: 2 of 9 samples are flagged")
        assert note.endswith(f"log.csv:5: {bad}")


def test_a_sensor_that_gave_no_force_at_all_is_refused_unless_the_column_is_said_to_be_something_else(
    tmp_path: Path,
) -> None:
    text = "time_s,status,fz_n\n0.00,7,1\n0.01,7,2\n"
    with pytest.raises(RecordingError, match=r"log\.csv:2: status: '7', .*every sample .* --column status=status:any"):
        log_of(tmp_path, text)
    log, _ = log_of(tmp_path, text, "status=status:any")
    np.testing.assert_allclose(log.force_n("fz"), [1.0, 2.0])


def test_an_error_that_is_measured_is_no_flag(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, "time_s,error,fz_n\n0.00,0.25,1\n0.01,0,2\n")
    assert np.isfinite(log.force_n("fz")).all()
    assert "not taken for the sensor's status" in log.notes[0]


def burst_log(count: int = 1000, first: int = 400, last: int = 500, burst_n: float = 213.0) -> str:
    rng = np.random.default_rng(1)
    force_n = rng.normal(0.0, 3e-3, count) - 0.02 * (np.arange(count) > 600)
    force_n[first:last] = burst_n
    return "time_s,fx_n,fz_n\n" + "".join(f"{k / 100:.2f},0,{force:.4f}\n" for k, force in enumerate(force_n))


def test_a_burst_of_213_n_is_no_force_and_its_line_is_named(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, burst_log())
    assert np.flatnonzero(np.isnan(log.wrench_sc).all(axis=1)).tolist() == list(range(400, 500))
    (note,) = log.notes
    assert note.startswith("100 of 1000 samples are implausible and have no force; the first is ")
    assert "log.csv:402: fz_n: 213 N" in note


def test_a_log_that_is_implausible_for_a_third_of_its_time_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"log\.csv:302: fz_n: 213 N .* 400 of 1000 samples are implausible"):
        log_of(tmp_path, burst_log(first=300, last=700))


def test_a_push_on_a_quiet_log_is_a_force(tmp_path: Path) -> None:
    force_n = np.random.default_rng(2).normal(0.0, 0.05e-3, 1000)
    force_n[800:900] += 0.06
    force_n[950] += 2.0  # a knock
    rows = "".join(f"{k / 100:.2f},{force:.6f}\n" for k, force in enumerate(force_n))
    log, _ = log_of(tmp_path, "time_s,fz_n\n" + rows)
    np.testing.assert_allclose(log.force_n("fz"), force_n, atol=1e-6)
    assert log.notes == ()


def test_forces_beyond_the_range_that_the_log_states_are_none(tmp_path: Path) -> None:
    text = "Measuring range: 2 N\ntime_s,fz_n\n0.00,0.1\n0.01,2.5\n0.02,0.1\n0.03,-1.9\n"
    log, _ = log_of(tmp_path, text)
    assert np.isnan(log.force_n("fz")).tolist() == [False, True, False, False]
    assert "log.csv:4: fz_n: 2.5 N (the sensor's range is 2 N)" in log.notes[0]


def test_a_line_with_more_fields_than_names_is_named_with_both_counts(tmp_path: Path) -> None:
    names = ",".join(["time_s", "fz_n", *(f"c{k}" for k in range(45))])
    rows = [",".join([f"{n / 100}", "1", *["0"] * 47]) for n in range(3)]
    with pytest.raises(RecordingError, match=r"log\.csv:2: 49 fields; the header above has 47 names"):
        log_of(tmp_path, "\n".join([names, *rows]))
    with pytest.raises(RecordingError, match=r"log\.csv:4: 49 fields; the header has 47 names"):
        log_of(tmp_path, "\n".join([names, *(row.removesuffix(",0,0") for row in rows[:2]), rows[2]]))


def test_a_line_that_was_cut_off_is_named_though_the_force_is_still_on_it(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"log\.csv:4: 2 fields; the header has 4 names"):
        log_of(tmp_path, "time_s,fz_n,fx_n,n\n0.00,-1.25,0,1\n0.01,-1.25,0,2\n0.02,-1\n")


def test_names_without_fields_at_the_end_may_stay(tmp_path: Path) -> None:
    for comment in ["", "\tthe needle slips"]:
        log, _ = log_of(tmp_path, f"time_s\tfz_n\tComment\n0.00\t1{comment}\n0.01\t2\n0.02\t3\n")
        np.testing.assert_allclose(log.force_n("fz"), [1.0, 2.0, 3.0])


LVM = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t,
Multi_Headings\tNo
X_Columns\tOne
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t
Samples\t3\t3
Y_Unit_Label\tNewtons\tVolts
X_Dimension\tTime\tTime
***End_of_Header***\t\t
X_Value\tFz\tVoltage\tComment
0,000\t-1,125\t2,5
0,002\t-1,250\t2,5\tcontact
0,004\t-1,375\t2,5
"""


def test_a_labview_measurement_file_is_read_by_its_header(tmp_path: Path) -> None:
    for ending in ["lvm", "txt"]:
        path = tmp_path / f"log.{ending}"
        path.write_text(LVM)
        assert source_kind(path) == "log"
        log, columns = read_force_text(read_log_text(path), [])
        np.testing.assert_allclose(log.time_s, [0.0, 0.002, 0.004])
        np.testing.assert_allclose(log.force_n("fz"), [-1.125, -1.25, -1.375])
        assert [column.answer() for column in columns] == ["time=X_Value:s", "fz=Fz:Newtons"]


def test_the_decimal_mark_that_a_labview_file_states_decides_between_two_readings(tmp_path: Path) -> None:
    ambiguous = LVM.replace("0,00", "1,00").replace("2,5", "2")
    (tmp_path / "log.lvm").write_text(ambiguous)
    log, _ = read_force_text(read_log_text(tmp_path / "log.lvm"), [])
    np.testing.assert_allclose(log.time_s, [1.0, 1.002, 1.004])
    (tmp_path / "log.lvm").write_text(ambiguous.replace("Decimal_Separator\t,", "Decimal_Separator\t."))
    with pytest.raises(RecordingError, match=r"'1,000' is 1\.000 with a decimal comma, or 1000"):
        read_force_text(read_log_text(tmp_path / "log.lvm"), [])


def test_what_is_not_read_of_a_labview_file_is_refused_by_name(tmp_path: Path) -> None:
    for old, new, message in [
        ("X_Columns\tOne", "X_Columns\tNo", "X_Columns: No is not read"),
        ("X_Columns\tOne", "X_Columns\tMulti", "X_Columns: Multi is not read"),
        ("X_Dimension\tTime", "X_Dimension\tFrequency", "X_Dimension: 'Frequency'"),
        ("Separator\tTab", "Separator\tPipe", "Separator: 'Pipe' is not read"),
        ("***End_of_Header***\t\t\n", "***End_of_Header***\t\t\n***End_of_Header***\n", "a second segment"),
    ]:
        assert old in LVM
        with pytest.raises(RecordingError, match=message):
            log_of(tmp_path, LVM.replace(old, new))


def test_a_comma_that_may_part_thousands_is_refused_with_both_readings(tmp_path: Path) -> None:
    for separator in ["\t", ";", " "]:
        for rows, reading in [
            (["0.000 -15,000", "0.005 -15,250"], "-15.000 with a decimal comma, or -15000"),  # points elsewhere
            (["1,000 -15,000", "1,005 -15,250"], "1.000 with a decimal comma, or 1000"),  # three digits everywhere
            (["0,000 -1,500,000", "0,005 -1,250,000"], "'-1,500,000' has commas between thousands"),
        ]:
            text = "\n".join(["time_s fz_n", *rows]).replace(" ", separator)
            with pytest.raises(RecordingError, match=rf"log\.csv:2: .*{reading}"):
                log_of(tmp_path, text + "\n")


def test_a_point_that_may_part_thousands_is_refused_with_both_readings(tmp_path: Path) -> None:
    for separator in [";", "\t", ",", " "]:
        rows = "".join(f"{10 * k}{separator}{force}\n" for k, force in enumerate(("0", "-998", "-1.021", "-15.000")))
        with pytest.raises(
            RecordingError, match=r"log\.csv:4: fz_uN: '-1\.021' is -1\.021 .* or -1021 with one between"
        ):
            log_of(tmp_path, f"time_ms{separator}fz_uN\n{rows}")


def test_three_digits_behind_a_point_are_decimals_where_the_log_shows_it(tmp_path: Path) -> None:
    for forces in [("1.000", "2.021", "1.500"), ("0", "1.021", "1.5"), ("0", "0.998", "1.021")]:
        rows = "".join(f"{10 * k};{force}\n" for k, force in enumerate(forces))
        log, _ = log_of(tmp_path, f"time_ms;fz_mN\n{rows}")
        np.testing.assert_allclose(log.force_n("fz"), [1e-3 * float(force) for force in forces])


def test_a_comma_is_decimal_where_the_log_shows_it(tmp_path: Path) -> None:
    for separator in ["\t", ";", " "]:
        text = "time_s fz_n\n0,000 -15,000\n0,005 -15,250\n".replace(" ", separator)  # no thousands begin with 0
        log, _ = log_of(tmp_path, text)
        np.testing.assert_allclose(log.force_n("fz"), [-15.0, -15.25])
        assert log.notes == ("numbers have decimal commas",)


def test_two_units_of_one_column_are_asked_about(tmp_path: Path) -> None:
    for text in [
        "Force Units: mN\ntime_s;Fz (N)\n0.00;1\n0.01;2\n",
        "Force Units: N\nCounts per Unit Force: 1000\ntime_s;Fz (N)\n0.00;1\n0.01;2\n",
        "time_s;Fz (N)\ns;mN\n0.00;1\n0.01;2\n",
    ]:
        with pytest.raises(
            UnansweredError, match=r"'Fz \(N\)' is in N by its name: fz=Fz \(N\):N or fz=Fz \(N\):(mN|1000/N)\?"
        ):
            log_of(tmp_path, text)
        assert log_of(tmp_path, text, "fz=Fz (N):mN")[0].force_n("fz")[1] == pytest.approx(2e-3)


def test_units_on_a_line_of_their_own_are_read(tmp_path: Path) -> None:
    log, columns = log_of(tmp_path, "Messung 3\nZeit;Kraft Z;Temp\n[ms];[mN];[°C]\n0;1;20\n10;2;20\n")
    np.testing.assert_allclose(log.time_s, [0.0, 0.01])
    np.testing.assert_allclose(log.force_n("fz"), [1e-3, 2e-3])
    assert columns[1].answer() == "fz=Kraft Z:mN"


def test_two_columns_of_one_force_are_asked_about(tmp_path: Path) -> None:
    text = "time_s;Fz [N];Force Z [mN]\n0.00;1;5\n0.01;2;6\n"
    with pytest.raises(UnansweredError, match=r"fz: is it 'Fz \[N\]' or 'Force Z \[mN\]'\?"):
        log_of(tmp_path, text)
    assert log_of(tmp_path, text, "fz=Force Z [mN]:mN")[0].force_n("fz")[0] == pytest.approx(5e-3)


def test_dates_are_recognised_as_people_write_them(tmp_path: Path) -> None:
    for name, first, second in [
        ("Time", "11/26/2026 10:15:30.250 PM", "11/26/2026 10:15:30.260 PM"),
        ("Timestamp", "26.11.2026 22:15:30.250", "26.11.2026 22:15:30.260"),
        ("Date/Time", "Nov 26, 2026 10:15:30.250 PM", "Nov 26, 2026 10:15:30.260 PM"),
        ("Zeit", "26. Nov 2026 22:15:30.250", "26. Nov 2026 22:15:30.260"),
        ("datetime", "2026-11-26T22:15:30.250Z", "2026-11-26T23:15:30.260+01:00"),
        ("Time (UTC)", "2026/11/26 22:15:30.25", "2026/11/26 22:15:30.26"),
    ]:
        log, _ = log_of(tmp_path, f"{name};fz_n;fx_n\n{first};1;0\n{second};2;0\n")
        np.testing.assert_allclose(log.time_s, [1795731330.25, 1795731330.26], rtol=0, atol=1e-6)


def test_times_of_day_count_on_past_midnight(tmp_path: Path) -> None:
    log, columns = log_of(tmp_path, "Date;Time;fz_n\n2026-11-26;11:59:59.990 PM;1\n2026-11-27;12:00:00.000 AM;2\n")
    np.testing.assert_allclose(np.diff(log.time_s), [0.01], atol=1e-9)
    assert columns[0].answer() == "time=Time:clock"


def test_whether_day_or_month_is_first_is_asked_unless_a_value_above_12_decides(tmp_path: Path) -> None:
    text = "Time;fz_n\n5/6/2026 10:15:30.250;1\n5/6/2026 10:15:30.260;2\n"
    with pytest.raises(UnansweredError, match=r"Time: '5/6/2026 10:15:30.250': is the day or the month first"):
        log_of(tmp_path, text)
    sixth_of_may_s, fifth_of_june_s = (
        log_of(tmp_path, text, f"time=Time:{order}")[0].time_s[0] for order in ("mdy", "dmy")
    )
    assert fifth_of_june_s - sixth_of_may_s == 30 * 86400.0
    night = "Time;fz_n\n12/6/2026 23:59:59.990;1\n13/6/2026 00:00:00.000;2\n"
    _, columns = log_of(tmp_path, night)
    assert columns[0].answer() == "time=Time:dmy"


def test_samples_without_a_number_are_gaps_and_counted(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, "time_s,fz_n,n\n0.00,1,1\n0.01,,2\n0.02,nan,3\n0.03,1,4\n")
    assert np.isnan(log.force_n("fz")).tolist() == [False, True, True, False]
    assert log.notes == ("log.csv: 2 of 4 samples have no force (nan)",)


def test_a_bota_log_takes_the_units_that_were_told(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, BOTA, "fx=Fx:N", "fz=Fz:N", "tx=Mx:Nm")
    assert log.columns == ("fx_n", "fz_n", "tx_nm")
    np.testing.assert_allclose(log.time_s, [1786000000.125, 1786000000.135])
    np.testing.assert_allclose(log.force_n("fz"), [-0.3, -0.4])


def test_what_was_told_comes_before_what_the_header_says(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, BOTA, "time=device_timestamp:us", "fz=Fz:mN")
    np.testing.assert_allclose(log.time_s, [0.001, 0.011])
    np.testing.assert_allclose(log.force_n("fz"), [-0.3e-3, -0.4e-3])


def test_a_log_of_rostopic_counts_by_capture_stamps(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, ROSTOPIC)
    np.testing.assert_allclose(log.time_s, [1786000000.25, 1786000000.26], rtol=0, atol=1e-6)
    np.testing.assert_allclose(log.wrench_sc[1], [0.1, 0.2, -0.4, 0.01, 0.02, 0.03])


def test_decimal_commas_behind_semicolons(tmp_path: Path) -> None:
    log, _ = log_of(tmp_path, "Zeit;Kraft\n0,25;-1,5\n0,26;-2,5e1\n", "time=Zeit:s", "fz=Kraft:mN")
    np.testing.assert_allclose(log.time_s, [0.25, 0.26])
    np.testing.assert_allclose(log.force_n("fz"), [-1.5e-3, -25e-3])


def test_dates_and_times(tmp_path: Path) -> None:
    rows = "2026-01-02T03:04:05.250,7,1\n2026-01-02T03:04:05.260,8,2\n"
    log, _ = log_of(tmp_path, "when,F,n\n" + rows, "time=when:iso", "fy=F:N")
    np.testing.assert_allclose(log.time_s, [1767323045.25, 1767323045.26], rtol=0, atol=1e-6)
    np.testing.assert_array_equal(log.force_n("fy"), [7.0, 8.0])


def test_a_date_beside_one_force_is_a_log(tmp_path: Path) -> None:
    for zone in ["", "Z", "+00:00"]:
        rows = f"2026-01-02T03:04:05.250{zone},7\n2026-01-02T03:04:05.260{zone},8\n"
        log, _ = log_of(tmp_path, "when,F\n" + rows, "time=when:iso", "fz=F:N")
        np.testing.assert_allclose(log.time_s, [1767323045.25, 1767323045.26], rtol=0, atol=1e-6)


def test_a_header_that_numpy_wrote_is_read(tmp_path: Path) -> None:
    for separator in [",", " ", "   ", "\t"]:
        header = separator.join(("time_s", "fz_n"))
        np.savetxt(tmp_path / "log.csv", [[0.0, 1.0], [0.01, 2.0]], delimiter=separator, header=header)
        log, _ = read_force_text(read_log_text(tmp_path / "log.csv"), [])
        np.testing.assert_allclose(log.time_s, [0.0, 0.01])
        np.testing.assert_allclose(log.force_n("fz"), [1.0, 2.0])


def test_columns_that_spaces_align_are_read_and_a_fault_among_them_is_named(tmp_path: Path) -> None:
    lines = ["a log of my robot", "  time_s    fx_n     fz_n", "  0.00      0.0     -1.0", "  0.01     10.0     -2.5"]
    (tmp_path / "log.txt").write_text("\n".join(lines))
    log, _ = read_force_text(read_log_text(tmp_path / "log.txt"), [])
    np.testing.assert_allclose(log.force_n("fz"), [-1.0, -2.5])
    (tmp_path / "log.txt").write_text("\n".join([*lines, "  0.02      0.0     high"]))
    with pytest.raises(RecordingError, match=r"log\.txt:5: fz_n: 'high' is not a number"):
        read_force_text(read_log_text(tmp_path / "log.txt"), [])


def test_a_long_log_with_columns_of_its_own_comes_back(tmp_path: Path) -> None:
    force_n = write_log(tmp_path / "log.csv")
    log, _ = read_force_text(read_log_text(tmp_path / "log.csv"), [])
    np.testing.assert_allclose(log.force_n("fz"), force_n, atol=1e-7)
    assert log.sample_rate_hz == pytest.approx(200.0)


def test_a_fault_is_named_with_its_line(tmp_path: Path) -> None:
    for text, message in [
        ("time_s,fz_n\n0.0,1\n0.1,x\n", r"log\.csv:3: fz_n: 'x' is not a number"),
        ("time_s,fz_n\n0.0,1\n0.1\n", r"log\.csv:3: 1 fields; the header has 2 names"),
        ("a\nb\ntime_s,fz_n\n0.0,1\n0.1,x\n", r"log\.csv:5: fz_n: 'x'"),
        ("set\ntime_s,fz_n\n0.0,1\n0.1,1\n0.1,1\n", r"log\.csv:5: time_s: 0\.1 does not come after 0\.1"),
        ("time_s,fz_n\n0.0,1\n0.01,inf\n", r"log\.csv:3: fz_n: 'inf' is not a number|fz_n: inf is not a finite"),
        ("time_s,fz_n\n0.0,1\nnan,1\n", r"log\.csv:3: time_s: nan is not a finite number"),
        ("time_s,fz_n\n0.0,1\n", r"log\.csv: fewer than two samples"),
        ("1,2\n3,4\n", r"log\.csv: no header"),
        ("", r"log\.csv: no header"),
    ]:
        with pytest.raises(RecordingError, match=message):
            log_of(tmp_path, text)


def test_a_date_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"log\.csv:2: when: 'yesterday' is not a time"):
        log_of(tmp_path, "when,a,b\nyesterday,1,2\n", "time=when:iso", "fz=a:N")


OURS = ["time_s", "fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"]


def test_a_header_that_names_units_answers_for_itself() -> None:
    for names, found in [
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
    ]:
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


def test_units_are_as_large_as_they_are() -> None:
    for text, factor in [
        ("fz=F:N", 1.0),
        ("fz=F:mN", 1e-3),
        ("fz=F:uN", 1e-6),
        ("fz=F:gf", 9.80665e-3),
        ("fz=F:kgf", 9.80665),
        ("fz=F:lbf", 4.4482216152605),
        ("tx=T:Nm", 1.0),
        ("tx=T:Nmm", 1e-3),
        ("tx=T:lbf-in", 0.1129848290276167),
        ("time=t:s", 1.0),
        ("time=t:ns", 1e-9),
        ("time=seq:500Hz", 0.002),
    ]:
        assert parse_column(text).factor == pytest.approx(factor, rel=1e-12)


def test_a_name_may_have_colons_and_equals_signs() -> None:
    assert parse_column("fz=a=b:c:N") == LogColumn("fz_n", "a=b:c", "N")
    assert parse_column(parse_column("fz=a=b:c:N").answer()) == parse_column("fz=a=b:c:N")


def test_a_column_that_is_not_stated_well_is_refused() -> None:
    for text in ["fz=F", "fz:N", "f=F:N", "fz=F:Nm", "fz=F:iso", "time=t:N", "fz=:N", "time=t:0Hz"]:
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


def test_a_header_may_be_a_comment_and_its_units_stand_behind_a_blank(tmp_path: Path) -> None:
    for header in [
        "# time [s] Fz [mN]",
        "% time [s] Fz [mN]",
        "time [s] Fz [mN]",
        "#time (s) Fz (mN)",
        "%% time_s fz_mN",
        "# time Fz\n# [s] [mN]",
        "% time_s,fz_mN",
    ]:
        mark = "," if "," in header else " "
        log, _ = log_of(tmp_path, f"{header}\n0.00{mark}-1.5\n0.01{mark}-2.5\n")
        np.testing.assert_allclose(log.time_s, [0.0, 0.01])
        np.testing.assert_allclose(log.force_n("fz"), [-1.5e-3, -2.5e-3])


def test_a_last_line_that_ends_within_its_number_is_left_out_and_that_is_said(tmp_path: Path) -> None:
    for last in ["-31.2", "-31.", "-31", "-"]:
        text = f"time_s,fz_mN\n0.00,-30.25\n0.01,-30.50\n0.02,-31.00\n0.03,{last}"
        if last == "-":
            with pytest.raises(RecordingError, match=r"log\.csv:5: fz_mN: '-' is not a number"):
                log_of(tmp_path, text)
            continue
        log, _ = log_of(tmp_path, text)
        np.testing.assert_allclose(log.time_s, [0.0, 0.01, 0.02])
        assert any("log.csv:5" in note and repr(last) in note and "left out" in note for note in log.notes)
        log, _ = log_of(tmp_path, f"{text}\n")
        assert (len(log.time_s), log.force_n("fz")[-1]) == (4, pytest.approx(1e-3 * float(last)))


def test_a_last_number_that_may_be_cut_is_kept_and_that_is_said(tmp_path: Path) -> None:
    rows = "".join(f"{0.01 * k:.2f},{force}\n" for k, force in enumerate((-30.125, -30.5, -31.25)))
    log, _ = log_of(tmp_path, f"time_s,fz_mN\n{rows}0.03,-31")
    assert log.force_n("fz")[-1] == pytest.approx(-0.031)
    assert any("log.csv:5" in note and "cut off?" in note for note in log.notes)


def test_a_whole_log_may_end_without_a_line_break(tmp_path: Path) -> None:
    for last in ["-31.00", "-9.00", "-31.000"]:
        log, _ = log_of(tmp_path, f"time_s,fz_mN\n0.00,-3.25\n0.01,-30.50\n0.02,{last}")
        assert log.force_n("fz")[-1] == pytest.approx(1e-3 * float(last))
        assert not any("log.csv:4" in note for note in log.notes)


def test_a_day_in_a_column_of_its_own_is_not_used_and_that_is_said(tmp_path: Path) -> None:
    for day in ["2026-11-26", "26.11.2026", "Nov 26, 2026", "11/26/2026"]:
        for columns in [(), ("time=Time:clock",)]:
            rows = "".join(f"{day};10:15:30.{k:02d};-1.5\n" for k in range(3))
            log, _ = log_of(tmp_path, f"Date;Time;Fz [mN]\n{rows}", *columns)
            assert any("'Date'" in note and day in note and "not used" in note for note in log.notes)
