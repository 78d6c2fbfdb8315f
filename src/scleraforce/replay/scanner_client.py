"""A scanner's end of the connection to a monitor: it sends frames and receives messages meanwhile."""

import socket
from collections.abc import Callable
from contextlib import suppress
from select import select
from time import monotonic

from scleraforce.errors import InputError, LinkError
from scleraforce.openigtlink import Broken, Decoder, Image, Message, Received, encode
from scleraforce.openigtlink.wire import HEADER_BYTES, unpack_header
from scleraforce.recording.folder import OctInfo
from scleraforce.recording.pixels import Pixels
from scleraforce.service.watchdog import stamp_time
from scleraforce.units import from_si

SCANNER_DEVICE = "Scanner"
CONNECT_S = 5.0
STALL_S = 5.0  # a monitor that takes no bytes for this long counts as hung
LAST_BYTES = 4096

Hear = Callable[[float, str, Message], object]


class Unstamped:
    """A message that is encoded except for the time in its header; `message_id` is 0 in version 1."""

    def __init__(self, message: Message, device: str, version: int, message_id: int = 0) -> None:
        message_id = message_id if version > 1 else 0
        self._bytes = bytearray(encode(message, device, version=version, message_id=message_id))
        self._message_id = message_id

    def stamped(self, time_s: float) -> bytearray:
        """Return the message with a time, s since 1970; valid until the next call."""
        stamp_time(self._bytes, time_s)
        return self._bytes

    @property
    def frame_id(self) -> int:
        """The monitor's id of the frame: the message id, or without one the time in microseconds."""
        return self._message_id or int(from_si(unpack_header(self._bytes[:HEADER_BYTES]).time_s, "us"))


def frame_message(
    pixels: Pixels, oct_info: OctInfo, number: int, version: int, *, matrix: tuple[float, ...] | None = None
) -> Unstamped:
    """Encode a frame as an IMAGE of one slice; `matrix` replaces the recording's."""
    return Unstamped(Image(pixels[None], matrix or image_matrix(oct_info)), SCANNER_DEVICE, version, number)


def image_matrix(oct_info: OctInfo) -> tuple[float, ...]:
    """Return the matrix of an IMAGE: the steps to the next column, row and slice in mm, then the centre, at 0."""
    lateral_mm = from_si(oct_info.width_m / oct_info.columns, "mm")
    depth_mm = from_si(oct_info.depth_m / oct_info.rows, "mm")
    return (lateral_mm, 0.0, 0.0, 0.0, depth_mm, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


class ScannerClient:
    """Open connections to a monitor: the scanner's, and on request a robot's beside it. Every wait has an end.

    `hear` is called with the time, the device and the message for each that the monitor sends; `observed` hears through
    the robot's connection, which stays when the scanner's breaks. Times are of the `clock`.

    Raises:
        InputError: no monitor listens there. Methods raise LinkError if the connection is lost.
    """

    def __init__(
        self, host: str, port: int, hear: Hear, *, observed: bool = False, clock: Callable[[], float] = monotonic
    ) -> None:
        self.address, self.clock, self._hear, self._decoder = f"{host}:{port}", clock, hear, Decoder()
        self._scanner: socket.socket | None = _connect(host, port)
        self._heard: socket.socket | None = _connect(host, port) if observed else self._scanner

    def send(self, data: bytes | bytearray) -> float:
        """Send bytes; return when the last of them were handed to the system (s, monotonic).

        The clock is read before the last 4 KiB: a monitor of higher priority may answer before `send` returns.
        """
        whole = memoryview(data)
        self._send(whole[:-LAST_BYTES])
        last_s = self.clock()
        self._send(whole[-LAST_BYTES:])
        return last_s

    def _send(self, rest: memoryview) -> None:
        moved_s = self.clock()
        while rest:
            if self._scanner is None:
                raise LinkError(f"{self.address}: the monitor has closed the connection")
            try:
                rest, moved_s = rest[self._scanner.send(rest) :], self.clock()
            except BlockingIOError:
                if self.clock() - moved_s > STALL_S:
                    raise LinkError(f"{self.address}: the monitor has read nothing for {STALL_S:g} s") from None
                self._turn(0.1, writing=True)
            except OSError as fault:
                self._lose(self._scanner, fault)

    def listen(self, until_s: float, done: Callable[[], bool] = lambda: False) -> None:
        """Hear the monitor until a time (s, monotonic), or until `done`."""
        self._turn(0.0)
        while not done() and (left_s := until_s - self.clock()) > 0.0:
            self._turn(left_s)

    def disconnect(self) -> None:
        """Close the scanner's connection, and leave the robot's."""
        if self._scanner is not None and self._scanner is not self._heard:
            self._scanner.close()
            self._scanner = None

    def close(self) -> None:
        """Close all connections."""
        for link in {self._scanner, self._heard} - {None}:
            link.close()  # type: ignore[union-attr]
        self._scanner = self._heard = None

    def _turn(self, within_s: float, writing: bool = False) -> None:
        """Wait until bytes have come, or, `writing`, until the scanner's connection takes bytes again."""
        links = {link for link in (self._scanner, self._heard) if link is not None}
        writers = [self._scanner] if writing and self._scanner is not None else []
        for link in select(list(links), writers, [], within_s)[0]:
            self._receive(link, heard=link is self._heard)

    def _receive(self, link: socket.socket, heard: bool) -> None:
        """Read a connection; discard what comes on the scanner's while the robot's, which gets the same, is heard."""
        try:
            count = link.recv_into(self._decoder.space() if heard else bytearray(1 << 16))
        except BlockingIOError:
            return
        except OSError as fault:
            self._lose(link, fault)
            return
        at_s = self.clock()
        if not count:
            self._lose(link, None)
        for event in self._decoder.received(count) if heard else ():
            if isinstance(event, Broken):
                raise LinkError(f"{self.address}: does not send OpenIGTLink: {event.reason}")
            if isinstance(event, Received):
                self._hear(at_s, event.header.device, event.message)

    def _lose(self, link: socket.socket, fault: OSError | None) -> None:
        """Continue without the scanner's connection if the robot's is the one that is heard."""
        if link is self._scanner:
            self._scanner = None
        if link is self._heard:
            raise LinkError(f"{self.address}: the connection is lost: {fault.strerror if fault else 'it was closed'}")
        link.close()


def _connect(host: str, port: int) -> socket.socket:
    try:
        link = socket.create_connection((host, port), timeout=CONNECT_S)
    except OSError as fault:
        reason = fault.strerror or str(fault)
        raise InputError(
            f"{host}:{port}: {reason}; start `scleraforce monitor` there, or give --host, --port"
        ) from fault
    link.setblocking(False)
    with suppress(OSError):
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return link
