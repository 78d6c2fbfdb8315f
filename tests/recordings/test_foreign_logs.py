"""Force logs of other programs: their clocks, their ends, and their characters."""

import re

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


def stamped(time_s):
    """Return a log of these stamps."""
    stamps = iter(time_s.tolist())
    return f"time_s,fz_n\n{rows(lambda _: f'{next(stamps):.6f}')}"


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
def test_a_time_in_two_columns_is_their_sum(tmp_path, names, unit_ns):
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
def test_columns_of_a_wrench_of_ros_are_in_si(tmp_path, time, prefix):
    def stamps(at_s):
        whole, part_ns = since_epoch(at_s)
        return f"{EPOCH_S + 2.0 + at_s:.6f},0,{whole},{part_ns},0.0"

    log = log_of(tmp_path, f"{time},{prefix}x,{prefix}z\n{rows(stamps)}")
    check(log)
    assert log.time_s[0] == pytest.approx(EPOCH_S + 0.7)  # the capture


def milliseconds(at_s):
    whole, part_ns = since_epoch(at_s)
    return 1000 * whole + part_ns // 10**6


def minutes(at_s):
    whole, part_ms = divmod(round(1000 * (at_s + 3599.0)), 1000)
    return f"{whole // 60 % 60:02d}:{whole % 60:02d}.{part_ms:03d}"


def numbered(first, mark):
    """Return rows with their number before them."""
    lines = rows("{:.3f}".format, mark).splitlines()
    return "".join(f"{nth}{mark}{line}\n" for nth, line in enumerate(lines, first))


SAMPLES = rows("{:.3f}".format).replace("\n", ",0.00123\n")
WHOLE = f"Time (s),Fz (N),Fx (N)\n{SAMPLES}"
WITH_COMMAS = rows("{:.3f}".format, ";").replace(".", ",")


@pytest.mark.parametrize(
    "text",
    [
        # a whole time beside whole seconds
        *(
            f"{names},fz_n\n{rows(lambda at_s: f'{since_epoch(at_s)[0]},{milliseconds(at_s)}')}"
            for names in ("Time (s),Timestamp (ms)", "time_s,time_ms")
        ),
        "Timestamp (ms),Time (s),fz_n\n"
        + rows(lambda at_s: f"{milliseconds(at_s)},{since_epoch(at_s)[0]}"),
        # milliseconds beside the time of day
        "Time;Millisecond;fz_n\n"
        + rows(lambda at_s: f"10:15:{int(at_s):02d};{1e3 * (at_s % 1.0):.0f}", ";"),
        # PlotJuggler
        "__time,/ft/wrench/force/z\n" + rows(lambda at_s: f"{EPOCH_S + at_s:.6f}"),
        # durations of MATLAB, pandas and others
        "Time,fz_n\n" + rows("{:g} sec".format),
        "Time,fz_n\n" + rows("00:00:{:06.3f}".format),
        "Time,fz_n\n"
        + rows(
            lambda at_s: (
                f"0 days 00:00:{at_s:09.6f}"
                if at_s % 1.0
                else f"0 days 00:00:{int(at_s):02d}"
            )
        ),
        "Time,fz_n\n"
        + rows(lambda at_s: f"10:15:{int(at_s):02d}:{round(1e3 * (at_s % 1.0)):03d}"),
        # spreadsheets, in any language
        f"sep=;\nZeit (s);Kraft Z (N)\n{WITH_COMMAS}",
        f"Temps (s)\tforce z (N)\n{WITH_COMMAS.replace(';', chr(9))}",
        f",time_s,fz_n\n{numbered(0, ',')}",
        # row numbers without a name
        *(
            f"time_s{mark}fz_n\n{numbered(first, mark)}"
            for first in (0, 1)
            for mark in ", \t"
        ),
        # other minus signs
        *(
            WHOLE.replace(",-", f",{minus}")
            for minus in (
                "\N{MINUS SIGN}",
                "\N{EN DASH}",
                "\N{FULLWIDTH HYPHEN-MINUS}",
            )
        ),
        # summer time ends
        stamped(TIME_S + EPOCH_S - 3600.0 * (TIME_S > 1.0)),
    ],
    ids=range(22),
)
def test_logs_are_read_as_programs_and_people_write_them(tmp_path, text):
    check(log_of(tmp_path, text))


def test_minutes_without_the_hour_count_on(tmp_path):
    text = f"Time,fz_n\n{rows(minutes)}"
    assert "59:59.995" in text
    assert "\n00:00.000" in text
    check(log_of(tmp_path, text))
    check(log_of(tmp_path, text.replace("Time,", "when,"), "time=when:mmss"))


@pytest.mark.parametrize("rate", [24, 25, 30, 50, 60, 100])
def test_timecode_counts_frames(tmp_path, rate):
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


def moved(by_s, first, last):
    """Return the times, of which some are moved."""
    time_s = TIME_S.copy()
    time_s[first:last] += by_s
    return time_s


@pytest.mark.parametrize(
    ("time_s", "note"),
    [
        (
            moved(-STEP_S, 200, 201),
            "log.csv:202: the clock repeats its stamp: 1 of 400",
        ),
        # 3 ms before the sample that comes before it
        (moved(-0.008, 200, 201), "the clock steps back (by 3 ms)"),
        (moved(-0.008, 200, 400), "the clock steps back (by 3 ms)"),
    ],
)
def test_a_repeated_stamp_and_a_small_step_back_are_mended_with_a_note(
    tmp_path, time_s, note
):
    log = log_of(tmp_path, stamped(time_s))
    check(log, 0.0081)
    assert (np.diff(log.time_s) > 0.0).all()
    assert note in log.notes[0]


@pytest.mark.parametrize("tick_s", [0.015625, 0.0156001, 0.01, 0.1, 1.0])
@pytest.mark.parametrize("begin_s", [0.0, 0.007])
def test_stamps_of_a_coarse_clock_are_spaced_evenly(tmp_path, tick_s, begin_s):
    scale = 3.0 if tick_s == 1.0 else 1.0
    true_s = scale * (TIME_S + begin_s)
    log = log_of(tmp_path, stamped(np.floor(true_s / tick_s + 1e-6) * tick_s))
    assert (np.diff(log.time_s) > 0.0).all()
    assert np.abs(log.time_s - scale * TIME_S).max() < 1.5 * tick_s
    assert "samples are spaced evenly" in log.notes[0]


def test_a_gap_among_coarse_stamps_stays_one(tmp_path):
    true_s = TIME_S + 5.0 * (np.arange(COUNT) >= 200)
    log = log_of(tmp_path, stamped(np.floor(true_s / 0.015625) * 0.015625))
    assert np.abs(log.time_s - true_s).max() < 0.02


@pytest.mark.parametrize(
    ("column", "per_step", "bits"),
    [
        ("time_us", 5000, 32),
        ("time_ms", 5, 16),
        ("Time (ms)", 5, 32),
        ("time_ns", 5_000_000, 32),
        ("count [1000Hz]", 5, 16),
        ("time_us", 5000, 31),
    ],
)
def test_a_counter_that_overflows_is_counted_on(tmp_path, column, per_step, bits):
    begin = 2**bits - 100 * per_step + 1
    counts = iter(((begin + per_step * np.arange(COUNT)) % 2**bits).tolist())
    given = [f"time={column}:1000Hz"] if "Hz" in column else []
    text = f"{column},fz_n\n{rows(lambda _: str(next(counts)))}"
    log = log_of(tmp_path, text, *given)
    check(log)
    assert f"the clock begins anew after 2^{bits}" in log.notes[0]


@pytest.mark.parametrize("period_s", [1.0, 60.0, 3600.0, 86_400.0, 2**32 * 1e-6])
def test_a_clock_without_its_larger_unit_counts_on(tmp_path, period_s):
    log = log_of(tmp_path, stamped((TIME_S + period_s - 0.5) % period_s))
    check(log, 2e-6)
    assert "the clock begins anew after " in log.notes[0]


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        *(
            (
                stamped(moved(-back_s, 300, 400) + 10.0),
                r"log\.csv:302: time_s: .* a file of its own",
            )
            for back_s in (0.3, 0.9, 7.0)
        ),
        (2 * stamped(TIME_S), r"log\.csv:403: .* a file of its own"),
        (
            stamped(TIME_S + 0.02 * (np.arange(COUNT) % 7 == 0)),
            "sort the log by its time",
        ),
    ],
    ids=range(5),
)
def test_a_clock_that_begins_anew_or_is_out_of_order_is_refused_with_a_remedy(
    tmp_path, text, remedy
):
    with pytest.raises(RecordingError, match=remedy):
        log_of(tmp_path, text)


@pytest.mark.parametrize(
    ("ending", "note"),
    [
        ("2.0000,-0.0", "1 line is cut"),
        ("2.0", "1 line is cut"),
        ("2.000,-0.0300,0.001", "1 line is cut"),
        ("2.000,-0.0300,-", "1 line is cut"),
        ('"2.0', "1 line is cut"),
        ("\0" * 3000, "3000 NUL characters"),
        ("2.0" + "\0" * 500, "500 NUL characters .* 1 line is cut"),
        ("\n\nEnd of recording\n", "1 line is no sample"),
        ("# stopped by the user\n", "1 line is no sample"),
        ("Samples: 400\nDuration: 2 s\n", "2 lines are no samples"),
        ("Mean,-0.03,0.001\nMax,0.01,0.002\n", "2 lines are no samples"),
        (",,\n,,\n", "2 lines are no samples"),
    ],
    ids=range(12),
)
def test_what_is_whole_is_read_of_a_log_that_ends_badly(tmp_path, ending, note):
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
def test_lines_among_samples_that_are_none_are_left_out(tmp_path, line, note):
    lines = WHOLE.splitlines()
    lines.insert(200, line)
    log = log_of(tmp_path, "\n".join(lines) + "\n")
    check(log)
    assert re.search(rf"{note}.* .*log\.csv:201: ", log.notes[0])


@pytest.mark.parametrize(
    "word", ["", "NaN", "NULL", "#N/A", "None", "-", "inf", "<NA>", "-nan(ind)"]
)
def test_words_of_no_value_are_gaps(tmp_path, word):
    lines = WHOLE.splitlines()
    for nth in (100, 200):
        time, *_ = lines[nth].split(",")
        lines[nth] = f"{time},{word},{word}"

    log = log_of(tmp_path, "\n".join(lines) + "\n")
    assert np.flatnonzero(np.isnan(log.force_n("fz"))).tolist() == [99, 199]
    assert "2 of 400 samples have no force" in " ".join(log.notes)


def test_rows_of_other_signals_are_no_gaps_of_the_force(tmp_path):
    lines = ["__time,fz_n,temperature"]
    for line in WHOLE.splitlines()[1:]:
        time, force, _ = line.split(",")
        lines += [f"{time},{force},", f"{float(time) + 0.002:.3f},,36.6"]

    log = log_of(tmp_path, "\n".join([*lines, ""]), "time=__time:s")
    check(log)
    assert "rows of log.csv have no force" in " ".join(log.notes)


LINES = WHOLE.splitlines()


@pytest.mark.parametrize(
    ("lines", "hint"),
    [
        ([*LINES, "2,000,-0,03,0"], "with decimal commas, columns"),
        ([*LINES[:20], *["2.0,1.0"] * 9, *LINES[20:]], "2 fields; the header has 3$"),
    ],
    ids=range(2),
)
def test_a_few_columns_too_many_hint_at_decimal_commas_only_where_there_are_some(
    tmp_path, lines, hint
):
    with pytest.raises(RecordingError, match=hint):
        log_of(tmp_path, "\n".join(lines))


@pytest.mark.parametrize(
    "encoding", ["cp1252", "utf-16-le", "utf-16-be", "utf-16", "utf-8-sig", "gbk"]
)
def test_logs_in_other_encodings_are_read(tmp_path, encoding):
    degree = "温度" if encoding == "gbk" else "°C"
    text = WHOLE.replace("Fx (N)", f"Temp ({degree})").replace("\n", "\r\n")
    check(log_of(tmp_path, text.encode(encoding)))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le"])
def test_a_letter_that_is_cut_costs_its_line_alone(tmp_path, encoding):
    text = WHOLE.replace("Fx (N)", "Remark").replace("0.00123", "21 °C")
    check(log_of(tmp_path, (text + "2.000,°").encode(encoding)[:-1]))


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
    tmp_path, mark, decimal
):
    marks = str.maketrans({".": decimal, ",": mark})
    lines = [
        f"{1e3 * at_s:,.1f};{1e6 * force_n:,.1f}".translate(marks)
        for at_s, force_n in zip(TIME_S, FORCE_N, strict=True)
    ]
    log = log_of(tmp_path, "\n".join(["Zeit (ms);Fz (uN)", *lines, ""]))
    check(log)
    assert "between thousands" in log.notes[0]
