"""OpenIGTLink, the protocol of image-guided therapy: records to bytes and bytes to events, with no socket in it."""

from scleraforce.openigtlink.decoder import (
    BadChecksum as BadChecksum,
)
from scleraforce.openigtlink.decoder import (
    Broken as Broken,
)
from scleraforce.openigtlink.decoder import (
    Decoder as Decoder,
)
from scleraforce.openigtlink.decoder import (
    DecoderState as DecoderState,
)
from scleraforce.openigtlink.decoder import (
    Malformed as Malformed,
)
from scleraforce.openigtlink.decoder import (
    PeerEvent as PeerEvent,
)
from scleraforce.openigtlink.decoder import (
    Received as Received,
)
from scleraforce.openigtlink.decoder import (
    Unknown as Unknown,
)
from scleraforce.openigtlink.image import Image as Image
from scleraforce.openigtlink.messages import Message as Message
from scleraforce.openigtlink.messages import Query as Query
from scleraforce.openigtlink.messages import Sensor as Sensor
from scleraforce.openigtlink.messages import Status as Status
from scleraforce.openigtlink.messages import Text as Text
from scleraforce.openigtlink.messages import Transform as Transform
from scleraforce.openigtlink.messages import encode as encode
