"""ROS bags of both generations, written by rosbags and read by their capture stamps."""

import re
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pytest
from foreign_files import COLUMNS, FRAMES, ROWS, pictures_of

from scleraforce.base.errors import FrameError, InputError, RecordingError
from scleraforce.recordings.formats.picture_streams import UnansweredError, joined_files
from scleraforce.recordings.formats.ros_bags import read_bag
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
from mcap.writer import Writer as McapWriter
from ros_bag import (
    FORCE_TIMES_S,
    FRAME_TIMES_S,
    LATE_S,
    ROS1,
    ROS2,
    START_NS,
    Messages,
    write_bag,
)
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode

REAL = Path(__file__).parents[3] / "shared" / "real-logs" / "ros2-wrench.db3"

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
WRENCH = "geometry_msgs/msg/WrenchStamped"
MS_NS = 10**6
HERE = Messages(ROS2)
MAKERS = {"ros1": Messages(ROS1), "mcap": HERE}


def test_frames_and_forces_come_back_by_their_capture_stamps(tmp_path):
    for kind, packed in [
        ("ros1", None),
        ("sqlite", None),
        ("mcap", None),
        ("sqlite", "FILE"),
        ("sqlite", "MESSAGE"),
    ]:
        place = Path(mkdtemp(dir=tmp_path)) / ("a.bag" if kind == "ros1" else "a")
        scan, log = read_bag(
            write_bag(place, kind, packed=packed and CompressionMode[packed])
        )
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        np.testing.assert_allclose(
            scan.times.time_s - START_NS / 1e9, FRAME_TIMES_S, atol=1e-6
        )
        np.testing.assert_allclose(
            log.time_s - START_NS / 1e9, FORCE_TIMES_S, atol=1e-6
        )
        np.testing.assert_allclose(log.wrench_sc[7], [7.0, 0.5, -0.007, 0.25, 0.0, 1.0])
        assert (scan.times.source, log.columns) == (
            "header.stamp of /oct/image",
            FORCE_COLUMNS[1:],
        )
        notes = " ".join((*scan.notes, *log.notes))
        late = (
            r"/oct/image: messages arrived 80.0 ms \(median; 80.0 to 80.0\) after their"
            r" stamp"
        )
        assert re.search(rf"{late}.*/ft/wrench: messages arrived 1.0 ms", notes)
        assert "clock" not in notes

    for kind, ending in [
        ("sqlite", "db3"),
        ("mcap", "mcap"),
    ]:  # a storage file without its metadata
        place = Path(mkdtemp(dir=tmp_path))
        path = next(
            write_bag(place / "a", kind, forces=False).glob(f"*.{ending}")
        ).rename(place / f"lone.{ending}")
        scan, log = read_bag(path)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert log is None


def test_a_clock_other_than_the_clock_of_the_bag_is_noted(tmp_path):
    for shift_s in (-5.0, 0.002):
        images = [
            HERE.image(START_NS + round(shift_s * 1e9) + at, FRAMES[at])
            for at in range(3)
        ]
        assert (
            "its clock is not that of the bag"
            in read_bag(bag_of(tmp_path, images))[0].notes[0]
        )


def test_of_several_topics_one_is_chosen_by_name(tmp_path):
    path = write_bag(tmp_path / "a", "mcap", topics=("/a", "/b"))
    with pytest.raises(
        UnansweredError, match=r"which topic\? There are /a, /b; give `image_topic`"
    ):
        read_bag(path)

    assert read_bag(path, image_topic="/b")[0].times.source == "header.stamp of /b"
    with pytest.raises(
        InputError,
        match=(
            r"`image_topic`: no topic /c of sensor_msgs.*; .*/ft/wrench \(geometry_msgs"
        ),
    ):
        read_bag(path, image_topic="/c")


def test_empty_stamps_are_asked_about_unless_the_clock_begins_at_zero(
    tmp_path,
):
    path = write_bag(tmp_path / "a", "sqlite", stamped=False)
    with pytest.raises(UnansweredError, match=r"header\.stamp is 0.*give `by_arrival`"):
        read_bag(path)

    scan, _ = read_bag(path, by_arrival=True)
    np.testing.assert_allclose(
        scan.times.time_s - START_NS / 1e9, np.array(FRAME_TIMES_S) + LATE_S, atol=1e-6
    )
    assert scan.times.source == "arrival of /oct/image"

    for empty in [(0,), (2,), (1, 3)]:
        stamps_ns = [START_NS + nth * 10**8 for nth in range(5)]
        images = [
            HERE.image(0 if nth in empty else at, FRAMES[nth])
            for nth, at in enumerate(stamps_ns)
        ]
        path = write_topic(
            tmp_path,
            "mcap",
            [(0, at, each, IMAGE) for at, each in zip(stamps_ns, images, strict=True)],
        )

        with pytest.raises(
            UnansweredError,
            match=rf"/t: {len(empty)} of 5 messages are without .*`by_arrival`",
        ):
            read_bag(path)

        np.testing.assert_array_equal(
            pictures_of(read_bag(path, by_arrival=True)[0]), FRAMES
        )

    images = [HERE.image(nth * 10**8, FRAMES[nth]) for nth in range(3)]
    np.testing.assert_allclose(
        read_bag(bag_of(tmp_path, images))[0].times.time_s, [0.0, 0.1, 0.2]
    )

    with pytest.raises(UnansweredError, match="`by_arrival`"):
        read_bag(bag_of(tmp_path, images[:1]))


def bag_of(folder: Path, messages: list, kind: str = IMAGE) -> Path:
    return write_topic(
        folder,
        "mcap",
        [(0, START_NS + nth, message, kind) for nth, message in enumerate(messages)],
    )


def test_encodings_become_grey(tmp_path):
    grey = (FRAMES[1] % 256).astype(np.uint8)
    colour = np.dstack([grey, grey // 2, 255 - grey, grey])
    given = {
        "mono8": grey,
        "rgb8": colour[..., :3],
        "bgr8": colour[..., :3],
        "rgba8": colour,
        "bgra8": colour,
        "16SC1": grey.astype(np.int16) - 9,
        "32FC1": grey / np.float32(7.0),
    }

    for (encoding, pixels), big in product(given.items(), (False, True)):
        expected = pixels
        if pixels.ndim == 3:
            expected = cv2.cvtColor(
                pixels, getattr(cv2, f"COLOR_{encoding[:-1].upper()}2GRAY")
            )

        message = HERE.image(START_NS, pixels, encoding, big=big)
        scan, _ = read_bag(bag_of(tmp_path, [message]))
        np.testing.assert_array_equal(pictures_of(scan)[0], expected)
        assert scan.bits == (8 if expected.dtype == np.uint8 else None)


def test_compressed_images_are_decoded_and_keep_their_depth(tmp_path):
    def sent(*images: np.ndarray, ending: str = ".png") -> Path:
        packed = [
            {"format": ending[1:], "data": cv2.imencode(ending, image)[1].ravel()}
            for image in images
        ]
        kind = ROS2.types[COMPRESSED]
        messages = [
            kind(header=HERE.header(START_NS + nth), **fields)
            for nth, fields in enumerate(packed)
        ]

        return bag_of(tmp_path, messages, COMPRESSED)

    grey = np.linspace(0, 255, ROWS * COLUMNS).reshape(ROWS, COLUMNS).astype(np.uint8)
    for ending, atol in [(".png", 0), (".jpg", 3)]:
        np.testing.assert_allclose(
            pictures_of(read_bag(sent(grey, ending=ending))[0])[0], grey, atol=atol
        )

    scan, _ = read_bag(sent(FRAMES[0], FRAMES[1], grey))
    with pytest.raises(
        FrameError,
        match=r"/t\[0\]: damaged: a frame of .* uint8, number 3, is not stated",
    ):
        pictures_of(joined_files([scan]))


def test_images_that_cannot_be_read_are_refused(tmp_path):
    text = "std_msgs/msg/String"
    image = HERE.image(START_NS, FRAMES[0])

    for sent, kind, found in [
        (
            replace(image, encoding="bayer_rggb8"),
            IMAGE,
            "/t: encoding 'bayer_rggb8'; one of mono8",
        ),
        (
            replace(image, height=ROWS + 1),
            IMAGE,
            r"/t: damaged: .* bytes for 25 rows of 86",
        ),
        (
            ROS2.types[text]("hello"),
            text,
            rf"a topic of images.*nor of forces.*there are /t \({text}\)",
        ),
    ]:
        with pytest.raises(InputError, match=found):
            read_bag(bag_of(tmp_path, [sent], kind))


def write_topic(
    folder: Path, kind: str, sent: list, definitions: list[str] | None = None
) -> Path:
    """Write a bag of one topic from (publisher, arrival in ns, message, type)."""
    path = Path(mkdtemp(dir=folder)) / "a"
    kinds = {publisher: name for publisher, _, _, name in sent}

    if kind == "ros1":
        with Writer1(path) as writer:
            own = {who: {"typestore": ROS1, "callerid": f"/p{who}"} for who in kinds}
            channels = {
                who: writer.add_connection("/t", name, **own[who])
                for who, name in kinds.items()
            }

            for who, arrived_ns, message, name in sent:
                writer.write(
                    channels[who], arrived_ns, ROS1.serialize_ros1(message, name)
                )

        return path.rename(path.with_suffix(".bag"))

    with path.open("wb") as file:
        writer = McapWriter(file)
        channels = {}
        writer.start(profile="ros2")

        for who, name in kinds.items():
            text = (
                definitions[who]
                if definitions
                else ROS2.generate_msgdef(name, ros_version=2)[0]
            )
            schema = writer.register_schema(name, "ros2msg", text.encode())
            channels[who] = writer.register_channel(
                "/t", "cdr", schema, {"publisher": str(who)}
            )

        for who, arrived_ns, message, name in sent:
            writer.add_message(
                channels[who],
                arrived_ns,
                bytes(ROS2.serialize_cdr(message, name)),
                arrived_ns,
            )

        writer.finish()

    return path.rename(path.with_suffix(".mcap"))


def test_forces_of_two_publishers_in_turns_are_sorted_by_stamp(tmp_path):
    """The second publisher's messages take 12 ms longer than the next ones of the
    first.
    """
    for kind, maker in MAKERS.items():
        stamps_ns = [START_NS + nth * 5 * MS_NS for nth in range(40)]
        sent = [
            (
                nth % 2,
                at + (13 if nth % 2 else 1) * MS_NS,
                maker.wrench(at, [nth] + [0] * 5),
                WRENCH,
            )
            for nth, at in enumerate(stamps_ns)
        ]
        _, log = read_bag(
            write_topic(tmp_path, kind, sorted(sent, key=lambda each: each[1]))
        )
        np.testing.assert_array_equal(log.wrench_sc[:, 0], np.arange(40))
        np.testing.assert_allclose(
            log.time_s - START_NS / 1e9, np.arange(40) * 0.005, atol=1e-6
        )
        assert re.search(
            "2 publishers, with 20 and 20 messages.*sorted by stamp",
            " ".join(log.notes),
        )


def test_frames_that_arrive_late_come_in_their_turn(tmp_path):
    sent = [
        (
            0,
            START_NS + (nth * 100 + late_ms) * MS_NS,
            HERE.image(START_NS + nth * 10**8, FRAMES[nth]),
            IMAGE,
        )
        for nth, late_ms in ((1, 10), (0, 130), (3, 10), (2, 130), (4, 10))
    ]
    scan = read_bag(write_topic(tmp_path, "mcap", sent))[0]
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert [name.rpartition("[")[2] for name in scan.names] == [
        "1]",
        "0]",
        "3]",
        "2]",
        "4]",
    ]


def test_a_topic_of_two_clocks_coordinate_frames_types_or_definitions_is_refused(
    tmp_path,
):
    stamps_ns = [START_NS + nth * 10**8 for nth in range(4)]
    for kind, maker in MAKERS.items():
        for shift_s in [-3600, 7]:
            sent = [
                (
                    nth > 1,
                    at + MS_NS,
                    maker.image(at + (shift_s * 10**9 if nth > 1 else 0), FRAMES[nth]),
                    IMAGE,
                )
                for nth, at in enumerate(stamps_ns)
            ]
            with pytest.raises(
                RecordingError,
                match=r"/t: its publishers are not on one clock: .* 1 ms .* and ",
            ):
                read_bag(write_topic(tmp_path, kind, sent))

        sent = [
            (nth == 3, at, maker.wrench(at, [nth] * 6), WRENCH)
            for nth, at in enumerate(stamps_ns)
        ]
        sent[3][2].header.frame_id = "tool0"

        with pytest.raises(
            InputError,
            match=(
                r"/t: header\.frame_id is 'oct' in message 0 and 'tool0' in message 3"
            ),
        ):
            read_bag(write_topic(tmp_path, kind, sent))

        vector = maker.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
        name = "geometry_msgs/msg/Vector3Stamped"
        other = maker.types[name](header=maker.header(START_NS + 5), vector=vector)

        with pytest.raises(
            InputError,
            match=r"/t: messages of two types, .*WrenchStamped and .*Vector3Stamped",
        ):
            read_bag(
                write_topic(tmp_path, kind, [sent[0], (1, START_NS + 5, other, name)])
            )

    text = ROS2.generate_msgdef(WRENCH, ros_version=2)[0]
    sent = [
        (nth, START_NS + nth, HERE.wrench(START_NS + nth, [nth] * 6), WRENCH)
        for nth in range(2)
    ]

    with pytest.raises(InputError, match=rf"/t: two definitions of {WRENCH}"):
        read_bag(
            write_topic(
                tmp_path,
                "mcap",
                sent,
                [text, text.replace("Vector3 torque", "Vector3 moment")],
            )
        )

    assert (
        len(
            read_bag(write_topic(tmp_path, "mcap", sent, [text, f"# 2\n{text}"]))[
                1
            ].time_s
        )
        == 2
    )


def test_a_clock_that_is_set_back_is_refused_with_both_stamps(tmp_path):
    for back_ms in [40, 300, 3000]:
        arrived_ns = [START_NS + nth * 5 * MS_NS for nth in range(100)]
        stamps_ns = [
            at - (back_ms * MS_NS if nth >= 60 else 0)
            for nth, at in enumerate(arrived_ns)
        ]
        sent = [
            (0, arrived_ns[nth] + nth % 3 * MS_NS, HERE.wrench(at, [nth] * 6), WRENCH)
            for nth, at in enumerate(stamps_ns)
        ]
        found = (
            r"/t: its stamps do not run forward: message 59 is of .* message 60 is of "
        )

        with pytest.raises(RecordingError, match=found):
            read_bag(write_topic(tmp_path, "mcap", sent))


def test_messages_of_one_stamp_are_left_out_if_they_are_equal_and_else_refused(
    tmp_path,
):
    def sent(last: int) -> list:
        return [
            (
                nth == 3,
                START_NS + nth,
                HERE.image(START_NS + at * 10**8, FRAMES[which]),
                IMAGE,
            )
            for nth, (which, at) in enumerate([(0, 0), (1, 1), (2, 2), (last, 2)])
        ]

    scan, _ = read_bag(write_topic(tmp_path, "mcap", sent(2)))
    np.testing.assert_array_equal(pictures_of(scan), FRAMES[:3])
    assert any(
        "1 messages repeat another's stamp and content" in note for note in scan.notes
    )

    with pytest.raises(
        RecordingError,
        match=r"/t: its stamps .* messages 2 and 3 differ and have one stamp",
    ):
        read_bag(write_topic(tmp_path, "mcap", sent(4)))


def test_images_that_change_within_a_topic_are_refused(tmp_path):
    at = START_NS + 3
    grey = (FRAMES[3] % 256).astype(np.uint8)

    for field, other in {
        "encoding": HERE.image(at, grey, "mono8", padding=46),
        "is_bigendian": HERE.image(at, FRAMES[3], big=True),
        "height": HERE.image(at, FRAMES[3][:-1]),
        "width": HERE.image(at, FRAMES[3][:, :-1], padding=8),
        "step": HERE.image(at, FRAMES[3], padding=8),
    }.items():
        images = [HERE.image(START_NS + nth, FRAMES[nth]) for nth in range(3)] + [other]
        first, last = (getattr(image, field) for image in (images[0], images[3]))

        with pytest.raises(
            FrameError,
            match=rf"/t: {field} is {first!r} in message 0 and {last!r} in message 3",
        ):
            read_bag(bag_of(tmp_path, images))


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-logs")
def test_a_real_bag_without_definitions_gives_its_forces():
    scan, log = read_bag(REAL)
    assert scan is None
    assert log.columns == ("fx_n", "fy_n", "fz_n")
    assert len(log.time_s) == 1655
    assert log.sample_rate_hz == pytest.approx(30.0, rel=0.05)
