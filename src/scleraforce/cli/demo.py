"""`scleraforce demo`: a first look at a virtual session."""

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scleraforce.cli.output import print_json, say, share_bar
from scleraforce.units import from_si

if TYPE_CHECKING:
    from scleraforce.reproduction.demo import Demo


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("scleraforce-demo"), show_default=True,
              help="Folder to make; must not exist.")  # fmt: skip
@click.option("--open", "open_page", is_flag=True, help="Open the page in the browser.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def demo(out: Path, open_page: bool, as_json: bool) -> None:
    """A small virtual session, read by the reader that ships, as a page.

    A virtual eye is pushed twelve times (finite strain), imaged, calibrated on
    three of its frames; the reader `default` reads the others. All of it lies
    in the folder: the recording, the calibration, the page. It takes some ten
    seconds.
    """
    start = time.perf_counter()
    # Imported here: mechanics takes longer to import than the help to print.
    from scleraforce.reproduction.demo import run_demo

    with share_bar("demo") as reach:
        done = run_demo(out, datetime.now(UTC), reach)
    result = _result(done, time.perf_counter() - start)
    if as_json:
        print_json(result)
    else:
        say("\n".join(_lines(result)))
    if open_page:
        click.launch(str(done.page))


def _result(done: "Demo", seconds: float) -> dict[str, Any]:
    from scleraforce.reproduction.demo import EYE

    evaluation = done.evaluation
    return {
        "page": str(done.page),
        "recording": str(done.recording),
        "calibration": str(done.calibration),
        "youngs_modulus_mpa": {"true": from_si(EYE.youngs_modulus_pa, "mpa"), "found": from_si(done.modulus_pa, "mpa")},
        "frames": len(evaluation.frames),
        "read": evaluation.accuracy.total,
        "right": evaluation.accuracy.hits,
        "mae_mn": from_si(evaluation.mae_n, "mn"),
        "intervals_hold": evaluation.coverage.hits,
        "seconds": seconds,
    }


def _lines(result: dict[str, Any]) -> list[str]:
    modulus = result["youngs_modulus_mpa"]
    return [
        "research use only: not a medical device",
        f"wrote {result['recording']}: a virtual eye of {modulus['true']:.2f} MPa, pushed {result['frames']} times",
        f"calibrated on {result['frames'] - result['read']} frames: {modulus['found']:.2f} MPa",
        f"read the other {result['read']}: {result['right']} in the right class, {result['mae_mn']:.2f} mN off in the "
        "mean,",
        f"  {result['intervals_hold']} of their 90 % intervals hold the force",
        f"{result['seconds']:.0f} s; the page: {result['page']}",
    ]
