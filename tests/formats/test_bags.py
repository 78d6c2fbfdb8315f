"""ROS bags of both generations, written by rosbags and read by their capture stamps."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from format_frames import COLUMNS, FRAMES, ROWS, pictures_of

from scleraforce.errors import FrameError, InputError, RecordingError
from scleraforce.formats.bags import BagTopics, read_bag
from scleraforce.formats.scan import UnansweredError

pytest.importorskip("rosbags")
from ros_bag import FORCE_TIMES_S, FRAME_TIMES_S, LATE_S, ROS2, START_NS, Messages, write_bag
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

REAL = Path(__file__).parents[3] / "shared" / "real-logs" / "ros2-wrench.db3"


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
def test_frames_and_forces_come_back_by_their_capture_stamps(tmp_path: Path, kind: str) -> None:
    bag = read_bag(write_bag(tmp_path / ("a.bag" if kind == "ros1" else "a"), kind), BagTopics())
    np.testing.assert_array_equal(pictures_of(bag.scan), FRAMES)
    np.testing.assert_allclose(bag.scan.times.time_s - START_NS / 1e9, FRAME_TIMES_S, atol=1e-6)
    np.testing.assert_allclose(bag.log.time_s - START_NS / 1e9, FORCE_TIMES_S, atol=1e-6)
    assert bag.log.columns == ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
    np.testing.assert_allclose(bag.log.wrench_sc[7], [7.0, 0.5, -0.007, 0.25, 0.0, 1.0])
    assert bag.scan.times.source == "header.stamp of /oct/image"


@pytest.mark.parametrize("packed", ["FILE", "MESSAGE"])
def test_packed_bags_are_read(tmp_path: Path, packed: str) -> None:
    path = write_bag(tmp_path / "a", "sqlite", packed=CompressionMode[packed])
    np.testing.assert_array_equal(pictures_of(read_bag(path, BagTopics()).scan), FRAMES)


def test_how_late_messages_arrived_is_said(tmp_path: Path) -> None:
    notes = read_bag(write_bag(tmp_path / "a", "sqlite"), BagTopics()).notes
    assert "/oct/image: messages arrived 80.0 ms (median; 80.0 to 80.0) after their stamp" in notes[0]
    assert "/ft/wrench: messages arrived 1.0 ms" in notes[1]
    assert not any("clock" in note for note in notes)


@pytest.mark.parametrize("shift_s", [-5.0, 0.002])
def test_a_clock_that_is_not_the_bags_is_told(tmp_path: Path, shift_s: float) -> None:
    images = [Messages(ROS2).image(START_NS + round(shift_s * 1e9) + nth, FRAMES[nth]) for nth in range(3)]
    assert "its clock is not that of the bag" in read_bag(bag_of(tmp_path / "a", images), BagTopics()).notes[0]


@pytest.mark.parametrize(("kind", "pattern"), [("sqlite", "*.db3"), ("mcap", "*.mcap")])
def test_a_storage_file_without_its_metadata_is_read_too(tmp_path: Path, kind: str, pattern: str) -> None:
    path = next(write_bag(tmp_path / "a", kind).glob(pattern)).rename(tmp_path / f"lone.{pattern[2:]}")
    np.testing.assert_array_equal(pictures_of(read_bag(path, BagTopics()).scan), FRAMES)


def test_of_several_topics_one_is_chosen_by_name(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", "mcap", topics=("/a", "/b"))
    with pytest.raises(UnansweredError, match=r"which topic\? There are /a, /b; give --image-topic"):
        read_bag(path, BagTopics())
    assert read_bag(path, BagTopics(image="/b")).scan.times.source == "header.stamp of /b"
    with pytest.raises(InputError, match=r"--image-topic: no topic /c of sensor_msgs.*; .*/ft/wrench \(geometry_msgs"):
        read_bag(path, BagTopics(image="/c"))


def test_stamps_that_are_empty_are_asked_about(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a", "sqlite", stamped=False)
    with pytest.raises(UnansweredError, match=r"header\.stamp is 0.*give --by-arrival"):
        read_bag(path, BagTopics())
    bag = read_bag(path, BagTopics(by_arrival=True))
    np.testing.assert_allclose(bag.scan.times.time_s - START_NS / 1e9, np.array(FRAME_TIMES_S) + LATE_S, atol=1e-6)
    assert bag.scan.times.source == "arrival of /oct/image"


def test_a_clock_may_begin_at_zero(tmp_path: Path) -> None:
    images = [Messages(ROS2).image(nth * 10**8, FRAMES[nth]) for nth in range(3)]
    scan = read_bag(bag_of(tmp_path / "a", images), BagTopics()).scan
    np.testing.assert_allclose(scan.times.time_s, [0.0, 0.1, 0.2])
    with pytest.raises(UnansweredError, match="--by-arrival"):
        read_bag(bag_of(tmp_path / "b", images[:1]), BagTopics())


def test_a_bag_with_images_alone_has_no_log(tmp_path: Path) -> None:
    assert read_bag(write_bag(tmp_path / "a", "mcap", forces=False), BagTopics()).log is None


def bag_of(path: Path, messages: list, kind: str = "sensor_msgs/msg/Image") -> Path:
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/image", kind, typestore=ROS2)
        for nth, message in enumerate(messages):
            writer.write(connection, START_NS + nth, ROS2.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize("encoding", ["mono8", "rgb8", "bgr8", "rgba8", "bgra8", "16SC1", "32FC1"])
@pytest.mark.parametrize("big", [False, True])
def test_encodings_become_grey(tmp_path: Path, encoding: str, big: bool) -> None:
    grey = (FRAMES[1] % 256).astype(np.uint8)
    colour = np.dstack([grey, grey // 2, 255 - grey, grey])
    given = {
        "mono8": grey, "rgb8": colour[..., :3], "bgr8": colour[..., :3], "rgba8": colour, "bgra8": colour,
        "16SC1": grey.astype(np.int16) - 9, "32FC1": grey / np.float32(7.0),
    }[encoding]  # fmt: skip
    expected = given if given.ndim == 2 else cv2.cvtColor(given, getattr(cv2, f"COLOR_{encoding[:-1].upper()}2GRAY"))
    message = Messages(ROS2).image(START_NS, given, encoding, big=big)
    bag = read_bag(bag_of(tmp_path / "a", [message]), BagTopics())
    np.testing.assert_array_equal(pictures_of(bag.scan)[0], expected)
    assert bag.scan.bits == (8 if expected.dtype == np.uint8 else None)


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_compressed_images_are_decoded(tmp_path: Path, ending: str) -> None:
    grey = np.linspace(0, 255, ROWS * COLUMNS).reshape(ROWS, COLUMNS).astype(np.uint8)
    data = cv2.imencode(ending, grey)[1].ravel()
    kind = "sensor_msgs/msg/CompressedImage"
    message = ROS2.types[kind](header=Messages(ROS2).header(START_NS), format=ending[1:], data=data)
    bag = read_bag(bag_of(tmp_path / "a", [message], kind), BagTopics())
    np.testing.assert_allclose(pictures_of(bag.scan)[0], grey, atol=0 if ending == ".png" else 3)


def test_an_encoding_that_is_not_read_and_too_little_data_are_refused(tmp_path: Path) -> None:
    image = Messages(ROS2).image(START_NS, FRAMES[0])
    image.encoding = "bayer_rggb8"
    with pytest.raises(FrameError, match="/image: encoding 'bayer_rggb8'; one of mono8"):
        read_bag(bag_of(tmp_path / "a", [image]), BagTopics())
    image = Messages(ROS2).image(START_NS, FRAMES[0])
    image.height += 1
    with pytest.raises(FrameError, match=r"/image: damaged: .* bytes for 25 rows of 86"):
        read_bag(bag_of(tmp_path / "b", [image]), BagTopics())


def test_stamps_that_run_backward_are_refused(tmp_path: Path) -> None:
    images = [Messages(ROS2).image(START_NS + shift, FRAMES[0]) for shift in (5, 3)]
    with pytest.raises(RecordingError, match="/image: its stamps do not run forward"):
        read_bag(bag_of(tmp_path / "a", images), BagTopics())


def test_a_bag_without_images_and_forces_lists_what_it_has(tmp_path: Path) -> None:
    text = ROS2.types["std_msgs/msg/String"]("hello")
    with pytest.raises(
        InputError, match=r"neither a topic of images.*nor of forces.*there are /image \(std_msgs/msg/String\)"
    ):
        read_bag(bag_of(tmp_path / "a", [text], "std_msgs/msg/String"), BagTopics())


@pytest.mark.parametrize("name", ["a.bag", "a.db3", "a.mcap"])
def test_a_damaged_bag_is_named(tmp_path: Path, name: str) -> None:
    marks = {"a.bag": b"#ROSBAG V2.0\n", "a.db3": b"SQLite format 3\0", "a.mcap": b"\x89MCAP0\r\n"}
    (tmp_path / name).write_bytes(marks[name] + bytes(1000))
    with pytest.raises(FrameError, match=f"{name}: damaged"):
        read_bag(tmp_path / name, BagTopics())


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-logs")
def test_a_real_bag_without_definitions_gives_its_forces() -> None:
    bag = read_bag(REAL, BagTopics())
    assert bag.scan is None
    assert bag.log.columns == ("fx_n", "fy_n", "fz_n")
    assert len(bag.log.time_s) == 1655
    assert bag.log.sample_rate_hz == pytest.approx(30.0, rel=0.05)
