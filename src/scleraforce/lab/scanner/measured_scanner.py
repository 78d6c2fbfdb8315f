"""A scanner measured on its frames: frame by frame, then as ranges over the frames,
then as a study.
"""

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import FrameError
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.scanner import scanner_display, scanner_light
from scleraforce.lab.scanner.scanner_display import (
    Display,
    DisplayKind,
    Estimate,
    ImagedEye,
    Measured,
    Unmeasured,
)
from scleraforce.lab.tissue_light import (
    BscanOptics,
    Drawn,
    ReflectionLine,
    Shadow,
    sample_optics,
)
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.fields import field_key, field_unit, fixed
from scleraforce.records.frame import Pixels
from scleraforce.records.study import (
    Choice,
    OctStudy,
    PhantomStudy,
    Range,
    ScenesStudy,
    Study,
    format_study,
)

FIELDS = {item.name: item for item in fields(PhantomStudy)}
# frames: with more, their 5 % quantiles bound a range, not the one frame farthest off
MANY = 10
QUANTILES = (0.05, 0.95)
MOST_COUNTS = 100  # entries of a list of counts
# Measured fields of `PhantomStudy`; the names in NOT_DRAWN are not fields: it draws
# nothing of the kind.
OF_FRAMES = (
    "snr_db",
    "axial_resolution_m",
    "lateral_resolution_m",
    "display_floor_db",
    "display_range_db",
    "band_m",
    "attenuation_per_m",
    "reflection_db",
    "reflection_angle_rad",
    "choroid_level_db",
    "choroid_attenuation_per_m",
    "choroid_thickness_m",
)
OF_SHADOWS = ("loss_fraction", "width_m")
OF_LINES = ("depth_m", "level_db", "thickness_m")
NOT_DRAWN = (
    "roll_off_db_per_m",
    "noise_looks",
    "noise_misfit_db",
    "speckle_skew",
    "spread_slope",
)
# times as far the wall's speckle spreads as the noise: it tells the display's scale
AVERAGED = 1.25
LEAST_PIXELS = 500
OCTILES = (0.125, 0.25, 0.5, 0.75, 0.875)
# Of [scenes.tissue] and [scenes.scanner]: what is measured, and how exactly it is
# known: in dB, or as a share of it.
SCENES = {
    "snr_db": ("snr_db", 3.0),  # of other eyes
    "speckle_rows": ("axial_resolution_m", 0.1),
    "speckle_columns": ("lateral_resolution_m", 0.1),
    "looks": ("noise_looks", AVERAGED - 1.0),
    "line_db": ("line_level_db", 1.0),
    "line_m": ("line_thickness_m", 0.1),
    "display_floor_db": ("display_floor_db", 1.0),
    "band_fraction": ("band_m", 0.0),
}
MOST_AXIAL_M = 1e-3  # of a scanner whose speckle is known: no other limit
# noise of one look seen with a gamma of 1.1 misfits an exponential by 0.08 dB
LEAST_GAMMA = 0.1
GAMMA_PER_DB = 1.2


@dataclass(frozen=True, eq=False)
class MeasuredFrame:
    """One frame's results: `values` by the field's name, in SI; shadows and lines."""

    eye: ImagedEye
    display: Display
    values: Mapping[str, Measured]
    shadows: tuple[Shadow, ...]
    lines: tuple[ReflectionLine, ...]


@dataclass(frozen=True, kw_only=True)
class MeasuredRange:
    """A value over all frames, in SI: `median`, from `low` to `high`; the number of
    frames or things with it.
    """

    median: float
    low: float
    high: float
    seen: int
    at_most: bool = False  # an upper bound, in all of them


@dataclass(frozen=True, eq=False)
class MeasuredScanner:
    """A scanner: its display; ranges, or reasons, by the field's name, in SI; counts of
    each frame; frames.
    """

    # taken from the noise where the wall does not show it (`spread_slope` has no range)
    display: DisplayKind
    ranges: Mapping[str, MeasuredRange | Unmeasured]
    counts: Mapping[str, tuple[int, ...]]
    frames: tuple[MeasuredFrame, ...]

    def phantom(self) -> PhantomStudy:
        """Return the section of a study that draws such frames; unmeasured values keep
        their defaults.
        """
        known = {
            name: found
            for name, found in self.ranges.items()
            if isinstance(found, MeasuredRange)
        }
        ranges = _measured(
            PhantomStudy(),
            {name: (found.low, found.high) for name, found in known.items()},
        )
        choices: dict[str, Any] = {
            name: Choice(tuple(map(float, sorted(counts[:MOST_COUNTS]))))
            for name, counts in self.counts.items()
        }

        return replace(ranges, display=self.display.name, **choices)

    def scenes(self) -> ScenesStudy:
        """Return the sections that draw scenes as this scanner shows them; unmeasured
        values keep their defaults.

        So does the tissue, except its light: other eyes differ.
        """
        size = oct_of(self.frames[0].eye)
        scenes = ScenesStudy()
        row_m = size.depth_m / size.rows
        column_m = size.width_m / size.columns
        units = {
            "speckle_rows": row_m,
            "speckle_columns": column_m,
            "band_fraction": size.width_m,
        }
        ends = {
            key: _wider(
                found,
                exact if key.endswith("_db") else exact * found.median,
                units.get(key, 1.0),
            )
            for key, (name, exact) in SCENES.items()
            if isinstance(found := self.ranges[name], MeasuredRange)
        }
        at_top = [
            float(np.mean(frame.eye.pixels >= frame.display.top))
            for frame in self.frames
        ]
        misfit_db = max(frame.display.misfit_db for frame in self.frames)
        off = max(LEAST_GAMMA, GAMMA_PER_DB * misfit_db)
        ends["gamma"] = tuple(
            np.clip((1.0 - off, 1.0 + off), *scenes.scanner.gamma.bounds)
        )
        ends |= {
            "bits": (size.bits,) * 2,
            "saturated_fraction": (min(at_top) / 2, max(at_top) * 2),
        }
        tissue = {"snr_db": ends.pop("snr_db")}

        if self.display is not scanner_display.LOGARITHMIC:
            del ends["display_floor_db"]  # they begin at black

        given: dict[str, Any] = (
            {"line_count": self.phantom().line_count} if "line_db" in ends else {}
        )
        given |= {"averaged_share": 0.0, "axial_m": fixed(MOST_AXIAL_M)}
        given["band_share"] = float(ends.get("band_fraction", (0.0, 1.0))[1] > 0.0)

        if (
            isinstance(self.ranges["spread_slope"], MeasuredRange)
            or misfit_db < scanner_display.ONE_LOOK_DB
        ):
            given |= {
                f"{kind}_share": float(self.display.name == kind)
                for kind in ("linear", "root")
            }

        window = {
            key: (getattr(size, key),) * 2 for key in ("rows", "columns", "width_m")
        }
        window["depth_share"] = (size.depth_m / size.width_m,) * 2
        # so the last digit of the size changes no rows
        window["pixel_m"] = (
            0.9 * row_m,
            1.1 * row_m,
        )
        deep = {
            f"deep_{key}": window[key] for key in ("rows", "width_m", "depth_share")
        }
        least = (
            scenes.window.deep_width_m.bounds[0],
            scenes.window.deep_depth_share.bounds[0],
        )
        lens_seen = (
            window["width_m"][0] >= least[0] and window["depth_share"][0] >= least[1]
        )
        shown = _measured(scenes.window, window | deep)

        return replace(
            scenes,
            window=shown if lens_seen else replace(shown, deep_share=0.0),
            tissue=_measured(scenes.tissue, tissue),
            scanner=replace(_measured(scenes.scanner, ends), **given),
        )


def measure_scanner(eyes: Iterable[ImagedEye]) -> MeasuredScanner:
    """Measure a scanner on frames of an eye at rest, at least one."""
    seen = list(eyes)
    slopes = [scanner_display.spread_slope(eye) for eye in seen]
    kind = scanner_display.display_kind(slopes, seen)
    measured = [
        _measure(eye, kind, slope) for eye, slope in zip(seen, slopes, strict=True)
    ]
    strengths, angle = scanner_light.reflections([surface for _, surface in measured])
    frames = tuple(
        replace(
            frame,
            values={
                **frame.values,
                "reflection_db": strength,
                "reflection_angle_rad": angle,
            },
        )
        for (frame, _), strength in zip(measured, strengths, strict=True)
    )
    ranges = {
        name: _range([frame.values[name] for frame in frames])
        for name in (*OF_FRAMES, *NOT_DRAWN)
    }
    ranges["reflection_angle_rad"] = _range([angle])

    for thing, names, where in (
        ("shadow", OF_SHADOWS, "on the wall"),
        ("line", OF_LINES, "above the tissue"),
    ):
        things = [each for frame in frames for each in getattr(frame, f"{thing}s")]
        for name in names:
            seen_in: list[Measured] = [
                Estimate(value=getattr(each, name)) for each in things
            ]
            ranges[f"{thing}_{name}"] = _range(
                seen_in or [Unmeasured(f"no {thing} is seen {where}")]
            )

    ranges = {name: _within_bounds(name, found) for name, found in ranges.items()}
    for name in ("display_floor_db", "display_range_db", "snr_db"):
        if isinstance(found := ranges[name], Unmeasured):
            raise FrameError(f"{frames[0].eye.name}: {name}: {found.reason}")

    shadows, lines = (
        tuple(len(getattr(frame, things)) for frame in frames)
        for things in ("shadows", "lines")
    )
    return MeasuredScanner(
        kind, ranges, {"shadow_count": shadows, "line_count": lines}, frames
    )


def _measure(
    eye: ImagedEye, kind: DisplayKind, slope: Measured
) -> tuple[MeasuredFrame, scanner_light.SurfaceLight]:
    """Measure one frame, except its reflection, which is fitted to all frames
    together.
    """
    display = scanner_display.fit_display(eye, kind)
    tissue = scanner_light.light_in_wall(eye, display)
    spread, skew = _speckle_spread(eye, tissue, display)
    if kind is scanner_display.LOGARITHMIC and spread > AVERAGED:
        display = scanner_display.display_of_speckle(eye, display, spread)
        tissue = scanner_light.light_in_wall(eye, display)

    axial, lateral = scanner_light.resolutions(eye, display, tissue)
    level, attenuation, thickness = scanner_light.layer_below(eye, display, tissue)
    band = Estimate(value=float(np.mean(eye.bands)) * eye.scale.lateral_m)
    values: dict[str, Measured] = {
        "snr_db": tissue.snr_db,
        "attenuation_per_m": tissue.attenuation_per_m,
        "axial_resolution_m": axial,
        "lateral_resolution_m": lateral,
        "display_floor_db": display.floor_db,
        "display_range_db": display.range_db,
        "band_m": band,
        "choroid_level_db": level,
        "choroid_attenuation_per_m": attenuation,
        "choroid_thickness_m": thickness,
        "noise_looks": Estimate(value=display.looks),
        "noise_misfit_db": Estimate(value=display.misfit_db),
        "roll_off_db_per_m": scanner_light.roll_off(eye, tissue),
        "speckle_skew": skew,
        "spread_slope": slope,
    }
    shadows = scanner_light.find_shadows(eye, tissue)
    lines = scanner_display.find_lines(eye, display)

    return MeasuredFrame(
        eye, display, values, shadows, lines
    ), scanner_light.surface_light(eye, display, tissue, axial)


def _speckle_spread(
    eye: ImagedEye, tissue: scanner_light.WallLight, display: Display
) -> tuple[float, Measured]:
    """Return the spread of the wall's speckle over one look's, 1 if unknown, and its
    octile skew (one look: -0.20).
    """
    expected_db = tissue.expected_db
    chosen = (
        eye.inside
        & tissue.clear
        & (expected_db < display.highest_db - 3.0)
        & (expected_db > 3.0)
    )
    if np.count_nonzero(chosen) < LEAST_PIXELS:
        return 1.0, Unmeasured("too little of the wall lies within the display")

    first, low, middle, high, last = np.quantile(
        tissue.levels[chosen] - expected_db[chosen], OCTILES
    )
    skew = (first + last - 2.0 * middle) / (last - first)

    return float((high - low) / scanner_display.QUARTILES_DB), Estimate(
        value=float(skew)
    )


def _range(found: Sequence[Measured]) -> MeasuredRange | Unmeasured:
    """Return the range of a value over frames; for one frame, its standard error to
    both sides.
    """
    known = [each for each in found if isinstance(each, Estimate)]
    if not known:
        reasons = Counter(each.reason for each in found if isinstance(each, Unmeasured))
        return Unmeasured(reasons.most_common(1)[0][0])

    values = np.array([each.value for each in known])
    if all(each.at_most for each in known):
        most = float(values.max())
        return MeasuredRange(
            median=most, low=most, high=most, seen=len(known), at_most=True
        )
    if len(known) == 1:
        return MeasuredRange(
            median=values[0],
            low=values[0] - known[0].error,
            high=values[0] + known[0].error,
            seen=1,
        )

    low, high = (
        np.quantile(values, QUANTILES)
        if len(known) > MANY
        else (values.min(), values.max())
    )
    return MeasuredRange(
        median=float(np.median(values)),
        low=float(low),
        high=float(high),
        seen=len(known),
    )


def _within_bounds(
    name: str, found: MeasuredRange | Unmeasured
) -> MeasuredRange | Unmeasured:
    """Return a range within the bounds of the study's key; one that lies outside is
    unmeasured.
    """
    if isinstance(found, Unmeasured) or name in NOT_DRAWN:
        return found

    unit = field_unit(FIELDS[name])
    low, high = (unit.to_si(end) for end in (unit.low, unit.high) if end is not None)
    if not low <= found.median <= high:
        return Unmeasured(
            f"{unit.from_si(found.median):.4g} is outside of a study's range"
        )

    return replace(
        found,
        low=float(np.clip(found.low, low, high)),
        high=float(np.clip(found.high, low, high)),
    )


def _wider(found: MeasuredRange, exact: float, unit: float) -> tuple[float, float]:
    """Return a range's ends in a unit, each side wider by its error, and by more if
    frames are few.
    """
    more = exact + (found.high - found.low) / max(found.seen - 1, 1)
    return (0.0 if found.at_most else (found.low - more) / unit), (
        found.high + more
    ) / unit


def _measured(section: Drawn, ends: Mapping[str, tuple[float, float]]) -> Drawn:
    """Return a section of a study with these ranges, to four digits in the keys' units,
    within the keys' bounds.
    """
    ranges: dict[str, Any] = {}
    for item in fields(section):
        if item.name in ends:
            unit = field_unit(item)
            both = np.clip(
                [unit.from_si(end) for end in ends[item.name]], unit.low, unit.high
            )
            low, high = (unit.to_si(float(f"{end:.4g}")) for end in both)
            ranges[item.name] = (
                Choice((low,)) if low == high else Range(min=low, max=high)
            )

    return replace(section, **ranges)


BINS = 64
BEYOND_M = 5e-3  # of a wall that is seen up to the picture's edge


def oct_of(eye: ImagedEye) -> OctStudy:
    """Return a frame's size, pixels, bits and refractive index as the section of a
    study.
    """
    rows, columns = eye.pixels.shape
    return OctStudy(
        width_m=eye.scale.lateral_m * columns,
        depth_m=eye.scale.depth_m * rows,
        columns=columns,
        rows=rows,
        bits=eye.bits,
        refractive_index=eye.scale.refractive_index,
    )


def drawn_alike(
    frame: MeasuredFrame, phantom: PhantomStudy, rng: np.random.Generator
) -> Pixels:
    """Draw counts like a measured frame's, with its wall; `phantom` has the scanner's
    other values.
    """
    scanner = oct_of(frame.eye)
    known = {item.name for item in fields(BscanOptics)}
    estimates = {
        name: found.value
        for name, found in frame.values.items()
        if isinstance(found, Estimate)
    }
    measured: dict[str, Any] = {
        name: value for name, value in estimates.items() if name in known
    }
    measured |= {"shadows": frame.shadows, "lines": frame.lines, "covers": ()}
    optics = replace(sample_optics(phantom, scanner, rng), **measured)
    drawn = render_bscan(_section(frame.eye, scanner), scanner, optics, rng).frame

    return drawn.astype(np.uint8) if frame.eye.pixels.dtype == np.uint8 else drawn


def histogram_overlap(
    one: NDArray[np.generic], other: NDArray[np.generic], top: int
) -> float:
    """Return the share that two frames' histograms have in common: 1 where they are
    alike.
    """
    first, second = (
        np.histogram(counts, BINS, (0, top + 1))[0] / counts.size
        for counts in (one, other)
    )
    return float(np.minimum(first, second).sum())


def _section(eye: ImagedEye, scanner: OctStudy) -> WallSection:
    """Return a frame's wall as a section: lateral from the middle, geometric depth from
    the top edge, m.
    """
    columns = np.flatnonzero(eye.walled)
    lateral_m = (columns + 0.5) * eye.scale.lateral_m - scanner.width_m / 2
    outer_m = (eye.surface_row[columns] + 0.5) * eye.scale.depth_m
    inner_m = outer_m + (eye.wall.inner_row - eye.wall.outer_row)[columns] * eye.row_m
    left, right = eye.bands
    beyond = (
        int(columns[0] <= left + 1),
        int(columns[-1] >= len(eye.walled) - right - 2),
    )
    ends_m = lateral_m[0] - BEYOND_M, lateral_m[-1] + BEYOND_M
    lateral_m = np.pad(lateral_m, beyond, constant_values=ends_m)

    return WallSection(
        *(
            np.stack([lateral_m, np.pad(m, beyond, mode="edge")], axis=1)
            for m in (outer_m, inner_m)
        )
    )


MOST_NAMES = 20  # of frames that are listed


def study_text(
    scanner: MeasuredScanner, names: Sequence[str], date: str, version: str
) -> str:
    """Return the text of the study file, with the frames' names, the date and the
    version of scleraforce.
    """
    study = Study(
        oct=oct_of(scanner.frames[0].eye),
        phantom=scanner.phantom(),
        scenes=scanner.scenes(),
    )
    sections, plain = (_sections(format_study(each)) for each in (study, Study()))
    listed = [f"#   {json.dumps(name)}" for name in names[:MOST_NAMES]]

    if len(names) > MOST_NAMES:
        listed.append(f"#   and {len(names) - MOST_NAMES} more")

    phantom = sections["phantom"]
    slope = scanner.ranges["spread_slope"]
    taken = (
        f"  # from the noise: {slope.reason}" if isinstance(slope, Unmeasured) else ""
    )
    lines = [
        (
            f"# A scanner, measured by `scleraforce scanner` {version} on {date}, on"
            f" {len(names)} frame(s):"
        ),
        *listed,
        (
            "# All other values, also of eye, needle and forces, are the paper's"
            " study's, and the scenes' defaults."
        ),
        "",
        "[oct]",
        *sections["oct"].values(),
        "",
        "[phantom]  # levels in dB are ratios of intensity",
        f"{phantom['display']}{taken}",
        *(_line(name, phantom, scanner) for name in OF_FRAMES),
    ]

    for thing, names in (("shadow", OF_SHADOWS), ("line", OF_LINES)):
        lines.append(f"{phantom[f'{thing}_count']}  # of each frame")
        lines += [_line(f"{thing}_{name}", phantom, scanner) for name in names]

    for name in ("scenes.window", "scenes.tissue", "scenes.scanner"):
        lines += [
            "",
            f"[{name}]",
            *(line for key, line in sections[name].items() if line != plain[name][key]),
        ]

    return "\n".join(lines) + "\n"


def _line(name: str, phantom: dict[str, str], scanner: MeasuredScanner) -> str:
    key = field_key(FIELDS[name])
    found = scanner.ranges[name]
    if isinstance(found, Unmeasured):
        return f"# {key}: not measured, as in the paper's study: {found.reason}"

    return phantom[key] + (
        "  # at most: finer than the pixels show" if found.at_most else ""
    )


def _sections(text: str) -> dict[str, dict[str, str]]:
    found: dict[str, dict[str, str]] = {}
    for line in text.splitlines():
        if line.startswith("["):
            found[line.strip("[]")] = section = {}
        elif " = " in line:
            section[line.partition(" = ")[0]] = line

    return found
