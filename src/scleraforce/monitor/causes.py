"""Causes of a withdrawal, with their sub-codes in an OpenIGTLink STATUS."""

from enum import Enum


class Cause(Enum):
    """Why the robot must withdraw; the value is the sub-code.

    7 and 9 are OpenIGTLink's own codes of a timeout and of a checksum error; those from 101 on are this monitor's.
    """

    SILENCE = 7
    CHECKSUM = 9
    DANGEROUS_CLASS = 101
    BOUND = 102
    RISING = 103
    UNUSABLE = 104
    FROZEN = 105
    OUT_OF_ORDER = 106
    SIZE = 107
    SCALE = 108
    NO_NUMBER = 109
    QUEUE_BEHIND = 110
    BAD_IMAGE = 111
    EXCEPTION = 112
    NO_OPINION = 113
    STALE = 114
    PIXEL_TYPE = 115
    WATCHDOG = 120  # sent by the watchdog alone, never by the decision
