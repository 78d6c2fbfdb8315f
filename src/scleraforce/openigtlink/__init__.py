"""OpenIGTLink, the protocol of image-guided therapy: records to bytes and bytes to events, with no socket in it."""

from scleraforce.openigtlink.decoder import (
    BadChecksum,
    Broken,
    Decoder,
    DecoderState,
    Malformed,
    PeerEvent,
    Received,
    Unknown,
)
from scleraforce.openigtlink.image import Image
from scleraforce.openigtlink.messages import Message, Query, Sensor, Status, Text, Transform, encode

__all__ = [
    "BadChecksum",
    "Broken",
    "Decoder",
    "DecoderState",
    "Image",
    "Malformed",
    "Message",
    "PeerEvent",
    "Query",
    "Received",
    "Sensor",
    "Status",
    "Text",
    "Transform",
    "Unknown",
    "encode",
]
