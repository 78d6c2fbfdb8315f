"""`sf.import_recording` writes the same as `scleraforce import`, from SI values, with errors that name arguments."""

import inspect
from dataclasses import fields
from math import radians
from pathlib import Path

import numpy as np
import pytest
import tifffile
from effects import contents
from foreign_files import FRAMES, write_log

import scleraforce as sf
from scleraforce.cli.main import run
from scleraforce.notebook.importing import SI_NAMES
from scleraforce.recording.sources import ImportOptions

SCALE = {"width_m": 12e-3, "depth_m": 4e-3, "refractive_index": 1.38, "bits": 13}
NEEDLE = {"eye": "eye-1", "gauge": 22, "gap_m": 0.6e-3}
FORCE = {"contact_sign": -1, "clock_offset_s": 0.5}
TOLD = {**SCALE, **NEEDLE, "rate_hz": 1.0}
OPTIONS = [
    "--width-mm", "12", "--depth-mm", "4", "--refractive-index", "1.38", "--bits", "13", "--eye", "eye-1",
    "--gauge", "22", "--gap-mm", "0.6", "--rate-hz", "1", "--contact-sign", "-1", "--clock-offset-s", "0.5",
    "--thickness-um", "650", "--iop-mmhg", "15", "--globe", "sealed", "--polar-angle-deg", "30", "--average-s", "0.5",
]  # fmt: skip


@pytest.fixture
def sources(tmp_path: Path) -> list[Path]:
    """A stack that states nothing, and a log whose columns say what they are."""
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, photometric="minisblack")
    write_log(tmp_path / "log.csv")
    return [tmp_path / "a.tif", tmp_path / "log.csv"]


def test_it_writes_what_the_command_writes(sources: list[Path], tmp_path: Path) -> None:
    eye = {"thickness_m": 650e-6, "iop_pa": 15 * 133.322387415, "globe": "sealed", "polar_angle_rad": radians(30.0)}
    recording = sf.import_recording(sources, tmp_path / "r", **TOLD, **FORCE, **eye, average_s=0.5)
    assert run(["import", *map(str, sources), "--out", str(tmp_path / "s"), *OPTIONS]) == 0
    command = sf.read_recording(tmp_path / "s")
    assert recording.path == tmp_path / "r"
    assert recording.frames == command.frames
    assert recording.info.oct == command.info.oct
    for part in ("eye", "needle", "force"):
        mine, theirs = vars(getattr(recording.info, part)), vars(getattr(command.info, part))
        assert mine == {
            key: pytest.approx(value, rel=1e-12) if isinstance(value, float) else value for key, value in theirs.items()
        }
    written, by_command = contents(tmp_path / "r"), contents(tmp_path / "s")
    assert set(written) == set(by_command)
    assert [name for name in written if written[name] != by_command[name] and not name.endswith(".toml")] == []


def test_missing_metadata_is_named_by_arguments_all_at_once(sources: list[Path], tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(sf.InputError) as told:
        sf.import_recording(sources, tmp_path / "r")
    names = [*SCALE, *NEEDLE, *FORCE, "rate_hz or times"]
    assert all(f"({name})" in str(told.value) for name in names), told.value
    assert "--" not in str(told.value)
    assert sorted(tmp_path.rglob("*")) == before


REFUSED: list[tuple[dict[str, object], str]] = [
    ({"width_m": 12.0}, "width_m: 12 is above the largest allowed value 0.1"),
    ({"bits": -1}, "bits: -1 is below"),
    ({"bits": 8}, "bits says 8"),
    ({"rate_hz": 0.0}, "^rate_hz: 0; give the frames taken in a second"),
    ({**FORCE, "contact_sign": 0}, "contact_sign: 0 is not a sign"),
    ({"grey_range": (9.0, 1.0)}, "^grey_range: 9 1; give the darkest"),
    ({"array": "a"}, "^array: acts on an .npz file"),
    ({"columns": ["fz=pull"]}, "^columns: 'fz=pull'; give COLUMN=NAME:UNIT"),
    ({"globe": "shut"}, "globe: "),
]


def test_a_wrong_value_is_refused_by_its_argument(sources: list[Path], tmp_path: Path) -> None:
    for changed, words in REFUSED:
        with pytest.raises(sf.InputError, match=words):
            sf.import_recording(sources, tmp_path / "r", **{**TOLD, **FORCE, **changed})
    assert not (tmp_path / "r").exists()


def test_a_property_that_a_source_leaves_open_is_named_by_its_argument(sources: list[Path], tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", FRAMES)
    with pytest.raises(sf.InputError, match=r"a\.npy: an array of .*; give axes$"):
        sf.import_recording(tmp_path / "a.npy", tmp_path / "r", **TOLD)
    sources[1].write_text("\n".join(["when,pull", *(f"{n / 200},{-0.1 * n}" for n in range(900))]) + "\n")
    with pytest.raises(sf.InputError, match=r"; give columns=\['time=NAME:UNIT', 'fz=NAME:UNIT'\]$"):
        sf.import_recording(sources, tmp_path / "r", **TOLD, **FORCE)
    columns = ["time=when:s", "fz=pull:mN"]
    recording = sf.import_recording(sources, tmp_path / "r", **TOLD, **FORCE, columns=columns)
    assert recording.forces.force_n("fz")[100] == pytest.approx(-10e-3)


def test_a_missing_source_is_one_line(tmp_path: Path) -> None:
    new = tmp_path / "r"
    for sources, out, like, words in (
        ([], new, None, "sources: none; give at least one"),
        ("nowhere.tif", new, None, "nowhere.tif: No such file or directory"),
        ("a.tif", tmp_path, None, "exists already; remove it or choose another out$"),
        ("a", new, "nowhere", "nowhere: no such folder; give a recording folder"),
    ):
        with pytest.raises(sf.InputError, match=words) as refused:
            sf.import_recording(sources, out, like=like)
        assert "\n" not in str(refused.value)


def test_every_option_of_the_command_is_an_argument_in_si() -> None:
    arguments = {SI_NAMES.get(field.name, field.name) for field in fields(ImportOptions)}
    assert set(inspect.signature(sf.import_recording).parameters) == arguments | {"sources", "out", "like", "progress"}
