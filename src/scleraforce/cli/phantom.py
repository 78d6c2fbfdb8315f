"""`scleraforce phantom`: make a virtual acquisition."""

from pathlib import Path
from typing import Any

import click

from scleraforce.cli.options import PATH, chosen_workers, eye_options, in_radians, options
from scleraforce.cli.output import Command, Report, count_bar, refuse_existing, resumable_bar
from scleraforce.errors import StudyError
from scleraforce.study import Study
from scleraforce.study.fields import check_quantity
from scleraforce.units import to_si

STUDYS = "the study's by default"
THICKNESS_M, POLAR_RAD = to_si(600.0, "um"), to_si(35.0, "deg")


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
            forces_mn = [float(entry) for entry in value.split(",")]
            for force_mn in forces_mn:
                check_quantity("force_mn", force_mn)
        except ValueError:
            self.fail(f"{value!r} is not a list of forces in mN; give for example 2,10,40", param, ctx)
        except StudyError as fault:
            self.fail(str(fault).partition(": ")[2], param, ctx)
        return tuple(to_si(force_mn, "mn") for force_mn in forces_mn)


@click.command(cls=Command)
@click.option("--out", type=PATH, required=True, help="Recording folder to write; must not exist. With --count the "
              "folder of all recordings.")  # fmt: skip
@options("study")
@click.option("--eye", "name", help="Name of the eye; eye-1 by default. With --count the part before the number.")
@click.option("--count", type=click.IntRange(1, 1_000_000), help="Number of eyes: contact, B-scan plane and thickness "
              "of each are drawn from the study, unless an option gives them.")  # fmt: skip
@options("scheduler", "workers", scheduler="Dask scheduler whose workers make the recordings of --count.")
@click.option("--forces-mn", "forces_n", type=_Forces(), default="2,8,14,20,26,34,40,48,56", show_default=True,
              help="True force at each frame, in mN: one step-and-hold push each.")  # fmt: skip
@click.option("--rate-hz", type=click.FloatRange(0.1, 1000), help="Frames a second of a needle that moves: --forces-mn "
              "are then the turning points of its force, which begins at 0.")  # fmt: skip
@click.option("--ramp-mn-per-s", type=click.FloatRange(0.01, 1e5), help="How fast the force changes between them; "
              "20 by default.")  # fmt: skip
@click.option("--hold-s", type=click.FloatRange(0, 3600), help="How long it stays at each; 1 by default.")
@eye_options("thickness_m", "youngs_modulus_pa", "iop_pa", "gap_m", "polar_angle_rad", default=STUDYS,
             thickness_m="600 by default", polar_angle_rad="35 by default")  # fmt: skip
@click.option(
    "--azimuth-deg", "azimuth_rad", type=float, callback=in_radians, help="Contact, about the pole; 0 by default."
)
@click.option("--direction-deg", "direction_rad", type=float, callback=in_radians,
              help="B-scan plane about the needle axis; 0 by default.")  # fmt: skip
@click.option(
    "--tilt-deg",
    "tilt_rad",
    type=float,
    callback=in_radians,
    help="B-scan plane against the needle axis; 0 by default.",
)
@eye_options("globe", "rigidity_pa13_per_m3", default=STUDYS,
             globe=f"finite strain only; {STUDYS} (open, if it does not say)",
             rigidity_pa13_per_m3=f"{STUDYS} (0.03, if it does not say)")  # fmt: skip
@options("mechanics", mechanics="How the wall bends; the study's by default (linear, if it does not say).")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), help="Of all that is drawn; the study's by default.")
def phantom(
    out: Path,
    study: Study,
    name: str | None,
    count: int | None,
    scheduler: str | None,
    workers: int | None,
    forces_n: tuple[float, ...],
    rate_hz: float | None,
    ramp_mn_per_s: float | None,
    hold_s: float | None,
    globe: str | None,
    rigidity_pa13_per_m3: float | None,
    mechanics: str | None,
    seed: int | None,
    **given: Any,
) -> Report:
    """Make a virtual acquisition: raw B-scans, a force log, truth.json.

    [phantom] of the study has the ranges from which light, noise, shadows,
    timing and sensor are drawn; [form] shapes eyes that are not spheres
    (finite strain only).

    Example: scleraforce phantom --out eye-1 --thickness-um 800 --forces-mn 2,10,40

    A needle that a robot moves, at 100 frames a second:
    scleraforce phantom --out moving --rate-hz 100 --forces-mn 20,5,35 --ramp-mn-per-s 15

    Twenty eyes, in eyes/eye-1 to eyes/eye-20; the same command resumes an
    interrupted run: scleraforce phantom --out eyes --count 20
    """
    # Imported here: mechanics takes longer to import than the help to print.
    import scleraforce as sf
    from scleraforce.notebook.virtual import declared, stated_of

    if rate_hz is None and not (ramp_mn_per_s is None and hold_s is None):
        raise click.UsageError("--ramp-mn-per-s and --hold-s are of a needle that moves; give --rate-hz too")
    if count is None and not (scheduler is None and workers is None):
        raise click.UsageError("--scheduler and --workers are for --count: one eye is one process's work")
    study = declared(study, mechanics, globe, rigidity_pa13_per_m3)
    eye: dict[str, Any] = stated_of(given)
    seed = study.phantom.seed if seed is None else seed
    moves: dict[str, Any] = stated_of({"ramp_n_per_s": to_si(ramp_mn_per_s, "mn_per_s"), "hold_s": hold_s})
    if count is None:
        refuse_existing(out)
        eye = {"thickness_m": THICKNESS_M, "polar_angle_rad": POLAR_RAD} | eye
        made = sf.phantom(out, study, forces_n=forces_n, eye=name or "eye-1", seed=seed, rate_hz=rate_hz,
                          counting=count_bar, **eye, **moves)  # fmt: skip
        result: dict[str, Any] = {"recording": str(out), "frames": len(made.frames)}
    else:
        from scleraforce.laboratory.acquisition import Acquisition, acquire_all, sample_eyes
        from scleraforce.study.unused import refuse_unused

        refuse_unused(study, "phantom", study.mechanics.kind)
        acquisition = Acquisition(forces_n, study, seed, rate_hz=rate_hz, **moves)
        if "polar_angle_rad" in eye:
            eye["polar_rad"] = eye.pop("polar_angle_rad")
        eyes = sample_eyes(study, count, seed, name or "eye", eye)
        with resumable_bar(out, "recordings", "eyes", count) as advance:
            acquire_all(out, eyes, acquisition, workers=chosen_workers(scheduler, workers), progress=advance)
        frames = sum(len(acquisition.plan(one).frames) for one in eyes)
        result = {"recordings": [str(out / one.id) for one in eyes], "frames": frames}
    result |= {"seed": seed, "mechanics": study.mechanics.kind, "globe": study.globe.kind}
    recordings = "" if count is None else f"{count} recordings, "
    return Report(
        {**result, "stiffening": study.tissue.stiffening},
        [f"wrote {out}: {recordings}{result['frames']} frames, seed {seed}"],
    )
