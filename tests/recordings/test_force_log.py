"""Force logs of any program."""

import re

import numpy as np
import pytest
from foreign_files import read_log

from scleraforce.base.errors import InputError, RecordingError
from scleraforce.recordings.formats.foreign_force_logs import (
    LogColumn,
    columns_by_header,
    parse_column,
)
from scleraforce.recordings.formats.picture_streams import UnansweredError
from scleraforce.recordings.import_sources import source_kind

# As the demo program of ATI's Net F/T writes it: settings above, quoted values, counts,
# a clock of whole seconds.
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
    "header.seq",
    "header.stamp",
    "header.frame_id",
    "wrench.force.x",
    "wrench.force.y",
    "wrench.force.z",
    "wrench.torque.x",
    "wrench.torque.y",
    "wrench.torque.z",
)
ROSTOPIC = f"""%time,{",".join(f"field.{name}" for name in ROS_FIELDS)}
1786000000300000000,1,1786000000250000000,ft,0.1,0.2,-0.3,0.01,0.02,0.03
1786000000310000000,2,1786000000260000000,ft,0.1,0.2,-0.4,0.01,0.02,0.03
"""


def semicolons(*lines):
    return "\n".join([*lines, ""]).replace(" ", ";")


def test_an_ati_log_is_divided_by_its_counts_per_unit_and_counts_by_its_sample_rate(
    tmp_path,
):
    log, columns = read_log(tmp_path, ATI)
    np.testing.assert_allclose(log.time_s - log.time_s[0], [0.0, 0.002, 0.006, 0.008])
    np.testing.assert_allclose(
        log.wrench_sc[0], [1.5e-3, -2.25e-3, -0.04, 0.25e-3, 0.125e-3, -0.5e-3]
    )
    time, *forces, status = (column.answer() for column in columns)
    assert (time, forces[2], status) == (
        "time=RDT Sequence:500Hz",
        "fz=Fz:1000/mN",
        "status=Status (hex):ati",
    )
    assert [parse_column(answer) for answer in (time, *forces, status)] == list(columns)
    # saturated
    assert np.isnan(log.wrench_sc).all(axis=1).tolist() == [
        False,
        False,
        True,
        False,
    ]
    (note,) = log.notes
    assert note.startswith(
        "1 of 4 samples are flagged by the sensor and have no force; the first is "
    )
    assert note.endswith("log.csv:11: Status (hex): '0x80020000'")


@pytest.mark.parametrize(
    "count", ["1000,0", "1e3", "1000,,,", "1.0E+03", "1000 counts"]
)
def test_settings_above_the_header_are_read_whole(tmp_path, count):
    text = ATI.replace("Force: 1000.0", f"Force: {count}")
    assert read_log(tmp_path, text)[0].wrench_sc[0, 2] == pytest.approx(-0.04)


@pytest.mark.parametrize(
    "count",
    ["1,000", "1,000,000", "1 000 000", "1.000.000", "1'000", '"1,000,000"', "1..0"],
)
@pytest.mark.parametrize(
    ("field", "usual"),
    [("Counts per Unit Force", "1000.0"), ("RDT Sample Rate", "500")],
)
def test_settings_that_are_no_numbers_are_refused(tmp_path, count, field, usual):
    text = ATI.replace(f"{field}: {usual}", f"{field}: {count}")
    with pytest.raises(RecordingError, match=f"{field}: .* is not a number"):
        read_log(tmp_path, text)


def test_no_counts_per_unit_are_asked_about(tmp_path):
    with pytest.raises(UnansweredError):
        read_log(tmp_path, ATI.replace("Force: 1000.0", "Force: 0"))


def test_numbers_other_than_counts_under_a_header_with_counts_are_asked_about(
    tmp_path,
):
    text = ATI.replace('"-41000"', '"-41.5"')
    found = r"log\.csv:10: Fz: -41\.5 is not a count, .* fz=Fz:1000/mN or fz=Fz:mN"
    with pytest.raises(UnansweredError, match=found):
        read_log(tmp_path, text)

    others = [
        f"{name.lower()}={name}:{unit}"
        for name, unit in (
            ("Fx", "mN"),
            ("Fy", "mN"),
            ("Tx", "Nmm"),
            ("Ty", "Nmm"),
            ("Tz", "Nmm"),
        )
    ]
    log, _ = read_log(tmp_path, text, "fz=Fz:mN", *others)
    assert log.force_n("fz")[1] == pytest.approx(-0.0415)
    assert any(
        "Fz: read in mN (`columns`), where the log states 1000/mN" in note
        for note in log.notes
    )


TWO_UNITS = r"'Fz\(N\)' is in N by its name: fz=Fz\(N\):N or fz=Fz\(N\):(mN|1000/N)\?"
NOT_APPLIED = r"log\.csv:2: .* is not applied to 'Fz.*fz=Fz"


@pytest.mark.parametrize(
    ("above", "header", "question", "answer", "first_n"),
    [
        *(
            (f"Force Unit: N\n{line}\n", "time_s Fz", NOT_APPLIED, "fz=Fz:1000/N", 1e-3)
            for line in (
                "Scale Factor: 0.001",
                "Gain;1000",
                "Gain;1,000",
                "Sensitivity (N/V): 2.5",
                "Counts per N: 1e6",
            )
        ),
        (
            "Force Unit: N\nGain;1000\n",
            "time_s Fz[N]",
            NOT_APPLIED,
            "fz=Fz[N]:1000/N",
            1e-3,
        ),
        *(
            ("", f"time_s {name}", "which column is a force", f"fz={name}:0.5/N", 2.0)
            for name in ("Fz(counts)", "Fz[V]", "Fz_raw", "Fz_LSB", "Fz(mV)")
        ),
        ("Force Units: mN\n", "time_s Fz(N)", TWO_UNITS, "fz=Fz(N):mN", 1e-3),
        (
            "Force Units: N\nCounts per Unit Force: 1000\n",
            "time_s Fz(N)",
            TWO_UNITS,
            "fz=Fz(N):mN",
            1e-3,
        ),
        ("time_s;Fz(N)\n", "s mN", TWO_UNITS, "fz=Fz(N):mN", 1e-3),
        (
            "",
            "time_s Fz[N] ForceZ[mN]",
            r"fz: is it 'Fz\[N\]' or 'ForceZ\[mN\]'",
            "fz=ForceZ[mN]:mN",
            5e-3,
        ),
        (
            "",
            "stamp A B",
            "the time, and which a force.*'stamp', 'A', 'B'.*give"
            " `columns=time=NAME:UNIT` `columns=fz=",
            "time=stamp:s fz=A:N",
            1.0,
        ),
        (
            "",
            "time_s A B",
            r"which column is a force.*give `columns=fz=NAME:UNIT`$",
            "fz=B:mN",
            5e-3,
        ),
    ],
)
def test_what_a_log_leaves_open_is_asked_and_the_answer_is_used(
    tmp_path, above, header, question, answer, first_n
):
    rows = ("0.00 1 5", "0.01 2 6") if header.count(" ") == 2 else ("0.00 1", "0.01 2")
    text = above + semicolons(header, *rows)
    with pytest.raises(UnansweredError, match=question):
        read_log(tmp_path, text)

    log, _ = read_log(tmp_path, text, *answer.split())
    assert log.force_n("fz")[0] == pytest.approx(first_n)


def test_a_column_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="no column 'C'; there are 'time_s', 'Fz'"):
        read_log(tmp_path, semicolons("time_s Fz", "0.00 1"), "fz=C:N")


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
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
        ("fz_valid", "1", "nan"),
        ("data ok", "yes", "no"),
        ("Status_hex", "0", "1F"),
        ("Status (hex)", "0", "1F"),
    ],
)
def test_samples_that_a_flag_marks_as_faulty_have_no_force(tmp_path, name, good, bad):
    rows = "".join(
        f"{k / 100},{bad if k in (3, 4) else good},0.{k}\n" for k in range(9)
    )
    log, columns = read_log(tmp_path, f"time_s,{name},fz_n\n{rows}")
    assert np.flatnonzero(np.isnan(log.force_n("fz"))).tolist() == [3, 4]
    assert columns[-1].name == name
    (note,) = log.notes
    assert note.startswith("2 of 9 samples are flagged")
    assert note.endswith(f"log.csv:5: {name}: {bad!r}")


EVERY_FLAG = "time_s,status,fz_n\n0.00,7,1\n0.01,7,2\n"


@pytest.mark.parametrize(
    ("text", "columns", "note"),
    [
        (EVERY_FLAG, ["status=status:any"], "^$"),
        (
            "time_s,error,fz_n\n0.00,0.25,1\n0.01,0,2\n",
            [],
            "not taken for the sensor's status",
        ),
    ],
)
def test_a_column_may_be_no_status(tmp_path, text, columns, note):
    log, _ = read_log(tmp_path, text, *columns)
    assert (log.force_n("fz") == [1.0, 2.0]).all()
    assert re.search(note, " ".join(log.notes))


def even_log(*forces_n):
    rows = (f"{k / 100:.2f},0,{force:.6f}\n" for k, force in enumerate(forces_n))
    return "time_s,fx_n,fz_n\n" + "".join(rows)


NOISE_N = np.random.default_rng(1).normal(0.0, 1.0, 1000)
SAMPLES = np.arange(1000)
PUSHED_N = 3e-3 * NOISE_N - 0.02 * (SAMPLES > 600)
BURST_N = np.where((SAMPLES >= 400) & (SAMPLES < 500), 213.0, PUSHED_N)
PUSH_N = 0.06 * ((SAMPLES >= 800) & (SAMPLES < 900))
KNOCKED_N = 0.05e-3 * NOISE_N + PUSH_N + 2.0 * (SAMPLES == 950)


@pytest.mark.parametrize(
    ("text", "gaps", "note"),
    [
        (
            even_log(*BURST_N),
            [*range(400, 500)],
            "100 of 1000 samples are implausible .*log.csv:402: fz_n: 213 N",
        ),
        (even_log(*KNOCKED_N), [], "^$"),
        (
            "time_s,fz_n,n\n0.00,1,1\n0.01,,2\n0.02,nan,3\n0.03,1,4\n",
            [1, 2],
            r"^log.csv: 2 of 4 samples have no force \(nan\)$",
        ),
        (
            "Measuring range: 2 N\n" + even_log(0.1, 2.5, 0.1, -1.9),
            [1],
            r"log.csv:4: fz_n: 2.5 N \(the sensor's range is 2 N\)",
        ),
    ],
    ids=range(4),
)
def test_missing_and_implausible_forces_are_gaps_and_the_first_line_is_named(
    tmp_path, text, gaps, note
):
    log, _ = read_log(tmp_path, text)
    assert np.flatnonzero(np.isnan(log.wrench_sc).all(axis=1)).tolist() == gaps
    assert re.search(note, " ".join(log.notes))


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


@pytest.mark.parametrize("name", ["log.lvm", "log.txt"])
def test_a_labview_measurement_file_is_read_by_its_header(tmp_path, name):
    (tmp_path / name).write_text(LVM)
    assert source_kind(tmp_path / name) == "log"
    log, columns = read_log(tmp_path, LVM)
    np.testing.assert_allclose(log.time_s, [0.0, 0.002, 0.004])
    np.testing.assert_allclose(log.force_n("fz"), [-1.125, -1.25, -1.375])
    answers = [column.answer() for column in columns]
    assert answers == ["time=X_Value:s", "fz=Fz:Newtons"]


def test_the_decimal_mark_of_labview_decides_between_two_readings(tmp_path):
    ambiguous = LVM.replace("0,00", "1,00").replace("2,5", "2")
    log, _ = read_log(tmp_path, ambiguous)
    np.testing.assert_allclose(log.time_s, [1.0, 1.002, 1.004])


def labview(old, new):
    assert old in LVM
    return LVM.replace(old, new)


@pytest.mark.parametrize("separator", ["\t", ";", " "])
@pytest.mark.parametrize(
    ("rows", "reading"),
    [
        # points elsewhere; then three digits behind every comma
        (
            ("0.000 -15,000", "0.005 -15,250"),
            "log.csv:2: .*-15.000 with a decimal comma, or -15000",
        ),
        (
            ("1,000 -15,000", "1,005 -15,250"),
            "log.csv:2: .*1.000 with a decimal comma, or 1000",
        ),
        (
            ("0,000 -1,500,000", "0,005 -1,250,000"),
            "log.csv:2: '-1,500,000' has commas between thousands",
        ),
        (
            ("0 0", "10 -998", "20 -1.021", "30 -15.000"),
            r"log.csv:4: fz_n: '-1\.021' is -1\.021 .* or -1021 with one",
        ),
    ],
)
def test_marks_that_may_part_thousands_are_refused_with_both_readings(
    tmp_path, separator, rows, reading
):
    text = "\n".join(["time_s fz_n", *rows, ""]).replace(" ", separator)
    with pytest.raises(RecordingError, match=reading):
        read_log(tmp_path, text)


NEWTONS = [-1.5e-3, -2.5e-3]
STEP_S = [0.0, 0.01]
THREE_S = [0.0, 0.01, 0.02]
ISO = "2026-01-02T03:04:05.2"


@pytest.mark.parametrize(
    ("text", "columns", "time_s", "force_n"),
    [
        # decimals
        ("time_ms;fz_mN\n0;0\n10;1.021\n20;1.5\n", (), THREE_S, [0, 1.021e-3, 1.5e-3]),
        (
            "time_ms;fz_mN\n0;1.000\n10;2.021\n20;1.500\n",
            (),
            THREE_S,
            [1e-3, 2.021e-3, 1.5e-3],
        ),
        # no thousands begin with 0
        *(
            (
                "time_s fz_n\n0,000 -15,000\n0,005 -15,250\n".replace(" ", mark),
                (),
                [0.0, 0.005],
                [-15.0, -15.25],
            )
            for mark in "\t; "
        ),
        (
            "Zeit;Kraft\n0,25;-1,5\n0,26;-2,5e0\n",
            ("time=Zeit:s", "fz=Kraft:mN"),
            STEP_S,
            NEWTONS,
        ),
        (
            "Messung 3\nZeit;Kraft Z;Temp\n[ms];[mN];[°C]\n0;-1.5;20\n10;-2.5;20\n",
            (),
            STEP_S,
            NEWTONS,
        ),
        *(
            (
                f"time_s\tfz_N\tComment\n0.00\t1{comment}\n0.01\t2\n0.02\t3\n",
                (),
                THREE_S,
                [1.0, 2.0, 3.0],
            )
            for comment in ("", "\tthe needle slips")
        ),
        *(
            (
                f"when,F\n{ISO}50{zone},-1.5\n{ISO}60{zone},-2.5\n",
                ("time=when:iso", "fz=F:mN"),
                STEP_S,
                NEWTONS,
            )
            for zone in ("", "Z", "+00:00")
        ),
        (
            "a log of my robot\n  time_s   fx_n   fz_mN\n  0.00   0.0   -1.5\n "
            " 0.01   10.0   -2.5",
            (),
            STEP_S,
            NEWTONS,
        ),
        *(
            (f"{header}\n0.00{mark}-1.5\n0.01{mark}-2.5\n", (), STEP_S, NEWTONS)
            for header, mark in (
                ("# time [s] Fz [mN]", " "),
                ("% time [s] Fz [mN]", " "),
                ("time [s] Fz [mN]", " "),
                ("#time (s) Fz (mN)", " "),
                ("%% time_s fz_mN", " "),
                ("# time Fz\n# [s] [mN]", " "),
                ("% time_s,fz_mN", ","),
                ("# time_s\tfz_mN", "\t"),
            )
        ),
        (BOTA, ("fx=Fx:N", "fz=Fz:mN", "tx=Mx:Nm"), STEP_S, [-0.3e-3, -0.4e-3]),
        # before what the header says
        (BOTA, ("time=device_timestamp:us", "fz=Fz:mN"), STEP_S, [-0.3e-3, -0.4e-3]),
        (ROSTOPIC, (), STEP_S, [-0.3, -0.4]),
    ],
    ids=range(24),
)
def test_logs_of_many_forms_are_read(tmp_path, text, columns, time_s, force_n):
    """Times relative to the first, and forces in N."""
    log, read = read_log(tmp_path, text, *columns)
    np.testing.assert_allclose(log.time_s - log.time_s[0], time_s, atol=1e-6)
    np.testing.assert_allclose(log.force_n("fz"), force_n)
    assert {parse_column(column) for column in columns} <= set(read)
    if text == ROSTOPIC:  # the capture, not the arrival
        assert log.time_s[0] == pytest.approx(1786000000.25, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "first", "second"),
    [
        ("Time", "11/26/2026 10:15:30.250 PM", "11/26/2026 10:15:30.260 PM"),
        ("Timestamp", "26.11.2026 22:15:30,250", "26.11.2026 22:15:30,260"),
        ("Date/Time", "Nov 26, 2026 10:15:30.250 PM", "Nov 26, 2026 10:15:30.260 PM"),
        ("Zeit", "26. Nov 2026 22:15:30.250", "26. Nov 2026 22:15:30.260"),
        ("datetime", "2026-11-26T22:15:30.250Z", "2026-11-26T23:15:30.260+01:00"),
        ("Time (UTC)", "2026/11/26 22:15:30.25", "2026/11/26 22:15:30.26"),
    ],
)
def test_dates_are_recognised_as_people_write_them(tmp_path, name, first, second):
    log, _ = read_log(tmp_path, f"{name};fz_n;fx_n\n{first};1;0\n{second};2;0\n")
    expected_s = [1795731330.25, 1795731330.26]
    np.testing.assert_allclose(log.time_s, expected_s, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("days", "columns"),
    [
        (("2026-11-26", "2026-11-27"), ()),
        (("26.11.2026", "27.11.2026"), ("time=Time:clock",)),
        (("Nov 26, 2026", "Nov 27, 2026"), ()),
        (("11/26/2026", "11/27/2026"), ()),
    ],
)
def test_times_of_day_count_on_past_midnight_without_the_day_beside_them(
    tmp_path, days, columns
):
    rows = f"{days[0]};11:59:59.990 PM;1\n{days[1]};12:00:00.000 AM;2\n"
    log, read = read_log(tmp_path, f"Date;Time;fz_n\n{rows}", *columns)
    np.testing.assert_allclose(np.diff(log.time_s), [0.01], atol=1e-9)
    assert read[0].answer() == "time=Time:clock"


def test_the_order_of_day_and_month_is_asked_unless_a_value_above_12_decides(
    tmp_path,
):
    text = "Time;fz_n\n5/6/2026 10:15:30.250;1\n5/6/2026 10:15:30.260;2\n"
    with pytest.raises(
        UnansweredError,
        match=r"Time: '5/6/2026 10:15:30.250': is the day or the month first",
    ):
        read_log(tmp_path, text)

    may_s, june_s = (
        read_log(tmp_path, text, f"time=Time:{order}")[0].time_s[0]
        for order in ("mdy", "dmy")
    )
    assert june_s - may_s == 30 * 86400.0  # the 6th of May, the 5th of June
    _, columns = read_log(
        tmp_path, "Time;fz_n\n12/6/2026 23:59:59.990;1\n13/6/2026 00:00:00.000;2\n"
    )
    assert columns[0].answer() == "time=Time:dmy"


WIDE = ",".join(["time_s", "fz_n", *(f"c{k}" for k in range(45))])
WIDE_ROW = ",1" + ",0" * 47


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "  time_s   fz_n\n  0.0   -1\n  0.1   high\n",
            ":3: fz_n: 'high' is not a num",
        ),
        (
            # not one that is cut
            "time_s,fz_n,fx_n,n\n" + "0.00,-1.25,0,1\n" * 5 + "0.02,-1\n" * 4,
            ":7: 2 fields; the header has 4$",
        ),
        (
            f"{WIDE}\n0.00{WIDE_ROW}\n0.01{WIDE_ROW}\n",
            ":2: 49 fields; the header above has 47 names",
        ),
        (
            f"{WIDE}\n0.00{WIDE_ROW[:-4]}\n0.01{WIDE_ROW[:-4]}\n0.02{WIDE_ROW}\n",
            ":4: 49 fields; the header has 47;",
        ),
        ("a\nb\ntime_s,fz_n\n0.0,1\n0.1,x\n", ":5: fz_n: 'x'"),
        ("time_s,fz_n\n0.0,1\nnan,1\n", ":3: time_s: nan is not a finite number"),
        ("1,2\n3,4\n", ": no header"),
        ("", ": no header"),
        (
            even_log(*np.where(abs(SAMPLES - 499.5) < 200, 213.0, PUSHED_N)),
            ":302: fz_n: 213 N .* 400 of 1000 samples are implausible",
        ),
        (
            EVERY_FLAG,
            ":2: status: '7', .*every sample .* `columns=status=status:any`",
        ),
        (labview("X_Columns\tOne", "X_Columns\tNo"), ".*X_Columns: No is not read"),
        (
            labview("X_Columns\tOne", "X_Columns\tMulti"),
            ".*X_Columns: Multi is not read",
        ),
        (
            labview("X_Dimension\tTime", "X_Dimension\tFrequency"),
            ".*X_Dimension: 'Frequency'",
        ),
        (
            labview("Separator\tTab", "Separator\tPipe"),
            ".*Separator: 'Pipe' is not read",
        ),
        (labview("X_Value", "***End_of_Header***\nX_Value"), ".*a second segment"),
        (
            labview("Decimal_Separator\t,", "Decimal_Separator\t."),
            ".*('0,000' .*points|'-1,125' is -1.125 with a decimal comma)",
        ),
    ],
    ids=range(16),
)
def test_a_fault_is_named_with_its_line(tmp_path, text, message):
    with pytest.raises(RecordingError, match=rf"log\.csv{message}"):
        read_log(tmp_path, text)


def test_what_is_no_time_is_refused_with_its_line(tmp_path):
    text = "when,a,b\nyesterday,1,2\n"
    found = r"log\.csv:2: when: 'yesterday' is not a time"
    with pytest.raises(RecordingError, match=found):
        read_log(tmp_path, text, "time=when:iso", "fz=a:N")


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (
            ["Time (ms)", "Fx [N]", "Fz [mN]", "Tz (Nmm)"],
            {"time_s": "ms", "fx_n": "N", "fz_n": "mN", "tz_nm": "Nmm"},
        ),
        (["Timestamp", "Fx", "Fy", "Fz"], {}),
        (["t / ms", "F_z(mN)"], {"time_s": "ms", "fz_n": "mN"}),
        (
            ["Zeit in s", "F_z in mN", "Kraft X [N]"],
            {"time_s": "s", "fz_n": "mN", "fx_n": "N"},
        ),
        (["Time, s", "FZ,mN"], {"time_s": "s", "fz_n": "mN"}),
        (
            ["time_s", "z-Kraft [mN]", "Moment X (Nmm)"],
            {"time_s": "s", "fz_n": "mN", "tx_nm": "Nmm"},
        ),
        (["Time (s)", "Fz (μN)", "FY (MN)"], {"time_s": "s", "fz_n": "μN"}),
        (["Time (s)", "Fz (counts)", "Fy (V)", "fx_raw", "Fz LSB"], {"time_s": "s"}),
        (["F_t", "position_z_mm", "mz_mT", "Fzn"], {}),
        (["host_time_s", "time_s", "Fz [N]"], {"time_s": "s", "fz_n": "N"}),
    ],
)
def test_a_header_that_names_units_answers_for_itself(names, units):
    columns = columns_by_header(names, {})
    assert {column.ours: column.unit for column in columns} == units
    assert names[0] != "host_time_s" or columns[0].name == "host_time_s"


@pytest.mark.parametrize(
    ("text", "factor"),
    [
        ("fz=F:gf", 9.80665e-3),
        ("fz=F:lbf", 4.4482216152605),
        ("tx=T:lbf-in", 0.1129848290276167),
        ("time=seq:500Hz", 0.002),
    ],
)
def test_a_column_is_stated_by_name_and_unit_of_its_size(text, factor):
    assert parse_column(text).factor == pytest.approx(factor, rel=1e-12)


def test_a_name_of_a_column_may_have_any_mark():
    column = parse_column("fz=a=b:c:N")
    assert column == LogColumn("fz_n", "a=b:c", "N") == parse_column(column.answer())


@pytest.mark.parametrize(
    "text",
    [
        "fz=F",
        "fz:N",
        "f=F:N",
        "fz=F:Nm",
        "fz=F:iso",
        "time=t:N",
        "fz=:N",
        "time=t:0Hz",
    ],
)
def test_a_column_that_cannot_be_is_refused(text):
    with pytest.raises(InputError, match="`columns`"):
        parse_column(text)


@pytest.mark.parametrize("where", ["above", "header", "below"])
def test_a_field_beyond_the_limit_is_named_with_its_file(where, tmp_path):
    """It was `: field larger than field limit`; above the names there may be
    remarks.
    """
    large = "x" * 200_000
    names = "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
    lines = {
        "above": [f"# {large}", names],
        "header": [f"{names},{large}"],
        "below": [names, f"0.0,{large},0,0,0,0,0"],
    }[where]
    rows = [f"{0.01 * n:.2f},0,0,{n % 3},0,0,0" for n in range(60)]
    text = "\n".join([*lines, *rows]) + "\n"
    if where == "above":
        assert len(read_log(tmp_path, text)[0].time_s) == 60
        return

    with pytest.raises(InputError, match=f"^{re.escape(str(tmp_path / 'log.csv'))}"):
        read_log(tmp_path, text)
