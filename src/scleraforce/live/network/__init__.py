"""OpenIGTLink messages, a scanner's frames and the operator's reset.

Sockets. Imports `records` and `base`.

Public:
    openigtlink: `BadChecksum`, `Broken`, `Decoder`, `HEADER_BYTES`, `IDENTITY`,
        `Image`, `Malformed`, `Message`, `PeerEvent`, `Query`, `Received`, `Sensor`,
        `Status`, `Text`, `Transform`, `encode`, `pack_header`, `unpack_header`
    operator_reset: `CODE`, `LOCKED`, `RESET_DEVICE`, `ResetCode`, `ResetToken`,
        `TOO_MANY`, `ask_reset`, `secret_of_file`, `secret_of_stream`, `token_digest`
    scanner_frame: `FrameAssembler`, `ScannerFrame`
"""
