"""OpenIGTLink, the protocol of image-guided therapy: records to bytes and bytes to events, with no socket in it."""

from scleraforce.openigtlink.decoder import (
    BadChecksum as BadChecksum,
    Broken as Broken,
    Decoder as Decoder,
    DecoderState as DecoderState,
    Malformed as Malformed,
    PeerEvent as PeerEvent,
    Received as Received,
    Unknown as Unknown,
)
from scleraforce.openigtlink.messages import (
    Image as Image,
    Message as Message,
    Query as Query,
    Sensor as Sensor,
    Status as Status,
    Text as Text,
    Transform as Transform,
    encode as encode,
)
