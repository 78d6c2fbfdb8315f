"""Fields that PLUS writes into the headers of its sequences."""

from format_frames import COUNT


def plus_fields(stamps, states=("OK",) * COUNT) -> dict[str, object]:
    fields: dict[str, object] = {"UltrasoundImageOrientation": "MF"}
    for nth, (stamp, state) in enumerate(zip(stamps, states, strict=True)):
        fields |= {f"Seq_Frame{nth:04d}_Timestamp": stamp, f"Seq_Frame{nth:04d}_ImageStatus": state}
    return fields
