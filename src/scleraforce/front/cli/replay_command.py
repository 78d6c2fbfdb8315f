"""`scleraforce replay`: play a recording to a monitor, and report its answers."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import Any

import click
import numpy as np

from scleraforce.base.errors import InputError, LinkError
from scleraforce.base.plain_text import printable
from scleraforce.base.units import from_si
from scleraforce.front.cli.options import PATH, options
from scleraforce.front.cli.output import Command, is_json, is_quiet, print_json, say
from scleraforce.live.replay.scanner_faults import (
    FAULTS,
    FaultReport,
    draw_fault_time,
    inject,
    prepare,
)
from scleraforce.live.replay.scanner_player import (
    AHEAD,
    AnswerLog,
    Player,
    ScannerClient,
    StatusChange,
)
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import (
    Recording,
    read_recording,
    true_forces,
)
from scleraforce.records.study import ClassesStudy

LIVE_S = 0.1  # between two renewals of the live line


def _fault(context: click.Context, _: click.Parameter, value: str | None) -> str | None:
    if value == "list":
        for name, fault in FAULTS.items():
            click.echo(f"{name:17}{fault.line}")
        context.exit()

    if value is not None and value not in FAULTS:
        raise click.BadParameter(f"{value!r}; choose one of: {', '.join(FAULTS)}")

    return value


@click.command(cls=Command)
@click.argument("recording_path", metavar="RECORDING", type=PATH)
@options("host", "port")
@click.option(
    "--speed",
    type=click.FloatRange(0.01, 10_000),
    help="Speed; default: 1 (the recording's own).",
)
@click.option(
    "--step",
    is_flag=True,
    help="Send one frame each time Enter is pressed, and print its answer.",
)
@click.option(
    "--preload",
    is_flag=True,
    help=(
        "Read all frames into memory before the first is sent, so that reading "
        "takes no time from a monitor on the same machine."
    ),
)
@click.option(
    "--version",
    type=click.IntRange(1, 3),
    default=2,
    show_default=True,
    help="Version of the OpenIGTLink headers; 1 has no frame number.",
)
@click.option(
    "--fault",
    metavar="NAME",
    callback=_fault,
    is_eager=True,
    help="Inject a fault of the scanner after contact; `list` prints their names.",
)
@click.option(
    "--fault-at-s",
    type=float,
    help="Time of the fault on the recording's clock; default: drawn at random.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Seed of the fault's random choices.",
)
def replay(
    recording_path: Path,
    host: str,
    port: int,
    speed: float | None,
    step: bool,
    preload: bool,
    version: int,
    fault: str | None,
    fault_at_s: float | None,
    seed: int,
) -> None:
    """Play a recording to a monitor as a scanner would.

    It sends the frames at their times over OpenIGTLink, and forces.csv as
    SENSOR RobotForce. It prints each change of the monitor's status, and a
    summary at the end. With --fault, exit code 1 means that the monitor did not
    make the robot withdraw.

    Example: scleraforce replay moving-eye --fault frozen
    """
    if step and (fault or speed):
        raise click.UsageError("--step goes with neither --speed nor --fault")
    if fault_at_s is not None and not fault:
        raise click.UsageError("--fault-at-s: give the --fault, too")

    speed = speed or 1.0
    recording = read_recording(recording_path)
    log = AnswerLog()
    rng = np.random.default_rng(seed)
    true = true_forces(recording.path)
    known = all(entry.file in true for entry in recording.frames)
    true_n = [true[entry.file] for entry in recording.frames] if known else None

    if fault is not None:
        forces_n = true_n or _logged_frame_forces(recording)
        if fault_at_s is None and forces_n is None:
            raise InputError(
                f"{recording.path}: --fault: no forces show when contact is; give"
                " --fault-at-s"
            )

        at_s = (
            draw_fault_time(recording, forces_n or (), rng, fault, speed)
            if fault_at_s is None
            else fault_at_s
        )
        prepared = prepare(
            fault, recording, at_s, rng, version=version, speed=speed, forces_n=forces_n
        )

    client = ScannerClient(host, port, log.hear, observed=fault is not None)
    show = _Show(recording, log, true_n, quiet=is_json() or is_quiet())
    ahead = len(recording.frames) if preload else AHEAD
    player = Player(
        recording,
        client,
        log,
        speed=speed,
        version=version,
        ahead=ahead,
        watch=show.renew,
    )
    report: FaultReport | None = None

    try:
        if step:
            player.step(show.wait_for_enter)
        elif fault is None:
            player.play()
        else:
            player.play(prepared.time_s)
            report = inject(player, prepared)
    finally:
        client.close()
        show.end(player, report)

    if report is not None and report.delay_s is None:
        raise LinkError(f"{client.address}: no withdrawal after the fault {fault}")


def _logged_frame_forces(recording: Recording) -> list[float] | None:
    """Return the force at each frame from the force log, N, interpolated between
    labels; None without a log.
    """
    trials = label_frames(recording, ClassesStudy())
    labels = [
        (trial.time_s, trial.measured_force_n)
        for trial in trials
        if trial.measured_force_n is not None
    ]
    if not labels:
        return None

    known_s, known_n = zip(*labels, strict=True)
    forces_n: list[float] = np.interp(
        [trial.time_s for trial in trials], known_s, known_n
    ).tolist()

    return forces_n


class _Show:
    def __init__(
        self,
        recording: Recording,
        log: AnswerLog,
        forces_n: Sequence[float] | None,
        quiet: bool,
    ) -> None:
        self._recording = recording
        self._log = log
        self._forces_n = forces_n
        self._quiet = quiet
        self._live = not quiet and sys.stderr.isatty()
        self._shown = 0
        self._renewed_s = monotonic()

    def renew(self) -> None:
        if self._quiet:
            return

        for change in self._log.changes[self._shown :]:
            self._shown += 1
            self._clear()
            frame = (
                "before the first frame"
                if change.frame is None
                else f"frame {change.frame}"
            )
            cause = (
                f".{change.sub_code} {change.cause or ''}".rstrip()
                if change.sub_code
                else ""
            )
            say(
                f"{self._time_s(change.at_s):9.3f} s  {frame}  code"
                f" {change.code}{cause}  {change.message}"
            )

        if self._live and monotonic() - self._renewed_s > LIVE_S:
            self._renewed_s = monotonic()
            click.echo(f"\r\x1b[K{printable(self._answer_line())}", err=True, nl=False)

    def wait_for_enter(self, entry: FrameEntry) -> bool:
        """Print the last answer and wait for Enter; return False at the end of the
        input.
        """
        if self._log.frames_sent and not self._quiet:
            say(self._answer_line())
        click.echo(printable(f"Enter sends {entry.file} "), err=True, nl=False)
        return bool(sys.stdin.readline())

    def end(self, player: Player, report: FaultReport | None) -> None:
        result = self._summary(player, report)
        if is_json():
            print_json(result)
            return

        self.renew()
        self._clear()
        for line in _summary_lines(result):
            say(line)

    def _time_s(self, at_s: float) -> float:
        return 0.0 if self._log.begun_s is None else at_s - self._log.begun_s

    def _clear(self) -> None:
        if self._live:
            click.echo("\r\x1b[K", err=True, nl=False)

    def _answer_line(self) -> str:
        reading = self._log.reading
        status = self._log.status
        if status is None:
            return "the monitor has not sent anything yet"

        words = [
            f"frame {self._log.answered}",
            str(reading.get("state") or f"code {status.code}"),
        ]
        words += (
            [f"class {reading['class']}"] if reading.get("class") is not None else []
        )
        words += (
            [f"{reading['force_mn']:.1f} mN"]
            if isinstance(reading.get("force_mn"), float)
            else []
        )
        words += (
            [f"{from_si(self._log.answers[-1].took_s, 'ms'):.2f} ms"]
            if self._log.answers
            else []
        )

        return ", ".join([*words, status.message])

    def _summary(self, player: Player, report: FaultReport | None) -> dict[str, Any]:
        log = self._log
        took_ms = from_si(np.array([answer.took_s for answer in log.answers]), "ms")
        latency_ms = (
            np.percentile(took_ms, (50, 99, 100)).tolist() if len(took_ms) else None
        )
        withdrawal = log.first_doubt(0.0, (3,))

        return {
            "recording": str(self._recording.path),
            "monitor": player.client.address,
            "duration_s": self._time_s(player.client.clock()),
            "frames_sent": log.frames_sent,
            "frames_answered": len(took_ms),
            "frames_overtaken": log.reading.get("overtaken"),
            "frames_lost": log.reading.get("lost"),
            "forces_sent": player.forces_sent,
            "latest_ms": from_si(player.latest_s, "ms"),
            "latency_ms": (
                latency_ms
                and dict(zip(("median", "p99", "max"), latency_ms, strict=True))
            ),
            "longest_silence_ms": from_si(log.longest_silence_s, "ms"),
            "changes": [self._change_record(change) for change in log.changes],
            "withdrawal": (
                None if withdrawal is None else self._change_record(withdrawal)
            ),
            "fault": None if report is None else self._fault_record(report),
        }

    def _change_record(self, change: StatusChange) -> dict[str, Any]:
        known = change.frame is not None and 0 < change.frame <= len(
            self._recording.frames
        )
        index = (change.frame or 1) - 1
        record = asdict(change) | {
            "at_s": self._time_s(change.at_s),
            "cause": change.cause,
            "file": self._recording.frames[index].file if known else None,
            "true_force_mn": (
                from_si(self._forces_n[index], "mn")
                if known and self._forces_n is not None
                else None
            ),
        }
        record |= {
            "answers_frame": record.pop("answers"),
            "after_ms": from_si(record.pop("after_s"), "ms"),
        }

        return record

    def _fault_record(self, report: FaultReport) -> dict[str, Any]:
        delay = {
            "withdraws": report.delay_s is not None,
            "delay_ms": from_si(report.delay_s, "ms"),
        }
        words = {"code": report.code, "cause": report.cause, "message": report.message}
        words |= {"cause_is_of_the_fault": report.expected}

        return {
            "name": report.name,
            "at_s": self._time_s(report.began_s),
            **delay,
            **words,
        }


def _when(change: Mapping[str, Any]) -> str:
    """Return when a change came: with a frame's answer, after a frame, or before any.

    >>> _when({"frame": None, "file": None, "answers_frame": False, "at_s": 0.0})
    'before the first frame was sent: the monitor was in withdrawal already'
    """
    if change["frame"] is None:
        return "before the first frame was sent: the monitor was in withdrawal already"
    file = f" ({change['file']})" if change["file"] else ""
    return (
        f"{'at' if change['answers_frame'] else 'after'} frame {change['frame']}{file}"
    )


def _summary_lines(result: Mapping[str, Any]) -> Iterator[str]:
    overtaken = (
        f", {result['frames_overtaken']} overtaken"
        if result["frames_overtaken"]
        else ""
    )
    lost = f" ({result['frames_lost']} of them lost)" if result["frames_lost"] else ""
    yield (
        f"{result['frames_sent']} frames sent, {result['frames_answered']}"
        f" answered{overtaken}{lost}; {result['forces_sent']} forces sent; at most"
        f" {result['latest_ms']:.1f} ms late"
    )

    if (latency_ms := result["latency_ms"]) is not None:
        yield (
            "latency {median:.2f} ms in the median, {p99:.2f} ms at 99 %, {max:.2f} ms"
            " at most".format(**latency_ms)
        )

    if (found := result["withdrawal"]) is None:
        yield "no withdrawal"
    else:
        read = "" if found["force_mn"] is None else f"; read {found['force_mn']:.1f} mN"
        read += (
            ""
            if found["interval_mn"] is None
            else " ({:.1f} to {:.1f} mN)".format(*found["interval_mn"])
        )
        force = (
            ""
            if found["true_force_mn"] is None
            else f"; true force {found['true_force_mn']:.1f} mN"
        )
        after = (
            ""
            if found["after_ms"] is None
            else f", {found['after_ms']:.2f} ms after it was sent"
        )
        yield (
            f"withdrawal {_when(found)}{after}: {found['cause'] or 'no cause'}:"
            f" {found['message']}{read}{force}"
        )

    if (fault := result["fault"]) is not None:
        said = (
            f"the robot withdraws {fault['delay_ms']:.1f} ms later"
            if fault["withdraws"]
            else "the robot continues"
        )
        yield (
            f"fault {fault['name']} at {fault['at_s']:.3f} s: {said}:"
            f" {fault['cause'] or fault['message']}"
        )
