"""Device names and the time in the header of an OpenIGTLink message; of the standard library only, on any system."""

from struct import Struct

STATUS_DEVICE, READING_DEVICE, RESET_DEVICE = "ForceMonitor", "ForceReading", "ForceReset"
TIME = slice(34, 42)  # of a header, in any version
FIXED = Struct(">Q")  # seconds since 1970, in 2^-32 s


def stamp_time(message: bytearray, time_s: float) -> None:
    """Write a time into a message, s since 1970."""
    message[TIME] = FIXED.pack(int(time_s * 2**32))


def stamped_s(message: bytearray) -> float:
    """Return the time in a message, s since 1970.

    >>> message = bytearray(58)
    >>> stamp_time(message, 1.5)
    >>> stamped_s(message)
    1.5
    """
    return float(FIXED.unpack(message[TIME])[0] / 2**32)
