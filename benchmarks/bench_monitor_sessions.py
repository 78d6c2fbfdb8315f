"""Play whole sessions of virtual eyes, without sockets: false withdrawals, and the
force at which ramps are stopped.

    python benchmarks/bench_monitor_sessions.py --model MODEL [MODEL...]
        [--kinds open sealed living] [--eyes 10] [--first 0] [--sessions 1]
        [--seconds 60] [--highest-mn 20] [--rates-mn-s 5 10 20 50 100] [--seed 0]
        [--workers 1]

A MODEL is of kind "reader". Each kind of eyes is read by the first model that was
trained for it. Eyes are bent in 3-D at finite strain, like the eyes of `make figures`.
Every frame is a raw B-scan (`render_bscan`) that goes through the live reader
(segmentation, slice, network) and `decide`; every third one goes to the library's fit
as well, whose answer comes 25 ms later as a second opinion. One second after a
withdrawal the operator asks for a reset, again and again until it is granted.

- Sessions: after an approach to the upper half of the forces they hold, swing, rise
  slowly, step as a robot does, lift off and come back; the eye shifts (drift,
  breathing, pulse), the signal swings, the scanner's clock jitters, one frame in 1000
  is lost.
- Ramps: from 0 at several rates, until the withdrawal. A sealed eye whose wall gives
  way before 33 mN has none.

The same frames go to monitors with different known inputs
(`monitor_sessions.declarations`): the globe, with E and k calibrated on three frames;
the same calibration without the globe; E alone. Declared values have the errors of
calipers and gauges: 10 um of the wall, 20 um of the gap, 3 % of the IOP.
"""

import argparse
import os
from functools import partial
from pathlib import Path

from monitor_sessions.declarations import DECLARATIONS
from monitor_sessions.eyes import KINDS, may_meet
from monitor_sessions.play import Outcome, Plan, prepare
from monitor_sessions.table import ramp_table, session_table
from provenance.stamps import new_stamp
from scleraforce.base.units import from_si, to_si
from scleraforce.base.worker_processes import work_units
from scleraforce.reading.load_model import load_force_reader

RATES_MN_S = (5.0, 10.0, 20.0, 50.0, 100.0)
# workers keep their images: a sixth quicker
QUICK_MEMORY = (
    "MALLOC_MMAP_THRESHOLD_",
    "MALLOC_TRIM_THRESHOLD_",
)


def main() -> None:
    """Run the sessions and print the tables."""
    given = arguments()
    for name in QUICK_MEMORY:
        os.environ.setdefault(name, "1000000000")

    found: dict[str, dict[str, Outcome]] = {}
    try:
        for plan in plans(given):
            run(plan, given.workers, found)
    except KeyboardInterrupt:
        print("interrupted; the tables are of the units that are done")

    print(f"\n{new_stamp('python benchmarks/bench_monitor_sessions.py')}")
    print(f"\n{ramp_table(found)}\n\n{session_table(found)}")

    for kind, of in found.items():
        for name, outcome in of.items():
            for reason, count in outcome.unread.most_common():
                print(
                    f"{kind}, {DECLARATIONS[name]}: {count} frames not read: {reason}"
                )


def arguments() -> argparse.Namespace:
    """Return what the user asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("--model", type=Path, nargs="+", required=True, help="readers")
    parser.add_argument(
        "--kinds", nargs="+", choices=KINDS, default=list(KINDS), help="of eyes"
    )
    parser.add_argument("--eyes", type=int, default=10, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first eye")
    parser.add_argument("--sessions", type=int, default=1, help="of each eye")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument(
        "--highest-mn", type=float, default=20.0, help="force of the sessions"
    )
    parser.add_argument(
        "--rates-mn-s", type=float, nargs="*", default=RATES_MN_S, help="of the ramps"
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)

    return parser.parse_args()


def plans(given: argparse.Namespace) -> list[Plan]:
    """Return what to run with each model; say which kinds of eyes none can meet."""
    left = list(given.kinds)
    made = []

    for model in given.model:
        trained = load_force_reader(model).study.reader
        kinds = tuple(kind for kind in left if may_meet(kind, trained))
        left = [kind for kind in left if kind not in kinds]
        made.append(
            Plan(
                model=model,
                kinds=kinds,
                eyes=given.eyes,
                sessions=given.sessions,
                seconds=given.seconds,
                highest_n=to_si(given.highest_mn, "mn"),
                rates_n_s=tuple(to_si(rate, "mn") for rate in given.rates_mn_s),
                seed=given.seed,
                first=given.first,
            )
        )

    for kind in left:
        print(f"left out, for no model was trained on such eyes: {kind}")

    return made


def run(plan: Plan, workers: int, found: dict[str, dict[str, Outcome]]) -> None:
    """Run all units of a plan; add the outcome of each, by kind and declaration, when
    it is done.
    """
    for number, (outcomes, took_s) in work_units(
        partial(prepare, plan), range(len(plan.units)), workers
    ):
        unit = plan.units[number]
        print(
            f"{unit.words}, {took_s:.0f} s:"
            f" {'; '.join(map(summary, outcomes, outcomes.values()))}",
            flush=True,
        )
        so_far = found.setdefault(unit.kind, {name: Outcome() for name in DECLARATIONS})

        for name, outcome in outcomes.items():
            for words in outcome.withdrawals:
                print(f"  {words}", flush=True)

            so_far[name].add(outcome)


def summary(name: str, outcome: Outcome) -> str:
    """Return what a monitor did in a unit: the forces at which it stopped ramps, or its
    false withdrawals.
    """
    forces = (
        "never" if ramp.force_n is None else f"{from_si(ramp.force_n, 'mn'):.1f}"
        for ramp in outcome.ramps
    )
    done = (
        f"{len(outcome.withdrawn_n)} withdrawals"
        if outcome.frames
        else f"ramps at {', '.join(forces) or '-'} mN"
    )

    return f"{name} {done}"


if __name__ == "__main__":
    main()
