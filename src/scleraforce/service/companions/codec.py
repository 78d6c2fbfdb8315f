"""Messages of the monitor's processes as bytes and back: one JSON object each, `kind` first; the table is closed."""

import json
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from scleraforce.errors import MessageError
from scleraforce.service.companions.messages import MESSAGE_KINDS, CompanionMessage
from scleraforce.service.record_json import record_as_json, record_of_json

MESSAGE_BYTES = 128 * 1024  # more than any message needs
KIND_OF: Mapping[type[Any], str] = MappingProxyType({record: kind for kind, record in MESSAGE_KINDS.items()})


def message_as_json(message: CompanionMessage) -> dict[str, Any]:
    """Return a message as a JSON object.

    Raises:
        MessageError: a field of it holds what it may not.

    >>> from scleraforce.service.companions.messages import Note
    >>> message_as_json(Note(time_s=1.5, text="robot came"))
    {'kind': 'note', 'time_s': 1.5, 'text': 'robot came'}
    """
    kind = KIND_OF.get(type(message))
    if kind is None:
        raise MessageError(f"a {type(message).__name__} is no message")
    try:
        return {"kind": kind, **record_as_json(message)}
    except MessageError as fault:
        raise MessageError(f"{kind}: {fault}") from fault


def encode_message(message: CompanionMessage) -> bytes:
    """Return the bytes of a message.

    Raises:
        MessageError: a field of it holds what it may not, or it is too large.
    """
    data = json.dumps(message_as_json(message)).encode()
    _check_size(data)
    return data


def decode_message(data: bytes) -> CompanionMessage:
    """Return the message in bytes that came.

    Raises:
        MessageError: they are no whole message of a known kind with exactly its fields; the message says why.

    >>> decode_message(b'{"kind": "note", "time_s": 1.5}')
    Traceback (most recent call last):
    scleraforce.errors.MessageError: note: without text
    """
    _check_size(data)
    try:
        fields = json.loads(data)
    except (ValueError, RecursionError) as fault:
        raise MessageError(f"not JSON: {fault}") from fault
    kind = fields.pop("kind", None) if isinstance(fields, dict) else None
    if not isinstance(kind, str) or kind not in MESSAGE_KINDS:
        raise MessageError(f"{data[:60]!r}: not an object with one of these kinds: {', '.join(MESSAGE_KINDS)}")
    try:
        return record_of_json(MESSAGE_KINDS[kind], fields)
    except MessageError as fault:
        raise MessageError(f"{kind}: {fault}") from fault


def _check_size(data: bytes) -> None:
    if len(data) > MESSAGE_BYTES:
        raise MessageError(f"a message of {len(data)} bytes; at most {MESSAGE_BYTES}")
