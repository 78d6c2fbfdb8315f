"""The model card of a reader: what it was made from, what it reaches, and what it must not be used for."""

from collections.abc import Mapping
from typing import Any

from scleraforce.known.eye import UNKNOWN
from scleraforce.study import Study
from scleraforce.units import HumanUnit, from_si


def reader_card(study: Study, record: Mapping[str, Any]) -> str:
    """Return the card, in Markdown.

    Args:
        study: of the training.
        record: what `model.json` keeps.
    """
    reader, metrics, samples = study.reader, record["metrics"], record["samples"]
    errors = record["library"]
    low, high = (from_si(bound, "mn") for bound in study.classes.bounds_n)
    return f"""# Force of a needle on the sclera, from one OCT slice

Reads a binary slice of the scleral wall ({study.slice.rows} x {study.slice.columns} pixels of
{from_si(study.slice.pixel_m, "mm"):g} mm) and, where they are known, Young's modulus (with its uncertainty), IOP, \
wall thickness
and the gap between B-scan and needle. It answers with a histogram of F/E ({reader.bins} bins): the force with a 90 %
interval and the probability of three classes (below {low:g} mN, {low:g} to {high:g} mN, above {high:g} mN) follow from
it. And with the contact's place along the slice. `library.npz` holds the computed walls, for the fit beside it, in a
reduced basis: their points are off by at most {from_si(errors["curves_m"], "um"):.2g} µm, forces by a share of \
{errors["stiffness"]:.1g}.

## What it learned from
{samples["training"]} computed slices, each seen once; {samples["validation"]} others to validate. All are computed with
finite strain (compressible neo-Hookean sphere, axisymmetric about the needle, moved by what the base beside it does): \
no real eye. Library SHA-256
`{record["provenance"]["library_sha256"]}`.

| | |
|---|---|
| Young's modulus | {_spread(reader.youngs_modulus_pa.bounds, "mpa", "MPa")}; told with a standard deviation \
of {_spread(reader.modulus_sd_fraction.bounds, "percent", "%")} |
| Poisson's ratio | {study.eye.poisson_ratio:g} |
| intraocular pressure | {_spread(reader.iop_pa.bounds, "mmhg", "mmHg")} |
| wall thickness | {_spread(reader.thickness_m.bounds, "um", "µm")} |
| outer radius | {_spread(tuple(size * study.eye.radius_m for size in reader.size.bounds), "mm", "mm")} |
| globe | told to be open {reader.globe_open_fraction:.0%}, nothing told {reader.globe_missing_fraction:.0%}, the rest \
sealed; a rigidity of up to {from_si(UNKNOWN.highest, "mmhg13_per_ul"):g} mmHg^(1/3)/µl, of \
{reader.rigidity_missing_fraction:.0%} of the sealed ones not told |
| gap between B-scan and needle axis | {_spread(reader.gap_m.bounds, "mm", "mm")} |
| force | 0 to {from_si(reader.max_force_n, "mn"):g} mN, even; {reader.small_force_share:.0%} within 0 to \
{from_si(reader.small_force_n, "mn"):g} mN |
| contact, from the slice's middle | {_spread(reader.lateral_m.bounds, "mm", "mm")} |
| contact, below the upper edge | {_spread(reader.surface_depth_m.bounds, "mm", "mm")} |
| tilt of the B-scan | {_spread(reader.tilt_rad.bounds, "deg", "°")} |
| rotation in the B-scan | {_spread(reader.rotation_rad.bounds, "deg", "°")} |
| contact, from the eye's pole | {_spread(reader.polar_angle_rad.bounds, "deg", "°")}, the B-scan in any direction |
| no even spheres at rest (ellipsoids, a cornea in view, walls that grow thicker) | {reader.uneven_share:.0%} of the \
samples |
| size 1, no tilt, no rotation | {reader.plain_share:.0%} of the samples |
| errors of the boundaries | {reader.boundary_errors:g} times those of the segmentation on rendered frames |
| told values are missing | modulus {reader.modulus_missing_fraction:.0%}, IOP {reader.iop_missing_fraction:.0%}, \
thickness {reader.thickness_missing_fraction:.0%}, gap {reader.gap_missing_fraction:.0%}, polar angle \
{reader.polar_missing_fraction:.0%}, direction of the B-scan {reader.direction_missing_fraction:.0%} |
| told values are off by (sd) | IOP {reader.iop_noise_fraction:.0%}, thickness {reader.thickness_noise_fraction:.0%}, \
gap {reader.gap_noise_fraction:.0%}, polar angle and direction {from_si(reader.pole_noise_rad, "deg"):g}° |

## What it reaches
On validation samples with all of the above, missing values included: mean force error {metrics["mae_mn"]:.2f} mN,
{metrics["coverage"]:.1%} of the 90 % intervals hold the force, {metrics["validation_accuracy"]:.2%} of classes right
(95 % Wilson interval {metrics["validation_interval"][0]:.2%} to {metrics["validation_interval"][1]:.2%}), contact
{metrics["lateral_mae_mm"]:.2f} mm off in the mean. On simulated slices: how it does on recordings, `scleraforce
evaluate` tells.

## Limits
- Its answer scales with the modulus that it is told: one that is 10 % too large reads forces 10 % too large.
- The forces of its training are even: where a slice says little, its answer leans to the middle of the range.
- Eyes are spheres of one material; of others the form at rest is known, not how they bend.
- {_intervals(record)}
- Outside the ranges above it still answers, and can be wrong with narrow intervals.

## Intended use
Research on force reading from OCT. Not a medical device; not for use on patients.
"""


def _intervals(record: Mapping[str, Any]) -> str:
    """Return on what the width of the intervals rests."""
    intervals = record.get("intervals")
    if intervals is None:
        return "Its intervals are as its methods say: they were not measured on whole eyes."
    return f"Its intervals were measured on {intervals['eyes']} eyes: {intervals['source']}."


def _spread(bounds: tuple[float, ...], unit: HumanUnit, printed: str) -> str:
    low, high = (f"{from_si(bound, unit):.4g}" for bound in bounds)
    return f"{low} {printed}" if low == high else f"{low} to {high} {printed}"
