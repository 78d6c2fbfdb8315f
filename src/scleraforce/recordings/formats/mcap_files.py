"""MCAP files of other programs than ROS 2: messages of ROS 1, and Foxglove's images as
JSON or Protobuf.
"""

import json
from base64 import b64decode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Protocol

from scleraforce.base.errors import InputError
from scleraforce.base.optional_packages import package_for

if TYPE_CHECKING:
    from mcap.records import Channel, Schema

MAGIC = b"\x89MCAP0\r\n"
ROS_2 = "cdr"
READ = ("cdr", "ros1", "json", "protobuf")
Decoder = Callable[[bytes], Any]


class BagConnection(Protocol):
    """The messages of one topic and publisher in a bag."""

    @property
    def id(self) -> int:
        """Its number."""

    @property
    def topic(self) -> str:
        """The name of the topic."""

    @property
    def msgtype(self) -> str:
        """The type of its messages."""

    @property
    def msgcount(self) -> int:
        """The number of its messages."""

    @property
    def msgdef(self) -> Any:
        """The definition of its messages, `data`."""


class Bag(Protocol):
    """A bag: `rosbags.highlevel.AnyReader`, or `McapFile`."""

    @property
    def connections(self) -> Sequence[BagConnection]:
        """All that it holds."""

    def messages(
        self, connections: Sequence[BagConnection]
    ) -> Iterator[tuple[BagConnection, int, Any]]:
        """Yield connection, time of arrival in ns, and content of each message."""

    def deserialize(self, data: Any, msgtype: str) -> Any:
        """Return a message with attributes."""


@dataclass(frozen=True)
class Definition:
    """A message's definition as text."""

    data: str


@dataclass(frozen=True)
class McapChannel:
    """A channel, as a connection of a ROS bag."""

    id: int
    topic: str
    msgtype: str
    msgcount: int
    msgdef: Definition


def is_mcap(path: Path) -> bool:
    """Return whether a file begins as MCAP."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def check_whole(path: Path) -> None:
    """Refuse an MCAP file whose end is missing."""
    with path.open("rb") as file:
        file.seek(-min(len(MAGIC), path.stat().st_size), 2)
        if file.read() == MAGIC:
            return

    raise InputError(
        "its end is missing, as if the recording was cut off: `mcap recover"
        f" {path.name} -o whole.mcap` (mcap.dev) keeps the messages in it"
    )


class McapFile:
    """An MCAP file as a `Bag`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._decoders: dict[int, Decoder] = {}
        self.connections: list[BagConnection] = []

        with self._opened() as reader:
            summary = reader.get_summary()
            if summary is None or summary.statistics is None:
                raise InputError(
                    "it has no summary; `mcap recover` (mcap.dev) writes one"
                )

            counts = summary.statistics.channel_message_counts
            for number, channel in summary.channels.items():
                schema = summary.schemas.get(channel.schema_id)
                name, decoder = decoder_of(channel, schema)
                self._decoders[number] = decoder
                text = schema.data.decode("latin-1") if schema else ""
                self.connections.append(
                    McapChannel(
                        number,
                        channel.topic,
                        name,
                        counts.get(number, 0),
                        Definition(f"{channel.message_encoding}\n{text}"),
                    )
                )

    @contextmanager
    def _opened(self) -> Iterator[Any]:
        package = package_for("mcap.reader", "MCAP")
        with self._path.open("rb") as file:
            yield package.make_reader(file)

    def messages(
        self, connections: Sequence[BagConnection]
    ) -> Iterator[tuple[BagConnection, int, Any]]:
        """Yield the decoded messages of connections in the order of their arrival."""
        wanted = {each.id: each for each in connections}
        topics = [each.topic for each in connections]
        with self._opened() as reader:
            for _, channel, message in reader.iter_messages(topics=topics):
                if channel.id in wanted:
                    decoded = self._decoders[channel.id](message.data)
                    yield wanted[channel.id], message.log_time, decoded

    def deserialize(self, data: Any, _: str) -> Any:
        """Return a message of `messages`, which are decoded."""
        return data


def is_of_ros_2(path: Path) -> bool:
    """Return whether all channels of an MCAP file are those of ROS 2."""
    package = package_for("mcap.reader", "MCAP")
    with path.open("rb") as file:
        summary = package.make_reader(file).get_summary()

    channels = () if summary is None else summary.channels.values()
    return all(channel.message_encoding == ROS_2 for channel in channels)


def decoder_of(channel: "Channel", schema: "Schema | None") -> tuple[str, Decoder]:
    """Return the name of a channel's messages, as ROS 2 calls them, and what decodes
    them; other encodings are refused when a message is read.
    """
    encoding = channel.message_encoding
    name = "" if schema is None else schema.name
    if encoding in ("ros1", ROS_2) and schema is not None:
        return _of_ros(encoding, name, schema)
    if encoding == "json":
        return _known_name(name), lambda data: _of_json(json.loads(data))
    if encoding == "protobuf" and schema is not None:
        return _known_name(name), _of_protobuf(name, schema.data)

    def refuse(_: bytes) -> Any:
        raise InputError(
            f"{channel.topic}: message_encoding {encoding!r}; one of {', '.join(READ)}"
        )

    return f"{name} ({encoding})", refuse


def _of_ros(encoding: str, name: str, schema: "Schema") -> tuple[str, Decoder]:
    typesys = package_for("rosbags.typesys", "a ROS bag")
    package, _, kind = name.replace("/msg/", "/").partition("/")
    full = f"{package}/msg/{kind}"
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(schema.data.decode(), full))
    decode = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr

    return full, lambda data: decode(data, full)


FOXGLOVE = "foxglove_msgs/msg/"  # of its messages in ROS 2


def _known_name(name: str) -> str:
    """Return the name that ROS 2 has for a schema, like that of foxglove.RawImage."""
    kind = name.replace("/", ".").rpartition(".")[2]
    if kind in ("CompressedImage", "RawImage"):
        return f"{FOXGLOVE}{kind}"
    if kind in ("WrenchStamped", "Wrench"):
        return "geometry_msgs/msg/WrenchStamped"
    return name


def _of_json(value: Any) -> Any:
    """Return a JSON object with attributes, its bytes decoded and its stamp named as in
    ROS 2.
    """
    if isinstance(value, list):
        return [_of_json(each) for each in value]
    if not isinstance(value, Mapping):
        return value

    found = {str(name): _of_json(each) for name, each in value.items()}
    for name in ("nsec", "nsecs", "nanos"):
        if name in found and ("sec" in found or "secs" in found or "seconds" in found):
            found["nanosec"] = found.pop(name)
    for name in ("secs", "seconds"):
        if name in found and "nanosec" in found:
            found["sec"] = found.pop(name)
    if isinstance(found.get("data"), str):
        found["data"] = b64decode(found["data"])

    return _with_wrench(SimpleNamespace(**found))


def _with_wrench(message: Any) -> Any:
    """Return a message of a wrench whose force is not within another field."""
    if hasattr(message, "force") and hasattr(message, "timestamp"):
        torque = getattr(message, "torque", None)
        nothing = SimpleNamespace(x=float("nan"), y=float("nan"), z=float("nan"))
        message.wrench = SimpleNamespace(force=message.force, torque=torque or nothing)
    return message


def _of_protobuf(name: str, descriptors: bytes) -> Decoder:
    pool = package_for("google.protobuf.descriptor_pool", "MCAP").DescriptorPool()
    descriptor = package_for("google.protobuf.descriptor_pb2", "MCAP")
    factory = package_for("google.protobuf.message_factory", "MCAP")
    for file in descriptor.FileDescriptorSet.FromString(descriptors).file:
        pool.Add(file)

    kind = factory.GetMessageClass(pool.FindMessageTypeByName(name))

    def decode(data: bytes) -> Any:
        message = kind.FromString(data)
        fields = {
            field.name: getattr(message, field.name)
            for field in message.DESCRIPTOR.fields
        }
        stamp = fields.get("timestamp")
        if stamp is not None:
            fields["timestamp"] = SimpleNamespace(
                sec=stamp.seconds, nanosec=stamp.nanos
            )
        return _with_wrench(SimpleNamespace(**fields))

    return decode
