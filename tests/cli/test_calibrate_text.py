"""`calibrate` reports its findings beside the modulus in human units, in its text and its picture."""

from pathlib import Path

from small_recordings import calibration_of_a_sealed_eye

import scleraforce
from scleraforce.report.recording_figures import draw_calibration

FOUND = ("thickness 651 ± 12 µm", "k 0.031 ± 0.001 mmHg^(1/3)/µl", "forces 13 ± 3 % above the library's at 60 mN")


def test_text_and_picture_have_the_findings_beside_the_modulus(tmp_path: Path, monkeypatch, shell) -> None:
    result = calibration_of_a_sealed_eye()
    monkeypatch.setattr(scleraforce, "calibrate", lambda *_, **__: result)
    plot = tmp_path / "out.png"
    lines = shell.run("calibrate", "mine", "--out", tmp_path / "out.json", "--plot", plot)[0].splitlines()
    first, last = (next(n for n, line in enumerate(lines) if line.startswith(eye)) for eye in ("mine", "population"))
    remark = " ".join(" ".join(lines[first:last]).split())
    assert "; ".join(FOUND) in remark
    assert max(map(len, lines[:last])) <= 80
    assert "bends otherwise" not in remark  # low and high forces do not agree on E, but k may be off in a frame alone
    assert plot.read_bytes().startswith(b"\x89PNG")
    title = draw_calibration(result).axes[0].get_title(loc="left")
    assert title.splitlines() == ["mine: 0.300 MPa, sd 0.0100 MPa", *FOUND]


def test_a_stiffening_that_is_both_given_and_sought_is_refused(tmp_path: Path, shell) -> None:
    study = tmp_path / "study.toml"
    study.write_text("[tissue]\nstiffening = 3.0\n")
    error = shell.refused("calibrate", "eye", "--study", study, "--out", tmp_path / "out.json")
    assert "tissue.stiffening: is sought in the frames" in error
    assert not (tmp_path / "out.json").exists()
