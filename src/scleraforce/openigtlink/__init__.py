"""OpenIGTLink, the protocol of image-guided therapy: records to bytes and bytes to events, with no socket in it."""

from scleraforce.openigtlink.decoder import (
    BadChecksum,
    Broken,
    Decoder,
    Event,
    Malformed,
    Received,
    State,
    Unknown,
)
from scleraforce.openigtlink.image import Image
from scleraforce.openigtlink.messages import Message, Query, Sensor, Status, Text, Transform, encode

__all__ = [
    "BadChecksum",
    "Broken",
    "Decoder",
    "Event",
    "Image",
    "Malformed",
    "Message",
    "Query",
    "Received",
    "Sensor",
    "State",
    "Status",
    "Text",
    "Transform",
    "Unknown",
    "encode",
]
