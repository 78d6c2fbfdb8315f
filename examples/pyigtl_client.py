#!/usr/bin/env python3
"""A robot's side of the monitor with pyigtl (docs/howto/robot.md). Research use only.

Run as `pyigtl_client.py HOST PORT`, it prints what a robot would do.
"""

import json
import sys
import time
from collections.abc import Callable

import pyigtl

SILENCE_S = 0.150
OLD_S = 0.100  # an OK delayed by more than this, compared with the quickest, is old
DRIFT = 1e-4  # of this clock and the monitor's, which need not agree
LOOK_S = 0.002


def watch(host: str, port: int, tell: Callable[[bool, str], None]) -> None:
    """Call `tell` (may the needle move on, and why) until the monitor is silent."""
    client = pyigtl.OpenIGTLinkClient(host, port)
    heard_s = time.monotonic()
    until_s = heard_s + SILENCE_S
    least_s = float("inf")

    try:
        while time.monotonic() < until_s:
            latest = {said.device_name: said for said in client.get_latest_messages()}
            if "ForceDecision" not in latest:
                time.sleep(LOOK_S)
                continue

            said = latest["ForceDecision"]
            decision = json.loads(said.string)
            before_s = heard_s
            heard_s = time.monotonic()
            delay_s = heard_s - said.timestamp
            least_s = min(least_s + DRIFT * (heard_s - before_s), delay_s)

            if decision["code"] != 1 or delay_s <= least_s + OLD_S:
                until_s = heard_s + SILENCE_S
                tell(decision["code"] == 1, decision["message"])
        tell(False, "no decision for 150 ms")
    except Exception as fault:  # any doubt is a withdrawal
        tell(False, f"{type(fault).__name__}: {fault}")
    finally:
        client.stop()


def show(go_on: bool, why: str) -> None:
    """Print what a robot would do."""
    sys.stdout.write(f"{'continue' if go_on else 'WITHDRAW'}: {why}\n")


if __name__ == "__main__":
    watch(sys.argv[1], int(sys.argv[2]), show)
