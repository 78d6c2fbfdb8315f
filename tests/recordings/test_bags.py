"""ROS bags of both generations, written by rosbags and read by their capture stamps."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from foreign_files import COLUMNS, FRAMES, ROWS, check_scan, pictures_of

from scleraforce.base.errors import FrameError, InputError, RecordingError
from scleraforce.recordings.formats.picture_streams import UnansweredError, joined_files
from scleraforce.recordings.formats.ros_bags import read_bag
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS

pytest.importorskip("rosbags")
from ros_bag import (
    FORCE_TIMES_S,
    FRAME_TIMES_S,
    LATE_S,
    ROS1,
    ROS2,
    START_NS,
    Messages,
    write_bag,
    write_mcap,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode

REAL = Path(__file__).parents[3] / "shared" / "real-logs" / "ros2-wrench.db3"

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
WRENCH = "geometry_msgs/msg/WrenchStamped"
MS_NS = 10**6
START_S = START_NS / 1e9
HERE = Messages(ROS2)
MAKERS = {"ros1": Messages(ROS1), "mcap": HERE}


@pytest.mark.parametrize(
    ("kind", "packed"),
    [
        ("ros1", None),
        ("sqlite", None),
        ("mcap", None),
        ("sqlite", CompressionMode.FILE),
        ("sqlite", CompressionMode.MESSAGE),
    ],
)
def test_frames_and_forces_come_back_by_their_capture_stamps(tmp_path, kind, packed):
    path = tmp_path / ("a.bag" if kind == "ros1" else "a")
    scan, log = read_bag(write_bag(path, kind, packed=packed))
    check_scan(scan, time_s=np.add(START_S, FRAME_TIMES_S))
    since_s = log.time_s - START_S
    np.testing.assert_allclose(since_s, FORCE_TIMES_S, atol=1e-6)
    np.testing.assert_allclose(log.wrench_sc[7], [7.0, 0.5, -0.007, 0.25, 0.0, 1.0])
    assert scan.times.source == "header.stamp of /oct/image"
    assert log.columns == FORCE_COLUMNS[1:]
    late = r"/oct/image: messages arrived 80.0 ms \(median; 80.0 to 80.0\) after their"
    notes = " ".join((*scan.notes, *log.notes))
    assert re.search(f"{late} stamp.*/ft/wrench: messages arrived 1.0 ms", notes)
    assert "clock" not in notes


@pytest.mark.parametrize("shift_s", [-5.0, 0.002])
def test_a_clock_other_than_the_clock_of_the_bag_is_noted(tmp_path, shift_s):
    begin_ns = START_NS + round(shift_s * 1e9)
    images = [HERE.image(begin_ns + nth, FRAMES[nth]) for nth in range(3)]
    scan, _ = read_bag(bag_of(tmp_path, images))
    assert "its clock is not that of the bag" in scan.notes[0]


def test_of_several_topics_one_is_chosen_by_name(tmp_path):
    path = write_bag(tmp_path / "a", "mcap", topics=("/a", "/b"))
    asked = r"which topic\? There are /a, /b; give `image_topic`"
    with pytest.raises(UnansweredError, match=asked):
        read_bag(path)

    assert read_bag(path, image_topic="/b")[0].times.source == "header.stamp of /b"
    unknown = r"`image_topic`: no topic /c of sensor_msgs.*; .*/ft/wrench \(geometry"
    with pytest.raises(InputError, match=unknown):
        read_bag(path, image_topic="/c")


def test_empty_stamps_are_asked_about(tmp_path):
    path = write_bag(tmp_path / "a", "sqlite", stamped=False)
    with pytest.raises(UnansweredError, match=r"header\.stamp is 0.*give `by_arrival`"):
        read_bag(path)

    scan, _ = read_bag(path, by_arrival=True)
    check_scan(scan, time_s=np.add(START_S + LATE_S, FRAME_TIMES_S))
    assert scan.times.source == "arrival of /oct/image"


@pytest.mark.parametrize("empty", [(0,), (2,), (1, 3)])
def test_single_empty_stamps_are_asked_about(tmp_path, empty):
    sent = [
        (0, at, HERE.image(0 if nth in empty else at, FRAMES[nth]), IMAGE)
        for nth, at in enumerate(START_NS + nth * 100 * MS_NS for nth in range(5))
    ]
    path = write_topic(tmp_path / "a", "mcap", sent)
    asked = rf"/t: {len(empty)} of 5 messages are without .*`by_arrival`"
    with pytest.raises(UnansweredError, match=asked):
        read_bag(path)
    check_scan(read_bag(path, by_arrival=True)[0])


def test_a_clock_may_begin_at_zero(tmp_path):
    images = [HERE.image(nth * 100 * MS_NS, FRAMES[nth]) for nth in range(3)]
    scan, _ = read_bag(bag_of(tmp_path, images))
    np.testing.assert_allclose(scan.times.time_s, [0.0, 0.1, 0.2])
    with pytest.raises(UnansweredError, match="`by_arrival`"):
        read_bag(bag_of(tmp_path, images[:1]))


def bag_of(folder, messages, kind=IMAGE):
    sent = [(0, START_NS + nth, each, kind) for nth, each in enumerate(messages)]
    return write_topic(folder / "a", "mcap", sent)


BYTES = (FRAMES[1] % 256).astype(np.uint8)
COLOUR = np.dstack([BYTES, BYTES // 2, 255 - BYTES, BYTES])


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize(
    ("encoding", "pixels", "grey"),
    [
        ("mono8", BYTES, None),
        ("rgb8", COLOUR[..., :3], cv2.COLOR_RGB2GRAY),
        ("bgr8", COLOUR[..., :3], cv2.COLOR_BGR2GRAY),
        ("rgba8", COLOUR, cv2.COLOR_RGBA2GRAY),
        ("bgra8", COLOUR, cv2.COLOR_BGRA2GRAY),
        ("16SC1", BYTES.astype(np.int16) - 9, None),
        ("32FC1", BYTES / np.float32(7.0), None),
    ],
)
def test_encodings_become_grey(tmp_path, encoding, pixels, grey, big):
    expected = pixels if grey is None else cv2.cvtColor(pixels, grey)
    message = HERE.image(START_NS, pixels, encoding, big=big)
    scan, _ = read_bag(bag_of(tmp_path, [message]))
    check_scan(scan, expected[None])
    assert scan.bits == (8 if expected.dtype == np.uint8 else None)


def compressed(folder, *images, ending=".png"):
    kind = ROS2.types[COMPRESSED]
    messages = [
        kind(
            header=HERE.header(START_NS + nth),
            format=ending[1:],
            data=cv2.imencode(ending, image)[1].ravel(),
        )
        for nth, image in enumerate(images)
    ]
    return read_bag(bag_of(folder, messages, COMPRESSED))[0]


RAMP = np.linspace(0, 255, ROWS * COLUMNS).reshape(ROWS, COLUMNS).astype(np.uint8)


@pytest.mark.parametrize(("ending", "atol"), [(".png", 0), (".jpg", 3)])
def test_compressed_images_are_decoded(tmp_path, ending, atol):
    scan = compressed(tmp_path, RAMP, ending=ending)
    np.testing.assert_allclose(pictures_of(scan)[0], RAMP, atol=atol)


def test_compressed_images_of_two_depths_are_damage(tmp_path):
    scan = joined_files([compressed(tmp_path, FRAMES[0], FRAMES[1], RAMP)])
    damage = r"/t\[0\]: damaged: a frame of .* uint8, number 3, is not stated"
    with pytest.raises(FrameError, match=damage):
        pictures_of(scan)


STRING = "std_msgs/msg/String"
FIRST = HERE.image(START_NS, FRAMES[0])


@pytest.mark.parametrize(
    ("sent", "kind", "found"),
    [
        (
            replace(FIRST, encoding="bayer_rggb8"),
            IMAGE,
            "/t: encoding 'bayer_rggb8'; one of mono8",
        ),
        (
            replace(FIRST, height=ROWS + 1),
            IMAGE,
            "/t: damaged: .* bytes for 25 rows of 86",
        ),
        (
            ROS2.types[STRING]("hello"),
            STRING,
            rf"a topic of images.*nor of forces.*there are /t \({STRING}\)",
        ),
    ],
)
def test_images_that_cannot_be_read_are_refused(tmp_path, sent, kind, found):
    with pytest.raises(InputError, match=found):
        read_bag(bag_of(tmp_path, [sent], kind))


def write_topic(path, kind, sent, definitions=None):
    """Write a bag of one topic from (publisher, arrival in ns, message, type)."""
    types = {who: name for who, _, _, name in sent}
    if kind == "ros1":
        path = path.with_suffix(".bag")
        with Writer1(path) as writer:
            channels = {
                who: writer.add_connection(
                    "/t", name, typestore=ROS1, callerid=f"/p{who}"
                )
                for who, name in types.items()
            }
            for who, arrived_ns, message, name in sent:
                data = ROS1.serialize_ros1(message, name)
                writer.write(channels[who], arrived_ns, data)
        return path

    path = path.with_suffix(".mcap")
    texts = definitions or [
        ROS2.generate_msgdef(name, ros_version=2)[0] for name in types.values()
    ]
    channels = [
        ("/t", "cdr", name, "ros2msg", text.encode())
        for name, text in zip(types.values(), texts, strict=True)
    ]
    messages = [
        ([*types].index(who), arrived_ns, bytes(ROS2.serialize_cdr(message, name)))
        for who, arrived_ns, message, name in sent
    ]
    return write_mcap(path, "ros2", channels, messages)


@pytest.mark.parametrize("kind", MAKERS)
def test_forces_of_two_publishers_in_turns_are_sorted_by_stamp(tmp_path, kind):
    """The second publisher's messages take 12 ms longer than the next ones of the
    first.
    """
    sent = []
    for nth in range(40):
        at = START_NS + nth * 5 * MS_NS
        arrived = at + (13 if nth % 2 else 1) * MS_NS
        wrench = MAKERS[kind].wrench(at, [nth] + [0] * 5)
        sent.append((nth % 2, arrived, wrench, WRENCH))

    sent.sort(key=lambda each: each[1])
    _, log = read_bag(write_topic(tmp_path / "a", kind, sent))
    np.testing.assert_array_equal(log.wrench_sc[:, 0], np.arange(40))
    expected_s = START_S + np.arange(40) * 0.005
    np.testing.assert_allclose(log.time_s, expected_s, rtol=0, atol=1e-6)
    noted = "2 publishers, with 20 and 20 messages.*sorted by stamp"
    assert re.search(noted, " ".join(log.notes))


def test_frames_that_arrive_late_come_in_their_turn(tmp_path):
    sent = []
    for nth, late_ms in ((1, 10), (0, 130), (3, 10), (2, 130), (4, 10)):
        at = START_NS + nth * 100 * MS_NS
        sent.append((0, at + late_ms * MS_NS, HERE.image(at, FRAMES[nth]), IMAGE))

    scan = read_bag(write_topic(tmp_path / "a", "mcap", sent))[0]
    check_scan(scan)
    places = [name.rpartition("[")[2] for name in scan.names]
    assert places == ["1]", "0]", "3]", "2]", "4]"]


STAMPS_NS = [START_NS + nth * 100 * MS_NS for nth in range(4)]


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("shift_s", [-3600, 7])
def test_a_topic_of_two_clocks_is_refused(tmp_path, kind, shift_s):
    sent = []
    for nth, at in enumerate(STAMPS_NS):
        stamp_ns = at + shift_s * 10**9 * (nth > 1)
        image = MAKERS[kind].image(stamp_ns, FRAMES[nth])
        sent.append((nth > 1, at + MS_NS, image, IMAGE))

    apart = r"/t: its publishers are not on one clock: .* 1 ms .* and "
    with pytest.raises(RecordingError, match=apart):
        read_bag(write_topic(tmp_path / "a", kind, sent))


@pytest.mark.parametrize("kind", MAKERS)
def test_a_topic_of_two_coordinate_frames_or_types_is_refused(tmp_path, kind):
    maker = MAKERS[kind]
    sent = [
        (nth == 3, at, maker.wrench(at, [nth] * 6), WRENCH)
        for nth, at in enumerate(STAMPS_NS)
    ]
    sent[3][2].header.frame_id = "tool0"
    frames = r"/t: header\.frame_id is 'oct' in message 0 and 'tool0' in message 3"
    with pytest.raises(InputError, match=frames):
        read_bag(write_topic(tmp_path / "a", kind, sent))

    vector = maker.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
    name = "geometry_msgs/msg/Vector3Stamped"
    other = maker.types[name](header=maker.header(START_NS + 5), vector=vector)
    types = [sent[0], (1, START_NS + 5, other, name)]
    found = "/t: messages of two types, .*WrenchStamped and .*Vector3Stamped"
    with pytest.raises(InputError, match=found):
        read_bag(write_topic(tmp_path / "b", kind, types))


def test_a_topic_of_two_definitions_is_refused_unless_they_mean_the_same(tmp_path):
    text = ROS2.generate_msgdef(WRENCH, ros_version=2)[0]
    sent = [
        (nth, START_NS + nth, HERE.wrench(START_NS + nth, [nth] * 6), WRENCH)
        for nth in range(2)
    ]
    other = [text, text.replace("Vector3 torque", "Vector3 moment")]
    with pytest.raises(InputError, match=rf"/t: two definitions of {WRENCH}"):
        read_bag(write_topic(tmp_path / "a", "mcap", sent, other))

    _, log = read_bag(write_topic(tmp_path / "b", "mcap", sent, [text, f"# 2\n{text}"]))
    assert len(log.time_s) == 2


@pytest.mark.parametrize("back_ms", [40, 300, 3000])
def test_a_clock_that_is_set_back_is_refused_with_both_stamps(tmp_path, back_ms):
    sent = []
    for nth in range(100):
        at = START_NS + nth * 5 * MS_NS
        wrench = HERE.wrench(at - back_ms * MS_NS * (nth >= 60), [nth] * 6)
        sent.append((0, at + nth % 3 * MS_NS, wrench, WRENCH))

    found = "/t: its stamps do not run forward: message 59 is of .* message 60 is of "
    with pytest.raises(RecordingError, match=found):
        read_bag(write_topic(tmp_path / "a", "mcap", sent))


def with_one_stamp_twice(path, last):
    places = enumerate([(0, 0), (1, 1), (2, 2), (last, 2)])
    sent = [
        (nth == 3, START_NS + nth, HERE.image(STAMPS_NS[at], FRAMES[which]), IMAGE)
        for nth, (which, at) in places
    ]
    return read_bag(write_topic(path, "mcap", sent))[0]


def test_messages_of_one_stamp_are_left_out_if_they_are_equal_and_else_refused(
    tmp_path,
):
    scan = with_one_stamp_twice(tmp_path / "a", 2)
    check_scan(scan, FRAMES[:3])
    assert "1 messages repeat another's stamp and content" in " ".join(scan.notes)
    differ = r"/t: its stamps .* messages 2 and 3 differ and have one stamp"
    with pytest.raises(RecordingError, match=differ):
        with_one_stamp_twice(tmp_path / "b", 4)


@pytest.mark.parametrize(
    ("field", "last"),
    [
        ("encoding", HERE.image(START_NS + 3, BYTES, "mono8", padding=46)),
        ("is_bigendian", HERE.image(START_NS + 3, FRAMES[3], big=True)),
        ("height", HERE.image(START_NS + 3, FRAMES[3][:-1])),
        ("width", HERE.image(START_NS + 3, FRAMES[3][:, :-1], padding=8)),
        ("step", HERE.image(START_NS + 3, FRAMES[3], padding=8)),
    ],
)
def test_images_that_change_within_a_topic_are_refused(tmp_path, field, last):
    images = [HERE.image(START_NS + nth, FRAMES[nth]) for nth in range(3)]
    before, after = (getattr(image, field) for image in (images[0], last))
    found = f"/t: {field} is {before!r} in message 0 and {after!r} in message 3"
    with pytest.raises(FrameError, match=found):
        read_bag(bag_of(tmp_path, [*images, last]))


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-logs")
def test_a_real_bag_without_definitions_gives_its_forces():
    scan, log = read_bag(REAL)
    assert scan is None
    assert log.columns == ("fx_n", "fy_n", "fz_n")
    assert len(log.time_s) == 1655
    assert log.sample_rate_hz == pytest.approx(30.0, rel=0.05)
