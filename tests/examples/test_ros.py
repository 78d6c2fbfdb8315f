"""The ROS 2 node with a fake rclpy: images of a recorded bag go in, typed messages come
out.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from fake_monitor import FakeMonitor, fake_monitor
from sources import example_module
from waiting import wait_until

from scleraforce.live.network.openigtlink import Image, Received, Status

rosbags = pytest.importorskip("rosbags", reason="the extra [formats] is not installed")

from rosbags.rosbag2 import Reader, Writer  # noqa: E402
from rosbags.typesys import Stores, get_typestore  # noqa: E402

STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types
ROWS = 6
COLUMNS = 9


def filled(name: str) -> Any:
    """A message of a type with every field at its zero, as ROS makes one."""
    made = {}
    for field, (kind, detail) in STORE.get_msgdef(name).fields:
        if kind.name == "NAME":
            made[field] = filled(detail)
        elif kind.name == "BASE":
            made[field] = {"string": "", "bool": False}.get(detail[0], 0)
        else:
            raise AssertionError(f"{name}: {field}")

    return SimpleNamespace(**made)


def rostype(name: str) -> type:
    """Return a class whose messages can be made empty or of some fields; only fields of
    the type exist.
    """

    def new(_: type, **fields: Any) -> Any:
        message = filled(name)
        for field, value in fields.items():
            assert hasattr(message, field), f"{name} has no {field}"
            setattr(message, field, value)
        message.type = name
        return message

    return type(name.rsplit("/", 1)[1], (), {"__new__": new})


def serialised(message: Any) -> None:
    """Assert that ROS could send it: every field of the type its definition states."""

    def typed(value: Any, name: str) -> Any:
        fields = {}
        for field, (kind, detail) in STORE.get_msgdef(name).fields:
            content = getattr(value, field)
            fields[field] = typed(content, detail) if kind.name == "NAME" else content
        return TYPES[name](**fields)

    STORE.serialize_cdr(typed(message, message.type), message.type)


class FakeNode:
    """A fake rclpy.node.Node that collects published messages; the tests call its
    timers.
    """

    given: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters = dict[str, Any]()
        self.published: dict[str, list[Any]] = {}
        self.subscriptions_: dict[str, Callable[[Any], None]] = {}
        self.errors: list[str] = []

    def declare_parameter(self, name: str, value: Any) -> None:
        self.parameters[name] = self.given.get(name, value)

    def get_parameter(self, name: str) -> Any:
        return SimpleNamespace(value=self.parameters[name])

    def create_publisher(self, _kind: type, topic: str, _depth: int) -> Any:
        messages = self.published.setdefault(topic, [])
        return SimpleNamespace(publish=messages.append)

    def create_subscription(
        self, _kind: type, topic: str, callback: Callable[[Any], None], _depth: int
    ) -> None:
        self.subscriptions_[topic] = callback

    def create_timer(self, period_s: float, callback: Callable[[], None]) -> None:
        self.timer = (period_s, callback)

    def destroy_node(self) -> None: ...

    def get_logger(self) -> Any:
        return SimpleNamespace(error=self.errors.append)


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    packages = ("rclpy", "geometry_msgs", "sensor_msgs", "std_msgs")
    names = (*packages, "rclpy.node", *(f"{name}.msg" for name in packages[1:]))
    stubs = {name: ModuleType(name) for name in names}
    stubs["rclpy.node"].Node = FakeNode
    stubs["geometry_msgs.msg"].WrenchStamped = rostype(
        "geometry_msgs/msg/WrenchStamped"
    )
    stubs["sensor_msgs.msg"].Image = TYPES["sensor_msgs/msg/Image"]

    for name in ("Bool", "String"):
        setattr(stubs["std_msgs.msg"], name, rostype(f"std_msgs/msg/{name}"))

    for name, stub in stubs.items():
        monkeypatch.setitem(sys.modules, name, stub)

    monkeypatch.setattr(sys, "path", list(sys.path))
    loaded = example_module("ros2/force_monitor_node")
    # the machine may be busy
    monkeypatch.setattr(loaded.robot_client, "SILENCE_S", 300.0)

    return loaded


def frame(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(
        0, 4096, (ROWS, COLUMNS), dtype=np.uint16
    )


def image(
    number: int, *, big: bool = False, padding: int = 0, encoding: str = "mono16"
) -> Any:
    """A frame as sensor_msgs/Image, with `padding` bytes behind each row."""
    rows = (
        frame(number).astype(">u2" if big else "<u2").view(np.uint8).reshape(ROWS, -1)
    )
    data = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    header = TYPES["std_msgs/msg/Header"](
        stamp=TYPES["builtin_interfaces/msg/Time"](
            sec=1_795_000_000 + number, nanosec=250_000_000
        ),
        frame_id="oct",
    )

    return TYPES["sensor_msgs/msg/Image"](
        header=header,
        height=ROWS,
        width=COLUMNS,
        encoding=encoding,
        is_bigendian=int(big),
        step=data.shape[1],
        data=data.ravel(),
    )


def bag_of(folder: Path, messages: list[Any]) -> Iterator[Any]:
    """Write messages to a ROS 2 bag, and yield them as they are read from it."""
    with Writer(folder / "bag", version=9) as writer:
        link = writer.add_connection(
            "/oct/bscan", "sensor_msgs/msg/Image", typestore=STORE
        )
        for number, message in enumerate(messages):
            writer.write(
                link, number, STORE.serialize_cdr(message, "sensor_msgs/msg/Image")
            )

    with Reader(folder / "bag") as reader:
        for link, _, data in reader.messages():
            yield STORE.deserialize_cdr(data, link.msgtype)


@pytest.fixture
def monitor() -> Iterator[FakeMonitor]:
    with fake_monitor() as running:
        yield running


@pytest.fixture
def node(
    module: ModuleType, monitor: FakeMonitor, monkeypatch: pytest.MonkeyPatch
) -> Iterator[FakeNode]:
    monkeypatch.setattr(
        FakeNode, "given", {"port": monitor.port, "width_mm": 18.0, "depth_mm": 3.0}
    )
    made = module.ForceMonitorNode()
    yield made
    made.destroy_node()


def test_images_of_a_bag_reach_the_monitor_and_their_forces_come_back(
    node: FakeNode, monitor: FakeMonitor, tmp_path: Path
) -> None:
    sent = [image(1), image(2, big=True), image(3, padding=5)]
    for message in bag_of(tmp_path, sent):
        node.subscriptions_["image"](message)

    wait_until(lambda: len(node.published["~/force_high"]) == 3)
    events = [
        e
        for e in monitor.received
        if isinstance(e, Received) and isinstance(e.message, Image)
    ]

    for number, event in enumerate(events, start=1):
        np.testing.assert_array_equal(event.message.pixels[0], frame(number))
        assert event.message.matrix[:5] == pytest.approx(
            (18.0 / COLUMNS, 0.0, 0.0, 0.0, 3.0 / ROWS)
        )
        assert event.message_id == number
        assert event.header.time_s == pytest.approx(1_795_000_000.25 + number, abs=1e-6)

    for name, force_n in (
        ("force", 1.5e-3),
        ("force_low", 0.5e-3),
        ("force_high", 2.5e-3),
    ):
        assert [m.wrench.force.z for m in node.published[f"~/{name}"]] == [
            pytest.approx(force_n)
        ] * 3

    assert [m.header.stamp.sec for m in node.published["~/force"]] == [
        1_795_000_001,
        1_795_000_002,
        1_795_000_003,
    ]


def test_the_order_is_to_withdraw_until_the_monitor_says_ok_and_after_it_says_no(
    node: FakeNode, monitor: FakeMonitor
) -> None:
    orders = node.published["~/withdraw"]
    reasons = node.published["~/reason"]
    node.timer[1]()
    assert orders[-1].data is True
    node.subscriptions_["image"](image(1))
    wait_until(lambda: orders[-1].data is False)
    monitor.say(Status(3, 102, "BOUND", "WITHDRAW: up to 31 mN"))
    wait_until(lambda: orders[-1].data is True)
    assert "up to 31 mN" in reasons[-1].data

    for message in (orders[-1], reasons[-1]):
        serialised(message)


def test_when_the_monitor_goes_the_order_to_withdraw_stays(
    node: FakeNode, monitor: FakeMonitor
) -> None:
    node.subscriptions_["image"](image(1))
    orders = node.published["~/withdraw"]
    wait_until(lambda: bool(orders) and orders[-1].data is False)
    monitor.close()
    wait_until(lambda: orders[-1].data is True)
    node.subscriptions_["image"](image(2))  # nobody takes it
    node.timer[1]()
    assert orders[-1].data is True


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (image(1, encoding="rgb8"), "encoding 'rgb8'; give one of mono8"),
        (image(1), "bytes for"),
    ],
    ids=["colour", "cut"],
)
def test_an_image_that_cannot_be_read_is_an_error_and_no_frame(
    node: FakeNode, monitor: FakeMonitor, message: Any, said: str
) -> None:
    if message.encoding == "mono16":
        message.data = message.data[:-3]
    node.subscriptions_["image"](message)
    assert said in node.errors[0]
    assert not [
        e
        for e in monitor.received
        if isinstance(e, Received) and isinstance(e.message, Image)
    ]
