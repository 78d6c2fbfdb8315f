"""ROS bags of both generations, written by rosbags and read by their capture stamps."""

from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pytest
from foreign_files import COLUMNS, FRAMES, ROWS, pictures_of

from scleraforce.errors import FrameError, InputError, RecordingError
from scleraforce.recording.bags import read_bag
from scleraforce.recording.scan import UnansweredError

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
from mcap.writer import Writer as McapWriter
from ros_bag import FORCE_TIMES_S, FRAME_TIMES_S, LATE_S, ROS1, ROS2, START_NS, Messages, write_bag
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer as Writer2

REAL = Path(__file__).parents[3] / "shared" / "real-logs" / "ros2-wrench.db3"


def test_frames_and_forces_come_back_by_their_capture_stamps(tmp_path: Path) -> None:
    for kind in ["ros1", "sqlite", "mcap"]:
        place = Path(mkdtemp(dir=tmp_path))
        scan, log = read_bag(write_bag(place / ("a.bag" if kind == "ros1" else "a"), kind))
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        np.testing.assert_allclose(scan.times.time_s - START_NS / 1e9, FRAME_TIMES_S, atol=1e-6)
        np.testing.assert_allclose(log.time_s - START_NS / 1e9, FORCE_TIMES_S, atol=1e-6)
        assert log.columns == ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
        np.testing.assert_allclose(log.wrench_sc[7], [7.0, 0.5, -0.007, 0.25, 0.0, 1.0])
        assert scan.times.source == "header.stamp of /oct/image"


def test_packed_bags_are_read(tmp_path: Path) -> None:
    for packed in ["FILE", "MESSAGE"]:
        place = Path(mkdtemp(dir=tmp_path))
        path = write_bag(place / "a", "sqlite", packed=CompressionMode[packed])
        np.testing.assert_array_equal(pictures_of(read_bag(path)[0]), FRAMES)


def test_how_late_messages_arrived_is_said(tmp_path: Path) -> None:
    scan, log = read_bag(write_bag(tmp_path / "a", "sqlite"))
    notes = (*scan.notes, *log.notes)
    assert "/oct/image: messages arrived 80.0 ms (median; 80.0 to 80.0) after their stamp" in notes[0]
    assert "/ft/wrench: messages arrived 1.0 ms" in notes[1]
    assert not any("clock" in note for note in notes)


def test_a_clock_that_is_not_the_bags_is_told(tmp_path: Path) -> None:
    for shift_s in [-5.0, 0.002]:
        place = Path(mkdtemp(dir=tmp_path))
        images = [Messages(ROS2).image(START_NS + round(shift_s * 1e9) + nth, FRAMES[nth]) for nth in range(3)]
        assert "its clock is not that of the bag" in read_bag(bag_of(place / "a", images))[0].notes[0]


def test_a_storage_file_without_its_metadata_is_read_too(tmp_path: Path) -> None:
    for kind, pattern in [("sqlite", "*.db3"), ("mcap", "*.mcap")]:
        place = Path(mkdtemp(dir=tmp_path))
        path = next(write_bag(place / "a", kind).glob(pattern)).rename(place / f"lone.{pattern[2:]}")
        np.testing.assert_array_equal(pictures_of(read_bag(path)[0]), FRAMES)


def test_of_several_topics_one_is_chosen_by_name(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", "mcap", topics=("/a", "/b"))
    with pytest.raises(UnansweredError, match=r"which topic\? There are /a, /b; give --image-topic"):
        read_bag(path)
    assert read_bag(path, image_topic="/b")[0].times.source == "header.stamp of /b"
    with pytest.raises(InputError, match=r"--image-topic: no topic /c of sensor_msgs.*; .*/ft/wrench \(geometry_msgs"):
        read_bag(path, image_topic="/c")


def test_stamps_that_are_empty_are_asked_about(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", "sqlite", stamped=False)
    with pytest.raises(UnansweredError, match=r"header\.stamp is 0.*give --by-arrival"):
        read_bag(path)
    scan, _ = read_bag(path, by_arrival=True)
    np.testing.assert_allclose(scan.times.time_s - START_NS / 1e9, np.array(FRAME_TIMES_S) + LATE_S, atol=1e-6)
    assert scan.times.source == "arrival of /oct/image"


def test_a_clock_may_begin_at_zero(tmp_path: Path) -> None:
    images = [Messages(ROS2).image(nth * 10**8, FRAMES[nth]) for nth in range(3)]
    scan = read_bag(bag_of(tmp_path / "a", images))[0]
    np.testing.assert_allclose(scan.times.time_s, [0.0, 0.1, 0.2])
    with pytest.raises(UnansweredError, match="--by-arrival"):
        read_bag(bag_of(tmp_path / "b", images[:1]))


def test_a_bag_with_images_alone_has_no_log(tmp_path: Path) -> None:
    assert read_bag(write_bag(tmp_path / "a", "mcap", forces=False))[1] is None


def bag_of(path: Path, messages: list, kind: str = "sensor_msgs/msg/Image") -> Path:
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/image", kind, typestore=ROS2)
        for nth, message in enumerate(messages):
            writer.write(connection, START_NS + nth, ROS2.serialize_cdr(message, kind))
    return path


def test_encodings_become_grey(tmp_path: Path) -> None:
    for encoding in ["mono8", "rgb8", "bgr8", "rgba8", "bgra8", "16SC1", "32FC1"]:
        for big in [False, True]:
            place = Path(mkdtemp(dir=tmp_path))
            grey = (FRAMES[1] % 256).astype(np.uint8)
            colour = np.dstack([grey, grey // 2, 255 - grey, grey])
            given = {
                "mono8": grey, "rgb8": colour[..., :3], "bgr8": colour[..., :3], "rgba8": colour, "bgra8": colour,
                "16SC1": grey.astype(np.int16) - 9, "32FC1": grey / np.float32(7.0),
            }[encoding]  # fmt: skip
            expected = (
                given if given.ndim == 2 else cv2.cvtColor(given, getattr(cv2, f"COLOR_{encoding[:-1].upper()}2GRAY"))
            )
            message = Messages(ROS2).image(START_NS, given, encoding, big=big)
            scan, _ = read_bag(bag_of(place / "a", [message]))
            np.testing.assert_array_equal(pictures_of(scan)[0], expected)
            assert scan.bits == (8 if expected.dtype == np.uint8 else None)


def test_compressed_images_are_decoded(tmp_path: Path) -> None:
    for ending in [".png", ".jpg"]:
        place = Path(mkdtemp(dir=tmp_path))
        grey = np.linspace(0, 255, ROWS * COLUMNS).reshape(ROWS, COLUMNS).astype(np.uint8)
        data = cv2.imencode(ending, grey)[1].ravel()
        kind = "sensor_msgs/msg/CompressedImage"
        message = ROS2.types[kind](header=Messages(ROS2).header(START_NS), format=ending[1:], data=data)
        scan, _ = read_bag(bag_of(place / "a", [message], kind))
        np.testing.assert_allclose(pictures_of(scan)[0], grey, atol=0 if ending == ".png" else 3)


def test_an_encoding_that_is_not_read_and_too_little_data_are_refused(tmp_path: Path) -> None:
    image = Messages(ROS2).image(START_NS, FRAMES[0])
    image.encoding = "bayer_rggb8"
    with pytest.raises(FrameError, match="/image: encoding 'bayer_rggb8'; one of mono8"):
        read_bag(bag_of(tmp_path / "a", [image]))
    image = Messages(ROS2).image(START_NS, FRAMES[0])
    image.height += 1
    with pytest.raises(FrameError, match=r"/image: damaged: .* bytes for 25 rows of 86"):
        read_bag(bag_of(tmp_path / "b", [image]))


def write_topic(path: Path, kind: str, sent: list) -> Path:
    """A bag of one topic from (publisher, arrival in ns, message, type)."""
    store = ROS1 if kind == "ros1" else ROS2
    if kind == "mcap":
        with path.open("wb") as file:
            writer = McapWriter(file)
            writer.start(profile="ros2")
            channels = {}
            for publisher, arrived_ns, message, name in sent:
                if publisher not in channels:
                    text = ROS2.generate_msgdef(name, ros_version=2)[0].encode()
                    schema = writer.register_schema(name=name, encoding="ros2msg", data=text)
                    channels[publisher] = writer.register_channel(
                        topic="/t", message_encoding="cdr", schema_id=schema, metadata={"publisher": str(publisher)}
                    )
                data = bytes(ROS2.serialize_cdr(message, name))
                writer.add_message(channels[publisher], arrived_ns, data, arrived_ns)
            writer.finish()
        return path
    writer = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    with writer:
        connections = {}
        for publisher, arrived_ns, message, name in sent:
            if publisher not in connections:
                own = {"callerid": f"/p{publisher}"} if kind == "ros1" else {"offered_qos_profiles": []}
                # A storage of ROS 2 keeps one row for a topic, whatever the number of its publishers.
                one = kind == "sqlite" and connections
                connections[publisher] = (
                    next(iter(connections.values()))
                    if one
                    else writer.add_connection("/t", name, typestore=store, **own)
                )
            serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
            writer.write(connections[publisher], arrived_ns, serialize(message, name))
    return path


IMAGE, WRENCH = "sensor_msgs/msg/Image", "geometry_msgs/msg/WrenchStamped"
MILLISECOND_NS = 10**6


def messages_of(kind: str) -> Messages:
    return Messages(ROS1 if kind == "ros1" else ROS2)


def test_all_publishers_of_a_topic_are_merged_by_stamp(tmp_path: Path) -> None:
    for kind in ["ros1", "mcap", "sqlite"]:
        for first in [1, 2, 3]:
            place = Path(mkdtemp(dir=tmp_path))
            images = [messages_of(kind).image(START_NS + nth * 10**8, FRAMES[nth]) for nth in range(5)]
            arrived_ns = [START_NS + nth * 10**8 + MILLISECOND_NS for nth in range(5)]
            sent = [(nth >= first, arrived_ns[nth], images[nth], IMAGE) for nth in range(5)]
            scan = read_bag(write_topic(place / "a.bag" if kind == "ros1" else place / "a.mcap", kind, sent))[0]
            np.testing.assert_array_equal(pictures_of(scan), FRAMES)
            np.testing.assert_allclose(scan.times.time_s - START_NS / 1e9, np.arange(5) / 10.0, atol=1e-6)


def test_forces_of_two_publishers_in_turns_are_sorted_by_stamp(tmp_path: Path) -> None:
    """The second publisher's messages take 12 ms longer than the next ones of the first."""
    for kind in ["ros1", "mcap", "sqlite"]:
        place = Path(mkdtemp(dir=tmp_path))
        sent = []
        for nth in range(40):
            stamp_ns = START_NS + nth * 5 * MILLISECOND_NS
            late_ns = (13 if nth % 2 else 1) * MILLISECOND_NS
            sent.append((nth % 2, stamp_ns + late_ns, messages_of(kind).wrench(stamp_ns, [nth, 0, 0, 0, 0, 0]), WRENCH))
        sent.sort(key=lambda each: each[1])
        path = write_topic(place / ("a.bag" if kind == "ros1" else "a.mcap"), kind, sent)
        _, log = read_bag(path)
        np.testing.assert_array_equal(log.wrench_sc[:, 0], np.arange(40))
        np.testing.assert_allclose(log.time_s - START_NS / 1e9, np.arange(40) * 0.005, atol=1e-6)
        assert any("sorted by stamp" in note for note in log.notes)
        assert any("2 publishers, with 20 and 20 messages" in note for note in log.notes) == (kind != "sqlite")


def test_frames_that_arrive_late_come_in_their_turn(tmp_path: Path) -> None:
    sent = [
        (0, START_NS + (nth * 100 + late_ms) * MILLISECOND_NS, image(START_NS + nth * 10**8, FRAMES[nth]), IMAGE)
        for nth, late_ms in ((1, 10), (0, 130), (3, 10), (2, 130), (4, 10))
        for image in [Messages(ROS2).image]
    ]
    scan = read_bag(write_topic(tmp_path / "a.mcap", "mcap", sent))[0]
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert [name.rpartition("[")[2] for name in scan.names] == ["1]", "0]", "3]", "2]", "4]"]


def test_publishers_on_two_clocks_are_refused(tmp_path: Path) -> None:
    for kind in ["ros1", "mcap"]:
        for shift_s in [-3600, 7]:
            place = Path(mkdtemp(dir=tmp_path))
            sent = []
            for nth in range(4):
                stamp_ns = START_NS + nth * 10**8
                shifted_ns = stamp_ns + (shift_s * 10**9 if nth > 1 else 0)
                sent.append(
                    (nth > 1, stamp_ns + MILLISECOND_NS, messages_of(kind).image(shifted_ns, FRAMES[nth]), IMAGE)
                )
            with pytest.raises(RecordingError, match=r"/t: its publishers are not on one clock: .* 1 ms .* and "):
                read_bag(write_topic(place / ("a.bag" if kind == "ros1" else "a.mcap"), kind, sent))


def test_coordinate_frames_that_differ_within_a_topic_are_refused(tmp_path: Path) -> None:
    for kind in ["ros1", "mcap", "sqlite"]:
        place = Path(mkdtemp(dir=tmp_path))
        sent = []
        for nth in range(4):
            message = messages_of(kind).wrench(START_NS + nth * MILLISECOND_NS, [nth] * 6)
            message.header.frame_id = "sensor" if nth < 3 else "tool0"
            sent.append((nth == 3, START_NS + nth * MILLISECOND_NS, message, WRENCH))
        path = write_topic(place / ("a.bag" if kind == "ros1" else "a.mcap"), kind, sent)
        with pytest.raises(InputError, match=r"/t: header\.frame_id is 'sensor' in message 0 and 'tool0' in message 3"):
            read_bag(path)


def test_two_types_on_one_topic_are_refused(tmp_path: Path) -> None:
    for kind in ["ros1", "mcap"]:
        maker = messages_of(kind)
        vector = maker.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
        other = maker.types["geometry_msgs/msg/Vector3Stamped"](header=maker.header(START_NS + 5), vector=vector)
        sent = [
            (0, START_NS, maker.wrench(START_NS, [0] * 6), WRENCH),
            (1, START_NS + 5, other, "geometry_msgs/msg/Vector3Stamped"),
        ]
        path = write_topic(tmp_path / ("a.bag" if kind == "ros1" else "a.mcap"), kind, sent)
        with pytest.raises(InputError, match=r"/t: messages of two types, .*WrenchStamped and .*Vector3Stamped"):
            read_bag(path)


def test_two_definitions_of_one_type_are_refused_and_comments_do_not_matter(tmp_path: Path) -> None:
    text = ROS2.generate_msgdef(WRENCH, ros_version=2)[0]
    for name, other, refused in (
        ("a", text.replace("Vector3 torque", "Vector3 moment"), True),
        ("b", f"# 2\n{text}", False),
    ):
        with (tmp_path / f"{name}.mcap").open("wb") as file:
            writer = McapWriter(file)
            writer.start(profile="ros2")
            for nth, definition in enumerate((text, other)):
                schema = writer.register_schema(name=WRENCH, encoding="ros2msg", data=definition.encode())
                channel = writer.register_channel(topic="/t", message_encoding="cdr", schema_id=schema)
                message = Messages(ROS2).wrench(START_NS + nth, [nth] * 6)
                writer.add_message(channel, START_NS + nth, bytes(ROS2.serialize_cdr(message, WRENCH)), START_NS + nth)
            writer.finish()
        if refused:
            with pytest.raises(InputError, match=rf"/t: two definitions of {WRENCH}"):
                read_bag(tmp_path / f"{name}.mcap")
        else:
            assert len(read_bag(tmp_path / f"{name}.mcap")[1].time_s) == 2


def test_a_clock_that_is_set_back_is_refused_with_both_stamps(tmp_path: Path) -> None:
    for back_ms in [40, 300, 3000]:
        sent = []
        for nth in range(100):
            arrived_ns = START_NS + nth * 5 * MILLISECOND_NS
            stamp_ns = arrived_ns - (back_ms * MILLISECOND_NS if nth >= 60 else 0)
            sent.append((0, arrived_ns + nth % 3 * MILLISECOND_NS, Messages(ROS2).wrench(stamp_ns, [nth] * 6), WRENCH))
        with pytest.raises(
            RecordingError, match=r"/t: its stamps do not run forward: message 59 is of .* message 60 of "
        ):
            read_bag(write_topic(tmp_path / "a.mcap", "mcap", sent))


def test_messages_of_one_stamp_are_left_out_where_they_are_the_same_and_else_refused(tmp_path: Path) -> None:
    def sent(last: int) -> list:
        stamps = [(0, 0), (1, 1), (2, 2), (last, 2)]
        return [
            (nth == 3, START_NS + nth, Messages(ROS2).image(START_NS + at * 10**8, FRAMES[which]), IMAGE)
            for nth, (which, at) in enumerate(stamps)
        ]

    scan, _ = read_bag(write_topic(tmp_path / "a.mcap", "mcap", sent(2)))
    np.testing.assert_array_equal(pictures_of(scan), FRAMES[:3])
    assert any("1 messages repeat another's stamp and content" in note for note in scan.notes)
    with pytest.raises(RecordingError, match=r"/t: its stamps .* messages 2 and 3 differ and have one stamp"):
        read_bag(write_topic(tmp_path / "b.mcap", "mcap", sent(4)))


def test_some_stamps_that_are_empty_are_asked_about(tmp_path: Path) -> None:
    for empty in [(0,), (2,), (1, 3)]:
        sent = [
            (
                0,
                START_NS + nth * 10**8,
                Messages(ROS2).image(0 if nth in empty else START_NS + nth * 10**8, FRAMES[nth]),
                IMAGE,
            )
            for nth in range(5)
        ]
        path = write_topic(tmp_path / "a.mcap", "mcap", sent)
        with pytest.raises(UnansweredError, match=rf"/t: {len(empty)} of 5 messages are without .*--by-arrival"):
            read_bag(path)
        np.testing.assert_array_equal(pictures_of(read_bag(path, by_arrival=True)[0]), FRAMES)


@pytest.mark.parametrize("field", ["encoding", "is_bigendian", "height", "width", "step"])
def test_images_that_change_within_a_topic_are_refused(tmp_path: Path, field: str) -> None:
    grey = (FRAMES[3] % 256).astype(np.uint8)
    other = {
        "encoding": lambda at: Messages(ROS2).image(at, grey, "mono8", padding=46),
        "is_bigendian": lambda at: Messages(ROS2).image(at, FRAMES[3], big=True),
        "height": lambda at: Messages(ROS2).image(at, FRAMES[3][:-1]),
        "width": lambda at: Messages(ROS2).image(at, FRAMES[3][:, :-1], padding=8),
        "step": lambda at: Messages(ROS2).image(at, FRAMES[3], padding=8),
    }[field]
    images = [Messages(ROS2).image(START_NS + nth, FRAMES[nth]) for nth in range(3)] + [other(START_NS + 3)]
    first, last = (getattr(image, field) for image in (images[0], images[3]))
    with pytest.raises(FrameError, match=rf"/image: {field} is {first!r} in message 0 and {last!r} in message 3"):
        read_bag(bag_of(tmp_path / "a", images))


def test_compressed_images_that_change_their_depth_are_refused(tmp_path: Path) -> None:
    kind = "sensor_msgs/msg/CompressedImage"
    messages = []
    for nth, pixels in enumerate((FRAMES[0], FRAMES[1], (FRAMES[2] % 256).astype(np.uint8))):
        data = cv2.imencode(".png", pixels)[1].ravel()
        messages.append(ROS2.types[kind](header=Messages(ROS2).header(START_NS + nth), format="png", data=data))
    scan, _ = read_bag(bag_of(tmp_path / "a", messages, kind))
    with pytest.raises(FrameError, match=r"/image: images of .* uint16, and in message 2 of .* uint8"):
        pictures_of(scan)


def test_a_bag_without_images_and_forces_lists_what_it_has(tmp_path: Path) -> None:
    text = ROS2.types["std_msgs/msg/String"]("hello")
    with pytest.raises(
        InputError, match=r"neither a topic of images.*nor of forces.*there are /image \(std_msgs/msg/String\)"
    ):
        read_bag(bag_of(tmp_path / "a", [text], "std_msgs/msg/String"))


def test_a_damaged_bag_is_named(tmp_path: Path) -> None:
    for name in ["a.bag", "a.db3", "a.mcap"]:
        marks = {"a.bag": b"#ROSBAG V2.0\n", "a.db3": b"SQLite format 3\0", "a.mcap": b"\x89MCAP0\r\n"}
        (tmp_path / name).write_bytes(marks[name] + bytes(1000))
        with pytest.raises(FrameError, match=f"{name}: damaged"):
            read_bag(tmp_path / name)


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-logs")
def test_a_real_bag_without_definitions_gives_its_forces() -> None:
    scan, log = read_bag(REAL)
    assert scan is None
    assert log.columns == ("fx_n", "fy_n", "fz_n")
    assert len(log.time_s) == 1655
    assert log.sample_rate_hz == pytest.approx(30.0, rel=0.05)
