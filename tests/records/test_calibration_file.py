import hashlib
from dataclasses import asdict, astuple, replace
from pathlib import Path
from typing import Any

import pytest
from small_recordings import calibration_text

from scleraforce.base.errors import CalibrationError
from scleraforce.base.normal_distribution import MOST_CORRELATED
from scleraforce.records.calibration_file import (
    CalibrationSummary,
    globe_entry,
    known_of_eye,
    read_calibration,
)
from scleraforce.records.eye import ForceDiscrepancy
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import HoldFinding, Relaxation

EYES = {
    "a": {
        "frames": [
            {"file": "1.png", "sha256": "1f"},
            {"file": "2.png", "sha256": "2f"},
        ],
        "mean_mpa": 0.31,
    },
    "b": {"status": "diverged: by 4 sd", "frames": [{"file": "1.png", "sha256": "3f"}]},
}


def read(
    folder: Path,
    mean_mpa: float = 0.27,
    eyes: dict[str, Any] | None = None,
    **keys: Any,
) -> CalibrationSummary:
    file = folder / "calibration.json"
    file.write_text(calibration_text(mean_mpa, eyes, **keys))
    return read_calibration(file)


def test_eyes_population_and_provenance_are_read(tmp_path: Path) -> None:
    found = read(tmp_path, eyes=EYES)
    file = tmp_path / "calibration.json"
    eye = found.eyes["a"]
    diverged = found.eyes["b"]
    assert (found.population_mean_pa, found.population_sd_pa) == pytest.approx(
        (0.27e6, 0.03e6)
    )
    assert eye.eye.modulus is not None
    assert (
        eye.eye.modulus.mean_pa,
        eye.eye.modulus.sd_pa,
        eye.eye.thickness_m,
    ) == pytest.approx((0.31e6, 5e3, 0.7e-3))
    assert eye.eye.modulus.source == "own"
    assert (eye.usable, diverged.usable, diverged.frames[0].file) == (
        True,
        False,
        "1.png",
    )
    assert (found.digests, found.mechanics, found.path) == (
        {"1f", "2f", "3f"},
        "finite-strain",
        str(file),
    )
    assert found.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()


def refusal(file: Path, text: str) -> str:
    """The one line that refuses a file of this text, after the file's name."""
    file.write_text(text, encoding="latin-1")
    with pytest.raises(CalibrationError) as fault:
        read_calibration(file)
    assert str(fault.value).startswith(f"{file}: ")
    assert "\n" not in str(fault.value)
    return str(fault.value).removeprefix(f"{file}: ")


def test_a_file_that_is_not_json_or_of_another_format_is_refused(
    tmp_path: Path,
) -> None:
    whole = calibration_text()
    broken = tmp_path / "calibration.json"

    for text in (
        "{",
        "\xff",
        calibration_text(float("nan")),
        calibration_text(float("inf")),
        whole.replace("0.27", "1e999"),
        whole.replace("0.27", "9" * 5000),
        "[" * 100_000,
        whole.replace('"population"', '"format": 3, "population"'),
    ):
        assert refusal(broken, text).startswith("not JSON: ")

    for text in ("[]", "{}", calibration_text(format=1), calibration_text(format=2)):
        assert refusal(broken, text).startswith("format: ")

    for mechanics in ("magic", ["linear"], None):
        assert refusal(broken, calibration_text(mechanics=mechanics)).startswith(
            "mechanics: "
        )

    for eye in ("a\nb", "\ud800"):
        assert refusal(broken, calibration_text(0.2, {eye: {}})).startswith("eyes: ")


def test_a_key_that_is_missing_or_cannot_be_is_refused_by_its_place(
    tmp_path: Path,
) -> None:
    whole = calibration_text()
    broken = tmp_path / "calibration.json"

    for population, key in (
        ({}, ".mean_mpa"),
        (3, ": "),
        (None, ": "),
        ({"mean_mpa": 0.2}, ".sd_mpa"),
        ({"mean_mpa": "stiff"}, ".mean_mpa"),
        ({"mean_mpa": True}, ".mean_mpa"),
        ({"mean_mpa": -1, "sd_mpa": 0.03}, ".mean_mpa"),
        ({"mean_mpa": 0.2, "sd_mpa": "x"}, ".sd_mpa"),
        ({"mean_mpa": 0.2, "sd_mpa": -1}, ".sd_mpa"),
    ):
        assert refusal(broken, calibration_text(population=population)).startswith(
            f"population{key}"
        )

    for eyes, place in (("[]", "eyes: "), ('{"x": []}', "eyes")):
        assert refusal(
            broken, whole.replace('"eyes": {}', f'"eyes": {eyes}')
        ).startswith(place)

    for entry, key in (
        ({"frames": "1.png"}, "frames"),
        ({"frames": ["1.png"]}, "frames[0]"),
        ({"frames": [{"file": "1.png"}]}, "frames[0].sha256"),
        ({"frames": [{"file": "1\n", "sha256": ""}]}, "frames[0].file"),
        ({"mean_mpa": None}, "mean_mpa"),
        ({"mean_mpa": 1e300}, "mean_mpa"),
        ({"sd_mpa": -1}, "sd_mpa"),
        ({"thickness_um": 0}, "thickness_um"),
        ({"status": 0}, "status"),
        ({"status": "a\u2028b"}, "status"),
        ({"discrepancy": 3}, "discrepancy"),
        ({"globe": None}, "globe"),
        ({"globe": []}, "globe"),
    ):
        assert refusal(broken, calibration_text(0.2, {"x": entry})).startswith(
            f"eyes.x.{key}"
        )

    for key, value in (
        ("growth", "steep"),
        ("growth", 3.0),
        ("level", None),
        ("level_sd", -0.1),
        ("growth_sd", 2.1),
        ("correlation", 1.0),
        ("largest_n", 31.0),
        ("widest_gap", 1.5),
        ("level_by", [0.1]),
        ("level_by", None),
        ("growth_by", [3.0, 0.0]),
        ("scatter", -0.1),
        ("scatter", "x"),
    ):
        text = calibration_text(
            0.27, {"x": {"discrepancy": {**DISCREPANCY, key: value}}}
        )
        assert refusal(broken, text).startswith(f"eyes.x.discrepancy.{key}")

    for value in (-0.1, 200.1, "stiff", True, None, [1.0]):
        assert refusal(
            broken, calibration_text(0.27, {"x": {"stiffening": value}})
        ).startswith("eyes.x.stiffening: ")
        population = {"mean_mpa": 0.27, "sd_mpa": 0.03, "stiffening": value}
        assert refusal(
            broken, calibration_text(0.27, population=population)
        ).startswith("population.stiffening: ")


def test_a_refusal_names_the_value_and_the_unit_that_may_be_meant(
    tmp_path: Path,
) -> None:
    said = refusal(tmp_path / "c.json", calibration_text(270.0))
    assert said == (
        "population.mean_mpa: 270 is above the largest allowed value 50; did you mean"
        " 0.27 MPa (270 kPa)?; give a file of `scleraforce calibrate`"
    )
    with pytest.raises(CalibrationError, match=r"nothing\.json: No such file"):
        read_calibration(tmp_path / "nothing.json")


GLOBES = {
    "open": OPEN,
    "unknown": UNKNOWN,
    "stated": Globe.declared("sealed", 1e8, "logarithmic"),
    "calibrated": replace(
        SEALED, mean=1.3e8, sd=4e6, correlation=-0.4, calibrated=True
    ),
    "nearly open": replace(
        UNKNOWN, mean=-1e5, sd=1e6, correlation=0.7, calibrated=True
    ),
    "most correlated": replace(SEALED, correlation=-MOST_CORRELATED, calibrated=True),
}


def test_a_globe_is_read_as_it_was_written_with_its_band_for_people(
    tmp_path: Path,
) -> None:
    entries = {name: {"globe": globe_entry(globe)} for name, globe in GLOBES.items()}
    found = read(tmp_path, eyes={**entries, "without": {}}).eyes

    for name, globe in GLOBES.items():
        wanted = [
            value if isinstance(value, str | bool) else pytest.approx(value)
            for value in astuple(globe)
        ]
        read_globe = found[name].eye.globe
        assert read_globe is not None
        assert wanted == list(astuple(read_globe)), name
        low, high = (entries[name]["globe"][K][end] for end in ("low", "high"))
        assert 0.0 <= low <= high <= 0.06

    assert found["without"].eye.globe is OPEN  # an early file


K = "rigidity_mmhg13_per_ul"


def test_a_globe_that_cannot_be_is_refused_with_its_key(tmp_path: Path) -> None:
    numbers = [f"{K}.{name}" for name in ("lowest", "highest", "mean", "sd")]
    cases: list[tuple[str, Any]] = [
        ("kind", "shut"),
        ("kind", ["open"]),
        ("rigidity_law", "linear"),
        ("calibrated", 1),
        ("rigidity_told", 0),
        (K, 0.03),
        (f"{K}.mean", "stiff"),
        (f"{K}.mean", -3.0),
        (f"{K}.sd", -0.1),
        (f"{K}.lowest", -0.01),
        (f"{K}.highest", 1e9),
        ("correlation", 1.0),
        ("correlation", True),
        *((place, None) for place in numbers),
        *((place, ...) for place in numbers),  # ...: without the number
    ]

    for place, value in cases:
        globe = globe_entry(GLOBES["calibrated"])
        *parents, last = place.split(".")
        target = globe[parents[0]] if parents else globe
        assert target.pop(last) is not None

        if value is not ...:
            target[last] = value

        said = refusal(
            tmp_path / "c.json", calibration_text(0.27, {"a": {"globe": globe}})
        )
        assert said.startswith(
            f"eyes.a.globe.{place}{': missing' if value is ... else ''}"
        ), place

    for changed in (
        {"sd": 0.0},
        {"lowest": 0.07},
    ):
        # each number can be, not all together
        globe = globe_entry(GLOBES["calibrated"])
        globe[K] |= changed
        text = calibration_text(0.27, {"a": {"globe": globe}})
        assert refusal(tmp_path / "c.json", text).startswith(f"eyes.a.globe.{K}: ")


DISCREPANCY = {
    "level": 0.02,
    "growth": 0.4,
    "level_sd": 0.01,
    "growth_sd": 0.05,
    "correlation": -0.3,
}


def test_stiffening_and_discrepancy_go_with_the_modulus_that_an_eye_has(
    tmp_path: Path,
) -> None:
    found = DISCREPANCY | {"largest_n": 31e-3}
    eyes = {
        "a": {"stiffening": 12.5, "discrepancy": found},
        "b": {},
        "c": {
            "stiffening": 3.0,
            "discrepancy": DISCREPANCY,
            "status": "diverged: by 4 sd",
        },
    }
    summary = read(
        tmp_path,
        eyes=eyes,
        population={"mean_mpa": 0.27, "sd_mpa": None, "stiffening": 6.0},
    )
    assert [summary.eyes[eye].eye.stiffening for eye in "abc"] == [12.5, 0.0, 3.0]
    assert summary.eyes["a"].eye.discrepancy == ForceDiscrepancy(**found)
    assert (summary.population_stiffening, summary.population_sd_pa) == (6.0, None)
    known = {eye: known_of_eye(Setup(), summary, eye) for eye in (*"abc", "stranger")}
    assert [one.eye.stiffening for one in known.values()] == [12.5, 0.0, None, 6.0]
    assert [one.eye.discrepancy for one in known.values()] == [
        ForceDiscrepancy(**found),
        None,
        None,
        None,
    ]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"covariance": [[-1e-4, 0.0], [0.0, 1e-4]]}, "covariance: "),
        ({"covariance": [[1.0, 2.0], [2.0, 1.0]]}, "covariance: "),
        ({"held_covariance": [[1.0, 0.1], [0.2, 1.0]]}, "held_covariance: "),
        ({"before_covariance_n2": [[-1.0, 0], [0, 0]]}, "before_covariance_n2: "),
        ({"after_covariance_n2": [[0, 1e-9], [1e-9, 0]]}, "after_covariance_n2: "),
        ({"shares": [0.6, 0.5]}, "shares: add up to 1.1; expected less than 1"),
        ({"shares": [0.6]}, "shares: expected 2 numbers"),
        ({"held_covariance": [[1.0], [0.1]]}, "held: expected 2 numbers"),
        ({"times_s": [0.0, 1.0]}, "times_s: 0 is below the smallest"),
    ],
)
def test_a_covariance_without_a_negative_variance_is_needed(
    changed: dict, words: str, tmp_path: Path
) -> None:
    found = asdict(Relaxation.declared([[0.1, 1.0], [0.05, 10.0]]))
    text = calibration_text(0.27, {"a": {"relaxation": found | changed}})
    said = refusal(tmp_path / "c.json", text)
    assert said.startswith(f"eyes.a.relaxation.{words}")
    sound = calibration_text(0.27, {"a": {"relaxation": found}})
    (tmp_path / "d.json").write_text(sound)
    assert read_calibration(tmp_path / "d.json").eyes["a"].eye.relaxation is not None


def test_a_relaxation_of_an_early_file_has_no_finding(tmp_path: Path) -> None:
    found = asdict(Relaxation.declared([(0.12, 1.2)])) | {"source": "holds"}
    early = {name: found[name] for name in found if name not in ("other", "finding")}
    summary = read(tmp_path, eyes={"a": {"relaxation": early}})
    relaxation = summary.eyes["a"].eye.relaxation
    assert relaxation is not None
    assert (relaxation.shares, relaxation.other) == ((0.12,), ())
    assert relaxation.finding is None


def test_what_the_holds_have_shown_comes_back_from_a_file(tmp_path: Path) -> None:
    finding = HoldFinding(
        cause="undecided", hold_s=7.1, fall=0.12, chance=0.25, not_estimated_s=(30.0,)
    )
    written = replace(
        Relaxation.declared([(0.0, 1.2)]),
        source="holds",
        other=(0.12,),
        finding=finding,
    )
    eyes = {name: {"relaxation": asdict(written)} for name in "ab"}
    summary = read(tmp_path, eyes=eyes)
    assert summary.eyes["a"].eye.relaxation == written
    stranger = known_of_eye(Setup(), summary, "stranger").eye.relaxation
    assert stranger is not None
    assert stranger.other == pytest.approx((0.12,))


def test_shares_of_the_other_explanation_are_checked(tmp_path: Path) -> None:
    written = asdict(Relaxation.declared([(0.0, 1.2)]))
    for other in ((0.1, 0.1), (1.2,)):
        with pytest.raises(CalibrationError, match="relaxation"):
            read(tmp_path, eyes={"a": {"relaxation": written | {"other": other}}})
