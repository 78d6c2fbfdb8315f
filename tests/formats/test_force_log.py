"""Force logs as sensors and robots write them."""

from pathlib import Path

import numpy as np
import pytest
from format_frames import write_log

from scleraforce.errors import RecordingError
from scleraforce.formats.force_log import read_force_text, read_log_text
from scleraforce.formats.log_columns import parse_column

# As the demo program of ATI's Net F/T writes it: settings above, all values in quotes, a clock of whole seconds.
ATI = """Start Time: 8/3/26 2:15 PM
RDT Sample Rate: 500
"PLEASE NOTE: The sample rate is read from the Net F/T when the program starts."
Force Units: mN
Counts per Unit Force: 1000000.0
Torque Units: Nmm
Counts per Unit Torque: 1000000.0
Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time
"0x0","4097","81234","1.5","-2.25","-40.0","0.5","0.25","-1.0","Aug 3, 2026 2:15:07 PM"
"0x0","4098","81248","1.75","-2.5","-41.0","0.5","0.25","-1.0","Aug 3, 2026 2:15:07 PM"
"0x0","4100","81276","2.0","-2.75","-42.0","0.5","0.25","-1.0","Aug 3, 2026 2:15:07 PM"
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


def test_an_ati_log_is_in_its_units_and_counts_by_its_sample_rate(tmp_path: Path) -> None:
    log, columns = log_of(tmp_path, ATI)
    np.testing.assert_allclose(log.time_s - log.time_s[0], [0.0, 0.002, 0.006])
    assert log.columns == ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
    np.testing.assert_allclose(log.wrench_sc[0], [1.5e-3, -2.25e-3, -0.04, 0.5e-3, 0.25e-3, -1e-3])
    assert columns[0].answer() == "time=RDT Sequence:500Hz"


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


@pytest.mark.parametrize("zone", ["", "Z", "+00:00"])
def test_a_date_beside_one_force_is_a_log(tmp_path: Path, zone: str) -> None:
    rows = f"2026-01-02T03:04:05.250{zone},7\n2026-01-02T03:04:05.260{zone},8\n"
    log, _ = log_of(tmp_path, "when,F\n" + rows, "time=when:iso", "fz=F:N")
    np.testing.assert_allclose(log.time_s, [1767323045.25, 1767323045.26], rtol=0, atol=1e-6)


@pytest.mark.parametrize("separator", [",", " ", "   ", "\t"])
def test_a_header_that_numpy_wrote_is_read(tmp_path: Path, separator: str) -> None:
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,fz_n\n0.0,1\n0.1,x\n", r"log\.csv:3: fz_n: 'x' is not a number"),
        ("time_s,fz_n\n0.0,1\n0.1\n", r"log\.csv:3: 1 fields; the header has 2"),
        ("a\nb\ntime_s,fz_n\n0.0,1\n0.1,x\n", r"log\.csv:5: fz_n: 'x'"),
        ("set\ntime_s,fz_n\n0.0,1\n0.1,1\n0.1,1\n", r"log\.csv:5: time_s: 0\.1 does not come after 0\.1"),
        ("time_s,fz_n\n0.0,1\n0.01,nan\n", r"log\.csv:3: fz_n: nan is not a finite number"),
        ("time_s,fz_n\n0.0,1\n", r"log\.csv: fewer than two samples"),
        ("1,2\n3,4\n", r"log\.csv: no header"),
        ("", r"log\.csv: no header"),
    ],
)
def test_a_fault_is_named_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        log_of(tmp_path, text)


def test_a_date_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"log\.csv: when: "):
        log_of(tmp_path, "when,a,b\nyesterday,1,2\n", "time=when:iso", "fz=a:N")
