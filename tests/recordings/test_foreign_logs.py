"""Force logs of other programs: their clocks, their ends, and their characters."""

import re
from collections.abc import Callable

import numpy as np
import pytest
from foreign_files import read_log

from scleraforce.base.errors import RecordingError
from scleraforce.recordings.formats.picture_streams import UnansweredError

STEP_S = 0.005
COUNT = 400
EPOCH_S = 1_700_000_000
TIME_S = STEP_S * np.arange(COUNT)
FORCE_N = np.round(np.random.default_rng(0).normal(0.0, 5e-3, COUNT) - 0.03, 4)


def log_of(*given):
    return read_log(*given)[0]


def rows(time, mark=","):
    """Return lines of times, each as a text, and of forces."""
    return "".join(
        f"{time(at_s)}{mark}{force_n:.4f}\n"
        for at_s, force_n in zip(TIME_S.tolist(), FORCE_N.tolist(), strict=True)
    )


def check(log, within_s=1e-6, time_s=TIME_S):
    np.testing.assert_allclose(log.time_s - log.time_s[0], time_s, atol=within_s)
    np.testing.assert_allclose(log.force_n("fz"), FORCE_N, atol=1e-9)


def since_epoch(at_s):
    """Return whole seconds since 1970, and nanoseconds."""
    whole, part_ns = divmod(round(1e9 * (at_s + 0.7)), 10**9)
    return EPOCH_S + whole, part_ns


@pytest.mark.parametrize(
    ("names", "unit_ns"),
    [
        ("sec,nsec", 1),
        ("secs,nsecs", 1),
        ("header.stamp.sec,header.stamp.nanosec", 1),
        ("stamp_sec,stamp_nsec", 1),
        ("tv_sec,tv_usec", 1000),
        ("Time (s),Time (ns)", 1),
        ("Seconds,Nanoseconds", 1),
        ("Seconds,Microseconds", 1000),
        ("t [s],t [ms]", 10**6),
    ],
)
def test_a_time_in_two_columns_is_their_sum(names, unit_ns, tmp_path):
    def time(at_s):
        whole, part_ns = since_epoch(at_s)
        return f"{whole},{part_ns // unit_ns}"

    text = f"{names},fz_n\n{rows(time)}"
    log = log_of(tmp_path, text)
    check(log)
    assert log.time_s[0] == pytest.approx(EPOCH_S + 0.7)

    both = names.replace(",", "+")
    unit = {1: "ns", 1000: "us", 10**6: "ms"}[unit_ns]
    check(log_of(tmp_path, text, f"time={both}:s+{unit}"))  # as import.json keeps it


@pytest.mark.parametrize(
    "names", ["Time (s),Timestamp (ms)", "time_s,time_ms", "Timestamp (ms),Time (s)"]
)
def test_a_whole_time_beside_whole_seconds_is_taken(names, tmp_path):
    def time(at_s):
        whole, part_ns = since_epoch(at_s)
        both = (f"{whole}", f"{1000 * whole + part_ns // 10**6}")
        return ",".join(reversed(both) if names.startswith("Timestamp") else both)

    check(log_of(tmp_path, f"{names},fz_n\n{rows(time)}"))


def test_milliseconds_beside_the_time_of_day_are_added(tmp_path):
    def time(at_s):
        return f"10:15:{int(at_s):02d};{1e3 * (at_s % 1.0):.0f}"

    check(log_of(tmp_path, f"Time;Millisecond;fz_n\n{rows(time, ';')}"))


@pytest.mark.parametrize(
    ("time", "prefix"),
    [
        ("Time,header.seq,header.stamp.secs,header.stamp.nsecs", "wrench.force."),
        ("Time,header.seq,header.stamp.sec,header.stamp.nanosec", "wrench.force."),
        (
            "__time,/ft/header/seq,/ft/header/stamp/sec,/ft/header/stamp/nanosec",
            "/ft/wrench/force/",
        ),
    ],
)
def test_columns_of_a_wrench_of_ros_are_in_si(time, prefix, tmp_path):
    header = f"{time},{prefix}x,{prefix}z"

    def stamps(at_s):
        whole, part_ns = since_epoch(at_s)
        return f"{EPOCH_S + 2.0 + at_s:.6f},0,{whole},{part_ns},0.0"

    log = log_of(tmp_path, f"{header}\n{rows(stamps)}")
    check(log)
    assert log.time_s[0] == pytest.approx(EPOCH_S + 0.7)  # the capture


def test_the_times_of_plotjuggler_are_seconds(tmp_path):
    text = "__time,/ft/wrench/force/z\n" + rows(lambda at_s: f"{EPOCH_S + at_s:.6f}")
    check(log_of(tmp_path, text))


def minutes(at_s):
    whole, part_ms = divmod(round(1000 * (at_s + 3599.0)), 1000)
    return f"{whole // 60 % 60:02d}:{whole % 60:02d}.{part_ms:03d}"


def test_minutes_without_the_hour_count_on(tmp_path):
    text = f"Time,fz_n\n{rows(minutes)}"
    assert "59:59.995" in text
    assert "\n00:00.000" in text
    check(log_of(tmp_path, text))
    check(log_of(tmp_path, text.replace("Time,", "when,"), "time=when:mmss"))


@pytest.mark.parametrize("rate", [24, 25, 30, 50, 60, 100])
def test_timecode_counts_frames(rate, tmp_path):
    def timecode(at_s):
        frame = round(at_s / STEP_S)
        return f"10:00:{frame // rate:02d}:{frame % rate:02d}"

    text = f"Time,fz_n\n{rows(timecode)}"
    for columns in ((), (f"time=Time:{rate}fps",)):
        check(log_of(tmp_path, text, *columns), 1e-5, np.arange(COUNT) / rate)


def test_timecode_of_an_unknown_rate_is_asked_about(tmp_path):
    text = "Time,fz_n\n" + "".join(f"10:00:00:{k:02d},1\n" for k in range(20))
    with pytest.raises(UnansweredError, match="how many frames a second"):
        log_of(tmp_path, text)


def stamped(time_s):
    stamps = iter(time_s.tolist())
    return f"time_s,fz_n\n{rows(lambda _: f'{next(stamps):.6f}')}"


def test_one_repeated_stamp_is_spaced_evenly_with_a_note(tmp_path):
    time_s = TIME_S.copy()
    time_s[200] = time_s[199]
    log = log_of(tmp_path, stamped(time_s))
    check(log, STEP_S)
    assert (np.diff(log.time_s) > 0.0).all()
    assert "log.csv:202: the clock repeats its stamp: 1 of 400" in log.notes[0]


@pytest.mark.parametrize("late", [1, 200])
def test_a_small_step_back_is_mended_with_a_note(late, tmp_path):
    time_s = TIME_S.copy()
    time_s[200 : 200 + late] -= 0.008  # 3 ms before the sample that comes before it
    log = log_of(tmp_path, stamped(time_s))
    check(log, 0.0081)
    assert (np.diff(log.time_s) > 0.0).all()
    assert "the clock steps back (by 3 ms)" in log.notes[0]


@pytest.mark.parametrize("tick_s", [0.015625, 0.0156001, 0.01, 0.1, 1.0])
@pytest.mark.parametrize("begin_s", [0.0, 0.007])
def test_stamps_of_a_coarse_clock_are_spaced_evenly(tick_s, begin_s, tmp_path):
    time_s = np.floor((TIME_S + begin_s) / tick_s + 1e-6) * tick_s
    if tick_s == 1.0:
        time_s = np.floor(TIME_S * 3.0)
    log = log_of(tmp_path, stamped(time_s))
    steps_s = np.diff(log.time_s)
    assert (steps_s > 0.0).all()
    assert (
        np.abs(log.time_s - TIME_S * (3.0 if tick_s == 1.0 else 1.0)).max()
        < 1.5 * tick_s
    )
    assert "samples are spaced evenly" in log.notes[0]


def test_a_gap_among_coarse_stamps_stays_one(tmp_path):
    true_s = TIME_S + 5.0 * (np.arange(COUNT) >= 200)
    time_s = np.floor(true_s / 0.015625) * 0.015625
    log = log_of(tmp_path, stamped(time_s))
    assert np.abs(log.time_s - true_s).max() < 0.02


@pytest.mark.parametrize(
    ("column", "bits"),
    [
        ("time_us", 32),
        ("time_ms", 16),
        ("Time (ms)", 32),
        ("time_ns", 32),
        ("count [1000Hz]", 16),
        ("time_us", 31),
    ],
)
def test_a_counter_that_overflows_is_counted_on(column, bits, tmp_path):
    unit_s = (
        1e-3
        if "Hz" in column
        else {"us": 1e-6, "ms": 1e-3, "ns": 1e-9}[
            re.search(r"[mun]s", column)[0]  # type: ignore[index]
        ]
    )
    per_step = round(STEP_S / unit_s)
    counts = iter(
        (
            (2**bits - 100 * per_step + 1 + per_step * np.arange(COUNT)) % 2**bits
        ).tolist()
    )
    given = ["time=count [1000Hz]:1000Hz"] if "Hz" in column else []
    log = log_of(
        tmp_path, f"{column},fz_n\n{rows(lambda _: str(next(counts)))}", *given
    )
    check(log)
    assert f"the clock begins anew after 2^{bits}" in log.notes[0]


def test_seconds_of_a_counter_of_microseconds_are_counted_on(tmp_path):
    time_s = (TIME_S + 2**32 * 1e-6 - 1.0) % (2**32 * 1e-6)
    check(log_of(tmp_path, stamped(time_s)), 2e-6)


def test_summer_time_ends_within_a_log(tmp_path):
    time_s = TIME_S + EPOCH_S - 3600.0 * (TIME_S > 1.0)
    check(log_of(tmp_path, stamped(time_s)))


@pytest.mark.parametrize("back_s", [0.3, 0.9, 7.0])
def test_a_clock_that_begins_anew_is_refused_with_a_remedy(back_s, tmp_path):
    time_s = TIME_S + 10.0
    time_s[300:] -= back_s
    with pytest.raises(
        RecordingError, match=r"log\.csv:302: time_s: .* a file of its own"
    ):
        log_of(tmp_path, stamped(time_s))


def test_rows_out_of_order_are_refused(tmp_path):
    time_s = TIME_S + 0.02 * (np.arange(COUNT) % 7 == 0)
    with pytest.raises(RecordingError, match="sort the log by its time"):
        log_of(tmp_path, stamped(time_s))


WHOLE = f"Time (s),Fz (N),Fx (N)\n{rows(lambda at_s: f'{at_s:.3f}').replace(chr(10), ',0.00123' + chr(10))}"


@pytest.mark.parametrize(
    ("ending", "note"),
    [
        ("2.0000,-0.0", "1 line is cut"),
        ("2.0", "1 line is cut"),
        ("2.000,-0.0300,0.001", "1 line is cut"),
        ("2.000,-0.0300,-", "1 line is cut"),
        ("\0" * 3000, "3000 NUL characters"),
        ("2.0" + "\0" * 500, "500 NUL characters .* 1 line is cut"),
        ("\n\nEnd of recording\n", "1 line is no sample"),
        ("# stopped by the user\n", "1 line is no sample"),
        ("Samples: 400\nDuration: 2 s\n", "2 lines are no samples"),
        ("Mean,-0.03,0.001\nMax,0.01,0.002\n", "2 lines are no samples"),
        (",,\n,,\n", "2 lines are no samples"),
    ],
)
def test_what_is_whole_is_read_of_a_log_that_ends_badly(ending, note, tmp_path):
    log = log_of(tmp_path, WHOLE + ending)
    check(log)
    assert re.search(note, " ".join(log.notes))
    assert "log.csv" in " ".join(log.notes)


@pytest.mark.parametrize(
    ("line", "note"),
    [
        ("Time (s),Fz (N),Fx (N)", "1 line is a further header"),
        ("# contact", "1 line is no sample"),
        ("--- marker ---", "1 line is no sample"),
        ("MARK 3", "1 line is no sample"),
        (",,needle in", "1 line is no sample"),
        ("1.0\0\0\0\0\0\0\0", "1 line is cut"),
        ("0.9,-0.0", "1 line is cut"),
        (",-0.03,0.001", "1 line is without a time"),
    ],
)
def test_lines_among_samples_that_are_none_are_left_out(line, note, tmp_path):
    lines = WHOLE.splitlines()
    lines.insert(200, line)
    log = log_of(tmp_path, "\n".join(lines) + "\n")
    check(log)
    assert re.search(
        rf"{note}.* log\.csv:201: ",
        re.sub(r".*/", "", log.notes[0]) and log.notes[0].replace(f"{tmp_path}/", " "),
    )


@pytest.mark.parametrize(
    "word", ["", "NaN", "NULL", "#N/A", "None", "-", "inf", "<NA>", "-nan(ind)"]
)
def test_words_of_no_value_are_gaps(word, tmp_path):
    lines = WHOLE.splitlines()
    for nth in (100, 200):
        time, *_ = lines[nth].split(",")
        lines[nth] = f"{time},{word},{word}"

    log = log_of(tmp_path, "\n".join(lines) + "\n")
    assert np.flatnonzero(np.isnan(log.force_n("fz"))).tolist() == [99, 199]
    assert "2 of 400 samples have no force" in " ".join(log.notes)


def test_rows_of_other_signals_are_no_gaps_of_the_force(tmp_path):
    lines = []
    for line in WHOLE.splitlines()[1:]:
        time, force, _ = line.split(",")
        lines += [f"{time},{force},", f"{float(time) + 0.002:.3f},,36.6"]

    log = log_of(
        tmp_path, "__time,fz_n,temperature\n" + "\n".join(lines) + "\n", "time=__time:s"
    )
    check(log)
    assert "rows of log.csv have no force" in " ".join(log.notes)


def test_a_few_columns_too_many_hint_at_decimal_commas_only_where_there_are_some(
    tmp_path,
):
    lines = WHOLE.splitlines()
    with pytest.raises(RecordingError, match="with decimal commas, columns"):
        log_of(tmp_path, "\n".join([*lines, "2,000,-0,03,0"]))
    with pytest.raises(RecordingError, match=r"2 fields; the header has 3$"):
        log_of(tmp_path, "\n".join([*lines[:20], *["2.0,1.0"] * 9, *lines[20:]]))


@pytest.mark.parametrize(
    "encoding", ["cp1252", "utf-16-le", "utf-16-be", "utf-16", "utf-8-sig", "gbk"]
)
def test_logs_in_other_encodings_are_read(encoding, tmp_path):
    degree = "温度" if encoding == "gbk" else "°C"
    lines = WHOLE.replace("Fx (N)", f"Temp ({degree})").splitlines()
    log = log_of(tmp_path, ("\r\n".join(lines) + "\r\n").encode(encoding))
    check(log)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le"])
def test_a_letter_that_is_cut_costs_its_line_alone(encoding, tmp_path):
    lines = WHOLE.replace("Fx (N)", "Remark").replace("0.00123", "21 °C")
    check(log_of(tmp_path, (lines + "2.000,°").encode(encoding)[:-1]))


@pytest.mark.parametrize(
    "minus", ["\N{MINUS SIGN}", "\N{EN DASH}", "\N{FULLWIDTH HYPHEN-MINUS}"]
)
def test_other_minus_signs_are_signs(minus, tmp_path):
    check(log_of(tmp_path, WHOLE.replace(",-", f",{minus}")))


@pytest.mark.parametrize(
    "mark",
    [
        "'",
        "\N{RIGHT SINGLE QUOTATION MARK}",
        "\N{NO-BREAK SPACE}",
        "\N{NARROW NO-BREAK SPACE}",
        "\N{THIN SPACE}",
        " ",
    ],
)
@pytest.mark.parametrize("decimal", [".", ","])
def test_marks_between_thousands_that_are_no_decimal_marks_are_left_out(
    mark, decimal, tmp_path
):
    def grouped(value):
        return (
            f"{value:,.1f}".replace(".", "d").replace(",", mark).replace("d", decimal)
        )

    lines = [
        f"{grouped(1e3 * at_s)};{grouped(1e6 * force_n)}"
        for at_s, force_n in zip(TIME_S, FORCE_N, strict=True)
    ]
    log = log_of(tmp_path, "\n".join(["Zeit (ms);Fz (uN)", *lines]) + "\n")
    check(log)
    assert "between thousands" in log.notes[0]


def test_a_spreadsheet_of_excel_is_read_in_any_language(tmp_path):
    for text in (
        "sep=;\nZeit (s);Kraft Z (N)\n"
        + rows(lambda at_s: f"{at_s:.3f}", ";").replace(".", ","),
        "Temps (s)\tforce z (N)\n"
        + rows(lambda at_s: f"{at_s:.3f}", "\t").replace(".", ","),
        ",time_s,fz_n\n"
        + "".join(
            f"{k},{at_s:.3f},{f:.4f}\n"
            for k, (at_s, f) in enumerate(zip(TIME_S, FORCE_N, strict=True))
        ),
    ):
        check(log_of(tmp_path, text))


DURATIONS: dict[str, Callable[[float], str]] = {
    "MATLAB": lambda at_s: f"{at_s:g} sec",
    "MATLAB, hh:mm:ss.SSS": lambda at_s: f"00:00:{at_s:06.3f}",
    "pandas": lambda at_s: (
        f"0 days 00:00:{at_s:09.6f}" if at_s % 1.0 else f"0 days 00:00:{int(at_s):02d}"
    ),
    "milliseconds behind a colon": lambda at_s: (
        f"10:15:{int(at_s):02d}:{round(1e3 * (at_s % 1.0)):03d}"
    ),
}


@pytest.mark.parametrize("program", DURATIONS)
def test_durations_are_read_as_programs_write_them(program, tmp_path):
    check(log_of(tmp_path, f"Time,fz_n\n{rows(DURATIONS[program])}"))


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("mark", [",", " ", "\t"])
def test_row_numbers_without_a_name_are_no_column(first, mark, tmp_path):
    lines = rows(lambda at_s: f"{at_s:.3f}", mark).splitlines()
    text = "".join(f"{nth}{mark}{line}\n" for nth, line in enumerate(lines, first))
    check(log_of(tmp_path, f"time_s{mark}fz_n\n{text}"))


@pytest.mark.parametrize("period_s", [1.0, 60.0, 3600.0, 86_400.0])
def test_a_clock_without_its_larger_unit_counts_on(period_s, tmp_path):
    log = log_of(tmp_path, stamped((TIME_S + period_s - 0.5) % period_s))
    check(log)
    assert "the clock begins anew after a" in log.notes[0]


def test_a_second_log_in_a_file_is_refused_with_a_remedy(tmp_path):
    with pytest.raises(RecordingError, match=r"log\.csv:403: .* a file of its own"):
        log_of(tmp_path, 2 * stamped(TIME_S))


def test_an_open_quote_costs_its_line_alone(tmp_path):
    log = log_of(tmp_path, stamped(TIME_S) + '"2.0')
    check(log)
    assert "1 line is cut and is left out" in log.notes[0]
