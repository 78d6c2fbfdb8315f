"""`scleraforce phantom`: make a virtual acquisition."""

from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.globe import globe_options, with_globe
from scleraforce.cli.output import print_json, progress_bar, resumable_bar, say, share_bar
from scleraforce.cli.place_of_work import chosen_workers, worker_options
from scleraforce.errors import InputError
from scleraforce.study import Study, read_study
from scleraforce.study.unused import refuse_unused
from scleraforce.units import to_si

if TYPE_CHECKING:
    from scleraforce.laboratory.acquisition import Acquisition


class _Forces(click.ParamType[tuple[float, ...]]):
    """Forces in mN, separated by commas, as N."""

    name = "MN,MN,..."

    def convert(
        self, value: str | tuple[float, ...], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...]:
        """Return the forces in N."""
        if isinstance(value, tuple):
            return value
        try:
            return tuple(to_si(float(entry), "mn") for entry in value.split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of forces in mN; give for example 2,10,40", param, ctx)


@click.command()
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Recording folder to write; must not exist. With "
    "--count the folder of all recordings."
)  # fmt: skip
@click.option("--study", "study_path", type=click.Path(path_type=Path), help="Study file; the paper's by default.")
@click.option("--eye", "name", help="Name of the eye; eye-1 by default. With --count what stands before the number.")
@click.option("--count", type=click.IntRange(1, 1_000_000), help="So many eyes: contact, B-scan plane and thickness "
              "are drawn for each from the study, where no option tells them.")  # fmt: skip
@worker_options("make the recordings of --count")
@click.option("--forces-mn", type=_Forces(), default="2,8,14,20,26,34,40,48,56", show_default=True,
              help="True force at each frame, in mN: one step-and-hold push each.")  # fmt: skip
@click.option("--rate-hz", type=click.FloatRange(0.1, 1000), help="Frames a second of a needle that moves: --forces-mn "
              "are then the turning points of its force, which begins at 0.")  # fmt: skip
@click.option("--ramp-mn-per-s", type=click.FloatRange(0.01, 1e5), help="How fast the force changes between them; "
              "20 by default.")  # fmt: skip
@click.option("--hold-s", type=click.FloatRange(0, 3600), help="How long it stays at each; 1 by default.")
@click.option("--thickness-um", type=float, help="Thickness of the wall; 600 by default.")
@click.option("--youngs-modulus-mpa", type=float, help="Young's modulus of the wall; the study's by default.")
@click.option("--iop-mmhg", type=float, help="Intraocular pressure; the study's by default.")
@click.option("--gap-mm", type=float, help="B-scan plane to needle axis; the study's by default.")
@click.option("--polar-angle-deg", type=float, help="Contact, from the pole; 35 by default.")
@click.option("--azimuth-deg", type=float, help="Contact, about the pole; 0 by default.")
@click.option("--direction-deg", type=float, help="B-scan plane about the needle axis; 0 by default.")
@click.option("--tilt-deg", type=float, help="B-scan plane against the needle axis; 0 by default.")
@globe_options
@click.option("--mechanics", type=click.Choice(["linear", "finite-strain"]), help="How the wall bends; the study's by "
              "default (linear, if it does not say).")  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Of all that is drawn; the study's by default.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def phantom(
    out: Path,
    study_path: Path | None,
    name: str | None,
    count: int | None,
    scheduler: str | None,
    workers: int | None,
    forces_mn: tuple[float, ...],
    rate_hz: float | None,
    ramp_mn_per_s: float | None,
    hold_s: float | None,
    thickness_um: float | None,
    youngs_modulus_mpa: float | None,
    iop_mmhg: float | None,
    gap_mm: float | None,
    polar_angle_deg: float | None,
    azimuth_deg: float | None,
    direction_deg: float | None,
    tilt_deg: float | None,
    globe: str | None,
    rigidity: float | None,
    mechanics: str | None,
    seed: int | None,
    as_json: bool,
) -> None:
    """Make a virtual acquisition: raw B-scans, a force log, truth.json.

    [phantom] of the study has the ranges from which light, noise, shadows,
    timing and sensor are drawn; [form] shapes eyes that are not spheres
    (finite strain only).

    Example: scleraforce phantom --out eye-1 --thickness-um 800 --forces-mn 2,10,40

    A needle that a robot moves, at 100 frames a second:
    scleraforce phantom --out moving --rate-hz 100 --forces-mn 20,5,35 --ramp-mn-per-s 15

    Twenty eyes, in eyes/eye-1 to eyes/eye-20; an interrupted run is taken up by
    the same command: scleraforce phantom --out eyes --count 20
    """
    # Imported here: mechanics takes longer to import than the help to print.
    from scleraforce.laboratory.acquisition import Acquisition
    from scleraforce.notebook.virtual import with_mechanics

    if rate_hz is None and not (ramp_mn_per_s is None and hold_s is None):
        raise click.UsageError("--ramp-mn-per-s and --hold-s are of a needle that moves; give --rate-hz too")
    study = with_mechanics(Study() if study_path is None else read_study(study_path), mechanics)
    study = with_globe(study, globe, rigidity)
    refuse_unused(study, "phantom", study.mechanics.kind, study_path)
    angles = {"polar_rad": polar_angle_deg, "azimuth_rad": azimuth_deg, "direction_rad": direction_deg,
              "tilt_rad": tilt_deg}  # fmt: skip
    stated = {
        "thickness_m": None if thickness_um is None else to_si(thickness_um, "um"),
        "youngs_modulus_pa": None if youngs_modulus_mpa is None else to_si(youngs_modulus_mpa, "mpa"),
        "iop_pa": None if iop_mmhg is None else to_si(iop_mmhg, "mmhg"),
        "gap_m": None if gap_mm is None else to_si(gap_mm, "mm"),
        **{field: None if value is None else radians(value) for field, value in angles.items()},
    }
    told = _stated_of(stated)
    ramp_n_per_s = None if ramp_mn_per_s is None else to_si(ramp_mn_per_s, "mn_per_s")
    moves = _stated_of({"ramp_n_per_s": ramp_n_per_s, "hold_s": hold_s})
    acquisition = Acquisition(forces_mn, study, study.phantom.seed if seed is None else seed, rate_hz=rate_hz, **moves)
    if count is None:
        if not (scheduler is None and workers is None):
            raise click.UsageError("--scheduler and --workers are for --count: one eye is one process's work")
        made = _acquire_one(out, name or "eye-1", told, acquisition)
    else:
        made = _acquire_many(out, name or "eye", count, told, acquisition, chosen_workers(scheduler, workers))
    result = {
        **made,
        "seed": acquisition.seed,
        "mechanics": study.mechanics.kind,
        "globe": study.globe.kind,
        "stiffening": study.tissue.stiffening,
    }
    if as_json:
        print_json(result)
    else:
        recordings = "" if count is None else f"{count} recordings, "
        say(f"wrote {out}: {recordings}{made['frames']} frames, seed {acquisition.seed}")


def _stated_of(values: Mapping[str, float | None]) -> dict[str, float]:
    """Return the values that are stated; the others have their defaults elsewhere."""
    return {name: value for name, value in values.items() if value is not None}


def _acquire_one(out: Path, name: str, told: Mapping[str, float], acquisition: "Acquisition") -> dict[str, Any]:
    """Write the recording of one eye; return what it is."""
    from scleraforce.laboratory.phantom import write_phantom
    from scleraforce.laboratory.virtual_eye import PhantomEye, study_sections

    if out.exists():
        raise InputError(f"{out}: exists already; remove it or choose another folder")
    study = acquisition.study
    usual = {
        "thickness_m": to_si(600.0, "um"),
        "youngs_modulus_pa": study.eye.youngs_modulus_pa,
        "iop_pa": study.eye.iop_pa,
        "gap_m": study.needle.gap_m,
        "polar_rad": radians(35.0),
    }
    eye = PhantomEye(id=name, **(usual | dict(told)))
    plan = acquisition.plan(eye)
    with share_bar("load path") as reach:
        sections_at = study_sections(eye, study, reach)
        sections_at([max(plan.forces_n)])  # a load path is computed here, once: frames then come fast
    with progress_bar(plan.frames, "frames") as bar:
        write_phantom(out, plan, sections_at, study, bar.update)
    return {"recording": str(out), "frames": len(plan.frames)}


def _acquire_many(
    out: Path, name: str, count: int, told: Mapping[str, float], acquisition: "Acquisition", workers: int | None
) -> dict[str, Any]:
    """Write the recordings of many eyes; return what they are."""
    from scleraforce.laboratory.acquisition import acquire_all, sample_eyes

    eyes = sample_eyes(acquisition.study, count, acquisition.seed, name, told)
    with resumable_bar(out, "recordings", "eyes", count) as advance:
        acquire_all(out, eyes, acquisition, workers=workers, progress=advance)
    frames = sum(len(acquisition.plan(eye).frames) for eye in eyes)
    return {"recordings": [str(out / eye.id) for eye in eyes], "frames": frames}
