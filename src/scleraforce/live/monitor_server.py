"""The monitor's server: one thread, one selector; scanners, robots and other clients
speak OpenIGTLink with it.
"""

import json
import selectors
import socket
from collections.abc import Callable
from datetime import datetime
from itertools import count
from select import select

import scleraforce.live.network.openigtlink as igtl
from scleraforce.base.errors import ProtocolError
from scleraforce.base.units import from_si, to_si
from scleraforce.live import connected_clients
from scleraforce.live.companions import process_messages
from scleraforce.live.companions.companion_processes import (
    BLACK_BOX,
    CONSOLE,
    OPINION,
    Companions,
    Guard,
)
from scleraforce.live.companions.process_messages import NEEDLE_DEVICE
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.connected_clients import (
    Clients,
    Connection,
    Outgoing,
    RateLimiter,
    ServerSettings,
)
from scleraforce.live.decision.events import (
    Cause,
    Fault,
    MonitorEvent,
    Reset,
    SecondOpinion,
    Tick,
)
from scleraforce.live.monitor_session import MonitorSession, ReceivedFrame
from scleraforce.live.network.operator_reset import (
    CODE,
    LOCKED,
    RESET_DEVICE,
    ResetCode,
    ResetToken,
    token_digest,
)
from scleraforce.live.network.scanner_frame import FrameAssembler
from scleraforce.records.remark import Remark

TICK_S = 0.01
HEARTBEAT_S = 0.05
RATES_S = 0.5
OTHERS_S = 0.002  # for other clients, before the scanner has its turn again
SMALL_BODY_BYTES = 64 * 1024  # all that a client other than the scanner needs
# images up to this many times too large are received, so that the refusal can name
# their size
LARGER_FRAMES = 4
WRONG_TOKENS = 3
# notes of all clients in the log: a fiftieth of the decisions
NOTES_PER_S = 10.0
NOTES_AT_ONCE = 100
FORCES_PER_S = 2400.0
FORCES_AT_ONCE = 240


class MonitorServer:
    """Serves clients from `run` until `stop`.

    The scanner is the client that sent the last image. Another client becomes the
    scanner only when it has left or has sent no image for `silence_s`. An error of the
    scanner is a cause of a withdrawal; while there is no scanner, so is a faulty image
    of any client. Other clients' errors are noted; their message is ignored or their
    connection ends. `ring` shares the frames with other processes; it has the size of
    the frames that the session reads. `note` is called with a line for the operator.
    """

    def __init__(
        self,
        session: MonitorSession,
        listener: socket.socket,
        settings: ServerSettings,
        ring: FrameRing,
        guard: Guard,
        companions: Companions,
        note: Callable[[str], None],
    ) -> None:
        self.session = session
        self._ring = ring
        self._guard = guard
        self._companions = companions
        self._note = note
        self._clients = Clients(listener, settings, guard, self._note_client)

        for name in companions:
            self._clients.selector.register(
                companions.channel(name), selectors.EVENT_READ, name
            )

        self._most_bytes = (
            LARGER_FRAMES * 2 * ring.shape[0] * ring.shape[1] + SMALL_BODY_BYTES
        )
        self._scanner: Connection | None = None
        self._scanned_s = 0.0
        self._arrivals = count(1)
        self._counted: tuple[int, float] | None = None
        self._noted = session.decision.state
        self._notes = RateLimiter(NOTES_PER_S, NOTES_AT_ONCE)
        self._forces = RateLimiter(FORCES_PER_S, FORCES_AT_ONCE)
        self._left_out = 0
        # the second opinion's first remark of each code
        self._remarks = dict[str, Remark]()
        self._token = ResetToken(token_digest(settings.token))
        self.code = ResetCode()
        self._stopping = False

    def stop(self) -> None:
        """Make `run` return; may be called from a signal handler."""
        self._stopping = True

    def run(self) -> None:
        """Serve until `stop`."""
        now_s = tick_s = heartbeat_s = rates_s = self.session.clock()
        while not self._stopping:
            try:
                self._turn(max(0.0, min(tick_s, heartbeat_s) - now_s))
                now_s = self.session.clock()
                if now_s >= tick_s:
                    tick_s = now_s + TICK_S
                    self._tick(now_s)

                if now_s >= heartbeat_s:
                    heartbeat_s = max(heartbeat_s + HEARTBEAT_S, now_s)
                    self._clients.broadcast(self._present_decision(), now_s)

                if now_s >= rates_s:
                    rates_s = now_s + RATES_S
                    self._send_rates(now_s)
            except Exception as fault:  # any exception is a cause of a withdrawal
                now_s = self.session.clock()
                self._decide(
                    "exception",
                    Fault(now_s, Cause.EXCEPTION, f"{type(fault).__name__}: {fault}"),
                )

            self._give_sign_of_life(now_s)

    def _give_sign_of_life(self, now_s: float) -> None:
        """Show the watchdog that the loop proceeds, after each piece of a turn's work.

        After a delay a turn has up to 16 frames to take. They cost 30 ms of processor
        time, and on a busy machine that is longer than the watchdog waits.
        """
        if silent := self._guard.beat(now_s):
            self._decide("watchdog", Fault(now_s, Cause.EXCEPTION, silent))

    def close(self) -> None:
        """Send the clients that the monitor ends, and disconnect them."""
        self._decide(
            "end", Fault(self.session.clock(), Cause.EXCEPTION, "the monitor ends")
        )
        self._clients.close()

    def _turn(self, within_s: float) -> None:
        """Read from clients with data: the scanner first, then, for a short while, the
        longest waiting.
        """
        ready = self._clients.wait(
            0.0 if self.session.behind else within_s, self.session.clock
        )
        clients = [who for who in ready if isinstance(who, Connection)]
        clients.sort(key=lambda who: (who is not self._scanner, who.heard_s))

        for name in ready:
            if isinstance(name, str):
                self._hear_companion(name)

        end_s = self.session.clock() + OTHERS_S
        for client in clients:
            if client in self._clients:
                self._hear(client)
            if self.session.clock() > end_s:
                # pause for a moment, or until the scanner sends
                select(
                    [who for who in self._clients if who is self._scanner],
                    [],
                    [],
                    connected_clients.REST_S,
                )
                break

        self._lose(self.session.clock())
        if self.session.behind and self._scanner not in ready:
            self._decide("overtaken", self.session.catch_up())
        if None in ready:
            for client in self._clients.accept(self._scanner):
                self._clients.send(
                    client, self._present_decision(), self.session.clock()
                )

    def _lose(self, now_s: float) -> None:
        """Count the frames that have waited for too long: they will not be read."""
        for event in self.session.losses(now_s):
            self._decide("loss", event)

    # Messages from clients.

    def _hear(self, client: Connection) -> None:
        now_s = self.session.clock()
        vacant = self._scanner is None or self._scanner not in self._clients
        may_scan = (
            vacant
            or client is self._scanner
            or now_s - self._scanned_s > self.session.limits.silence_s
        )
        events, alive = client.receive(
            self._most_bytes if may_scan else SMALL_BODY_BYTES, now_s
        )
        at_s = self.session.clock()
        frames: list[ReceivedFrame] = []

        for event in events:
            self._give_sign_of_life(self.session.clock())
            if (frame := self._hear_event(client, event, at_s, may_scan)) is not None:
                frames.append(frame)
            if client.wrong_tokens >= WRONG_TOKENS:
                # it was disconnected; later messages do not count
                break

        newest = {frame.plane: frame for frame in frames}
        overtaken = [
            frame
            for frame in frames
            if not frame.misfit and frame is not newest[frame.plane]
        ]

        for frame in overtaken:
            self.session.defer(frame, newest[frame.plane])

        self._lose(at_s)
        for frame in frames:
            if frame not in overtaken:
                self._take_frame(frame)
                self._give_sign_of_life(self.session.clock())

        if not alive:
            broken = next(
                (event.reason for event in events if isinstance(event, igtl.Broken)),
                None,
            )
            self._clients.leave(
                client, f"was disconnected: {broken}" if broken else "left"
            )

    def _hear_event(
        self, client: Connection, event: igtl.PeerEvent, at_s: float, may_scan: bool
    ) -> ReceivedFrame | None:
        """Handle a client's message; return the frame that it completes, if any."""
        if not isinstance(event, igtl.Broken):
            self._clients.speaks(client, event.header.version)
        match event:
            case igtl.Received(message=igtl.Image() as image) if may_scan:
                return self._assemble(client, event, image, at_s)
            case igtl.Received(message=igtl.Query(type="STATUS")):
                self._clients.send(client, self._present_decision(), at_s)
            case igtl.Received(message=igtl.Text(text)) if (
                event.header.device == RESET_DEVICE
            ):
                self._reset_by_client(client, text, at_s)
            case igtl.Received(message=igtl.Transform() as pose) if (
                event.header.device == NEEDLE_DEVICE
            ):
                self.session.travelled(to_si(pose.travel_mm, "mm"), at_s)
            case igtl.Received(message=igtl.Sensor(values)) if client.forces.take(
                at_s
            ) and self._forces.take(at_s):
                time_s = self.session.wall_clock()
                device = event.header.device
                force = process_messages.ForceHeard(
                    at_s=at_s, time_s=time_s, values=values, device=device
                )
                self._companions.send(BLACK_BOX, force, at_s)
            case igtl.Received(message=igtl.Sensor()):
                # beyond a robot's rate: it must not delay a decision
                self._left_out += 1
            case igtl.BadChecksum() | igtl.Malformed() | igtl.Broken():
                self._take_faulty(client, event, at_s, may_scan)

        return None

    def _assemble(
        self, client: Connection, event: igtl.Received, image: igtl.Image, at_s: float
    ) -> ReceivedFrame | None:
        """Return the frame that an image completes; its sender is the scanner from now
        on.
        """
        self._scanner = client
        self._scanned_s = at_s
        plane = event.header.device if self.session.planes else None
        sent_s = event.header.time_s or None
        planes = self.session.planes

        try:
            if planes and plane not in planes:
                raise ProtocolError(
                    f"IMAGE of device {plane!r}: must be a plane's name:"
                    f" {', '.join(planes)}"
                )

            assembler = client.frames.setdefault(plane, FrameAssembler())
            whole = assembler.add(image, at_s, sent_s)
        except ProtocolError as fault:
            self._decide("bad image", Fault(at_s, Cause.BAD_IMAGE, str(fault)))
            return None

        if whole is None:
            return None

        sender_id = (
            event.message_id
            or int(from_si(event.header.time_s, "us"))
            or next(self._arrivals)
        )
        return self.session.frame(whole, sender_id, client.number, at_s, sent_s, plane)

    def _take_faulty(
        self,
        client: Connection,
        event: igtl.BadChecksum | igtl.Malformed | igtl.Broken,
        at_s: float,
        may_scan: bool,
    ) -> None:
        """Handle a faulty message: from the scanner it is a cause of a withdrawal."""
        of_image = not isinstance(event, igtl.Broken) and event.header.type == "IMAGE"
        if client is not self._scanner and not (may_scan and of_image):
            self._note_client(f"client {client.address}: {event.reason}", client)
            return

        client.frames.clear()  # no frame may mix parts from before and after the error
        is_checksum = isinstance(event, igtl.BadChecksum)
        name, cause = (
            ("checksum", Cause.CHECKSUM)
            if is_checksum
            else ("bad image", Cause.BAD_IMAGE)
        )
        self._decide(name, Fault(at_s, cause, event.reason))

    # Decisions, and messages to clients.

    def _take_frame(self, frame: ReceivedFrame) -> None:
        """Decide on a frame and send the decision: first the STATUS, for which the
        robot waits.
        """
        session = self.session
        session.take_frame(frame)
        status = self._outgoing(connected_clients.status_message(session.decision))
        self._clients.broadcast(status, frame.unread.at_s)
        now_s = session.clock()
        entry = session.entry("frame", now_s, frame, now_s - frame.unread.at_s)
        texts = self._outgoing(
            connected_clients.decision_message(session.decision),
            *connected_clients.reading_messages(entry),
        )
        self._clients.broadcast(texts, now_s)
        self._note_state()

        if frame.image.pixels.shape == self._ring.shape:
            self._ring.put(frame.number, frame.image.pixels)

        moment = session.moment(frame) if frame.plane else (frame,)
        decided = process_messages.Decided(
            entry=entry,
            travel_m=frame.unread.travel_m,
            pierced=session.pierced,
            moment=moment[0].number if frame.plane else None,
        )
        self._companions.decided(decided)

        if session.answer is not None and len(moment) >= len(session.planes):
            asked = process_messages.OpinionAsked(
                number=frame.number,
                order=frame.unread.frame_id,
                at_s=frame.unread.at_s,
                teaches=session.teaches
                and not frame.misfit
                and frame.unread.shown_back == 0,
                pierced=session.pierced,
                planes=tuple(
                    (one.plane, one.number, one.unread.frame_id)
                    for one in moment
                    if one.plane
                ),
            )
            self._companions.send(OPINION, asked, now_s)

        if session.answer is not None and session.answer.segmentation is not None:
            self._companions.outline(
                frame.number, session.answer.segmentation, now_s, frame.plane
            )

    def _outgoing(self, *addressed: connected_clients.Addressed) -> Outgoing:
        return Outgoing(addressed, self.session.wall_clock)

    def _present_decision(self) -> Outgoing:
        decision = self.session.decision
        return self._outgoing(
            connected_clients.status_message(decision),
            connected_clients.decision_message(decision),
        )

    def _decide(self, name: str, event: MonitorEvent) -> None:
        """Decide on an event other than a frame; send the decision to the clients if it
        changes.
        """
        if self.session.take(event):
            self._clients.broadcast(self._present_decision(), event.at_s)
            self._companions.decided(
                process_messages.Decided(entry=self.session.entry(name, event.at_s))
            )
            self._note_state()

    def _note_state(self) -> None:
        decision = self.session.decision
        if decision.state is not self._noted:
            self._noted = decision.state
            at = datetime.fromtimestamp(self.session.wall_clock()).astimezone()
            self._note(f"{at:%H:%M:%S.%f}"[:-3] + f"  {decision.message}")

    def _note_client(self, text: str, client: Connection | None = None) -> None:
        """Log a note, unless there are too many; `client` is the one whose error it
        notes.
        """
        now_s = self.session.clock()
        if (client is None or client.notes.take(now_s)) and self._notes.take(now_s):
            self._log_note(text, now_s)
        else:
            self._left_out += 1

    def _log_note(self, text: str, now_s: float) -> bool:
        return self._companions.send(
            BLACK_BOX,
            process_messages.Note(time_s=self.session.wall_clock(), text=text),
            now_s,
        )

    # Periodic work.

    def _tick(self, now_s: float) -> None:
        self._decide("tick", Tick(now_s))
        for fault in self._companions.faults(now_s):
            self._decide("companion", Fault(now_s, Cause.EXCEPTION, fault))

        for address in self._clients.sweep(now_s, self._scanner):
            if self._notes.take(now_s):
                self._note(
                    f"client {address} was disconnected: it read too slowly, so that"
                    " answers to it were old"
                )

    def _send_rates(self, now_s: float) -> None:
        dropped = (
            f"{self._left_out} notes and forces of clients were dropped: there were too"
            " many"
        )
        if self._left_out and self._log_note(dropped, now_s):
            self._left_out = 0

        frames, since_s = self._counted or (0, now_s - RATES_S)
        self._counted = self.session.frames, now_s
        roles = {True: "scanner", False: "listener"}
        clients = tuple(
            {"address": who.address, "role": roles[who is self._scanner]}
            for who in self._clients
        )
        rate = (self.session.frames - frames) / (now_s - since_s)
        rates = process_messages.Rates(
            frames_per_second=rate,
            lost=self.session.lost,
            clients=clients,
            remarks=tuple(self._remarks.values()),
        )
        self._companions.send(CONSOLE, rates, now_s)

        if not rate:
            # a console that has lost a message must not show an old state for long
            self._companions.send(
                CONSOLE,
                process_messages.Decided(entry=self.session.entry("again", now_s)),
                now_s,
            )

    def _hear_companion(self, name: str) -> None:
        now_s = self.session.clock()
        for message in self._companions.hear(name, now_s):
            self._take_message(message, now_s)
        if self._companions.dead(name):
            self._clients.selector.unregister(self._companions.channel(name))
            self._note(f"the {name} has ended{self._companions.last_words(name)}")

    def _take_remarks(self, remarks: tuple[Remark, ...], now_s: float) -> None:
        """Tell operator, log and console the first remark of each kind."""
        for remark in remarks:
            if remark.code not in self._remarks:
                self._remarks[remark.code] = remark
                self._log_note(f"second opinion: {remark.code}: {remark}", now_s)
                self._note(f"second opinion: {remark}")

    def _take_message(
        self, message: process_messages.CompanionMessage, now_s: float
    ) -> None:
        match message:
            case process_messages.OpinionGiven(
                order=order, verdict=verdict, plane=plane
            ):
                self._take_remarks(message.remarks, now_s)
                if plane:
                    self.session.read_together(verdict, message.contact_m)
                self._decide(
                    "opinion",
                    SecondOpinion(
                        at_s=now_s, frame_id=order, verdict=verdict, plane=plane
                    ),
                )
            case process_messages.EyeLearned(setup=setup, frames=frames, fault=fault):
                self.session.learned(setup.eye, frames)
                if fault:
                    self._note(fault)
            case process_messages.ResetAsked(request=request, token=token):
                granted, text = self._reset(self._knows(token, now_s), now_s)
                answer = process_messages.ResetAnswered(
                    request=request, granted=granted, message=text
                )
                self._companions.send(CONSOLE, answer, now_s)
            case process_messages.ListensAt(url=url):
                self._note(f"console    {url}")
            case process_messages.WrongTokens(count=count):
                self._note_client(f"console: {count} resets with a wrong token")
            case process_messages.WithdrawalKept(folder=folder):
                self._note(f"the last seconds were kept in {folder}")

    def _knows(self, secret: str, now_s: float) -> bool:
        return self._token.knows(secret) or self.code.knows(secret, now_s)

    def _reset(self, known: bool, now_s: float) -> tuple[bool, str]:
        """Return whether a reset is granted, and the message to answer with; each code
        is for one reset.
        """
        if not known:
            self._note_client("a reset with a wrong token")
            if self.code.locked(now_s):
                return False, LOCKED

            return (
                False,
                "the token or code is wrong; the monitor printed the right ones",
            )

        self._decide("reset", Reset(now_s))
        if granted := self.session.decision.code == 1:
            self.code.renew()
            self._note(self.code.line)

        return granted, self.session.decision.message

    def _reset_by_client(self, client: Connection, secret: str, now_s: float) -> None:
        known = self._knows(secret, now_s)
        # a right code must not look wrong: while codes are locked, each is told so
        is_told = CODE.fullmatch(secret) and self.code.locked(now_s)
        if not known and not is_told and not self._token.answers_wrong(now_s):
            client.wrong_tokens = WRONG_TOKENS
        else:
            client.wrong_tokens += not known
            granted, text = self._reset(known, now_s)
            answer = igtl.Text(json.dumps({"granted": granted, "message": text}))
            self._clients.send(
                client,
                self._outgoing((RESET_DEVICE, answer)),
                now_s,
            )

        if client.wrong_tokens >= WRONG_TOKENS:
            self._clients.leave(client, "was disconnected: wrong tokens")
