"""Bags in parts, MCAP of ROS 1 and Foxglove, cut files, and OME-Zarr."""

import json
import os
from base64 import b64encode
from pathlib import Path

import cv2
import numpy as np
import pytest
import zarr
from foreign_files import (
    COLUMNS,
    COUNT,
    DEPTH_M,
    FRAMES,
    LATERAL_M,
    ROWS,
    pictures_of,
    sizes_of,
)

from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.picture_streams import UnansweredError
from scleraforce.recordings.import_sources import (
    ImportOptions,
    gather_sources,
    source_kind,
)

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import DESCRIPTOR as TIMESTAMP
from mcap.writer import Writer
from ros_bag import (
    FORCE_TIMES_S,
    FRAME_TIMES_S,
    ROS1,
    SECOND_NS,
    START_NS,
    Messages,
    stamps,
    write_bag,
    write_parts,
)

SECOND_S = START_NS / 1e9


# ---- parts


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
@pytest.mark.parametrize("by_files", [False, True])
def test_parts_of_a_bag_are_one_recording(tmp_path, kind, by_files):
    folder = write_parts(tmp_path / "bag", kind)
    sources = sorted(folder.iterdir(), reverse=True) if by_files else [folder]
    found = gather_sources(sources, ImportOptions())
    np.testing.assert_array_equal(pictures_of(found.scan), FRAMES)
    np.testing.assert_allclose(
        found.scan.times.time_s - SECOND_S, FRAME_TIMES_S, atol=1e-6
    )
    np.testing.assert_allclose(found.log.time_s - SECOND_S, FORCE_TIMES_S, atol=1e-6)
    assert found.log.force_n("fx").tolist() == [*range(len(FORCE_TIMES_S))]
    assert found.one_clock


def test_bags_of_two_recordings_and_parts_with_one_missing_are_refused(
    tmp_path,
):
    parts = sorted(write_parts(tmp_path / "p", "sqlite").iterdir())
    whole = write_bag(tmp_path / "whole", "sqlite")
    with pytest.raises(
        InputError, match=r"its forces begin before those of .* end: an"
    ):
        gather_sources([*parts, whole], ImportOptions())

    apart = write_parts(tmp_path / "q", "mcap", (0.0, 0.1, 2.3, 9.0))
    with pytest.raises(
        InputError, match=r"bag_2\.mcap: its forces begin 2\.2\d* s after"
    ):
        gather_sources([apart / "bag_0.mcap", apart / "bag_2.mcap"], ImportOptions())


def test_images_and_forces_of_two_bags_are_not_on_one_clock(tmp_path):
    images = write_bag(tmp_path / "images", "sqlite", forces=False)
    forces = write_bag(tmp_path / "forces", "sqlite", topics=())
    assert not gather_sources([images, forces], ImportOptions()).one_clock


# ---- MCAP


def write_mcap(path: Path, profile: str, channels) -> Path:
    """Write channels of (topic, encoding, schema's name, encoding and data,
    messages).
    """
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=profile, library="test")
        for topic, encoding, name, kind, data, messages in channels:
            schema = writer.register_schema(name=name, encoding=kind, data=data)
            channel = writer.register_channel(
                topic=topic, message_encoding=encoding, schema_id=schema
            )
            for time_ns, content in messages:
                writer.add_message(
                    channel_id=channel,
                    log_time=time_ns,
                    data=content,
                    publish_time=time_ns,
                )
        writer.finish()
    return path


def ros1_mcap(path: Path) -> Path:
    messages = Messages(ROS1)
    sent = {
        "sensor_msgs/msg/Image": [
            messages.image(t, f)
            for t, f in zip(stamps(FRAME_TIMES_S), FRAMES, strict=True)
        ],
        "geometry_msgs/msg/WrenchStamped": [
            messages.wrench(t, [n, 0, 0, 0, 0, 0])
            for n, t in enumerate(stamps(FORCE_TIMES_S))
        ],
    }
    channels = []
    for topic, (name, content), times_s in zip(
        ("/oct", "/ft"), sent.items(), (FRAME_TIMES_S, FORCE_TIMES_S), strict=True
    ):
        text, _ = ROS1.generate_msgdef(name)
        packed = [bytes(ROS1.serialize_ros1(each, name)) for each in content]
        channels.append(
            (
                topic,
                "ros1",
                name.replace("/msg", ""),
                "ros1msg",
                text.encode(),
                zip(stamps(times_s), packed, strict=True),
            )
        )
    return write_mcap(path, "ros1", channels)


def png(frame: np.ndarray) -> bytes:
    return cv2.imencode(".png", frame)[1].tobytes()


def json_mcap(
    path: Path, raw: bool = False, seconds: tuple[str, str] = ("sec", "nsec")
) -> Path:
    def image(time_ns: int, frame: np.ndarray) -> bytes:
        stamp = dict(zip(seconds, divmod(time_ns, SECOND_NS), strict=True))
        fields = {"timestamp": stamp, "frame_id": "oct"}
        own = (
            {
                "encoding": "mono16",
                "width": COLUMNS,
                "height": ROWS,
                "step": 2 * COLUMNS,
            }
            if raw
            else {"format": "png"}
        )
        data = frame.astype("<u2").tobytes() if raw else png(frame)
        return json.dumps({**fields, **own, "data": b64encode(data).decode()}).encode()

    def wrench(time_ns: int, force_n: float) -> bytes:
        stamp = dict(zip(seconds, divmod(time_ns, SECOND_NS), strict=True))
        vectors = {name: dict.fromkeys("xyz", force_n) for name in ("force", "torque")}
        return json.dumps({"timestamp": stamp, **vectors}).encode()

    times = [*zip(stamps(FRAME_TIMES_S), FRAMES, strict=True)]
    forces = [*zip(stamps(FORCE_TIMES_S), range(len(FORCE_TIMES_S)), strict=True)]
    name = "foxglove.RawImage" if raw else "foxglove.CompressedImage"
    return write_mcap(
        path,
        "",
        [
            (
                "/oct",
                "json",
                name,
                "jsonschema",
                b"{}",
                [(t, image(t, f)) for t, f in times],
            ),
            (
                "/ft",
                "json",
                "Wrench",
                "jsonschema",
                b"{}",
                [(t, wrench(t, n)) for t, n in forces],
            ),
        ],
    )


def protobuf_mcap(path: Path) -> Path:
    file = FileDescriptorProto(
        name="foxglove/CompressedImage.proto", package="foxglove", syntax="proto3"
    )
    file.dependency.append("google/protobuf/timestamp.proto")
    message = file.message_type.add(name="CompressedImage")
    kinds = FieldDescriptorProto
    for nth, (name, kind) in enumerate(
        (
            ("timestamp", kinds.TYPE_MESSAGE),
            ("frame_id", kinds.TYPE_STRING),
            ("data", kinds.TYPE_BYTES),
            ("format", kinds.TYPE_STRING),
        ),
        start=1,
    ):
        field = message.field.add(
            name=name, number=nth, type=kind, label=kinds.LABEL_OPTIONAL
        )
        if kind == kinds.TYPE_MESSAGE:
            field.type_name = ".google.protobuf.Timestamp"

    stamp = FileDescriptorProto()
    TIMESTAMP.CopyToProto(stamp)
    pool = DescriptorPool()
    pool.Add(stamp)
    pool.Add(file)
    made = GetMessageClass(pool.FindMessageTypeByName("foxglove.CompressedImage"))
    packed = []
    for time_ns, frame in zip(stamps(FRAME_TIMES_S), FRAMES, strict=True):
        one = made(frame_id="oct", data=png(frame), format="png")
        one.timestamp.seconds, one.timestamp.nanos = divmod(time_ns, SECOND_NS)
        packed.append((time_ns, one.SerializeToString()))

    data = FileDescriptorSet(file=[stamp, file]).SerializeToString()
    return write_mcap(
        path,
        "",
        [("/oct", "protobuf", "foxglove.CompressedImage", "protobuf", data, packed)],
    )


@pytest.mark.parametrize(
    ("write", "forces"),
    [
        (ros1_mcap, True),
        (json_mcap, True),
        (lambda path: json_mcap(path, raw=True), True),
        (lambda path: json_mcap(path, seconds=("seconds", "nanos")), True),
        (protobuf_mcap, False),
    ],
)
def test_mcap_of_ros_1_and_foxglove_is_read(tmp_path, write, forces):
    path = write(tmp_path / "a.mcap")
    assert source_kind(path) == "bag"
    found = gather_sources([path], ImportOptions())
    np.testing.assert_array_equal(pictures_of(found.scan), FRAMES)
    np.testing.assert_allclose(
        found.scan.times.time_s - SECOND_S, FRAME_TIMES_S, atol=1e-6
    )
    assert (found.log is not None) == forces
    if forces:
        np.testing.assert_allclose(
            found.log.time_s - SECOND_S, FORCE_TIMES_S, atol=1e-6
        )
        assert found.log.force_n("fx").tolist() == [*range(len(FORCE_TIMES_S))]


def test_a_damaged_bag_is_named_with_the_way_to_what_is_left(tmp_path):
    for kind, name, way in (
        ("ros1", "bag_0.bag", "rosbag reindex bag_0"),
        ("sqlite", "bag_0.db3", "sqlite3 bag_0"),
    ):
        path = write_parts(tmp_path / kind, kind, (0.0, 9.0)) / name
        path.write_bytes(path.read_bytes()[:-30000])
        with pytest.raises(InputError, match=rf"{path.name}: .*`{way}"):
            gather_sources([path], ImportOptions())


def test_mcap_that_is_not_read_is_named(tmp_path):
    cut = json_mcap(tmp_path / "cut.mcap")
    cut.write_bytes(cut.read_bytes()[:-500])
    with pytest.raises(
        InputError, match=r"cut\.mcap: its end is missing.*`mcap recover cut\.mcap"
    ):
        gather_sources([cut], ImportOptions())

    other = write_mcap(
        tmp_path / "b.mcap",
        "",
        [("/oct", "flatbuffer", "foxglove.RawImage", "flatbuffer", b"", [(1, b"x")])],
    )
    with pytest.raises(
        InputError, match=r"b\.mcap: .*/oct \(foxglove\.RawImage \(flatbuffer\)\)"
    ):
        gather_sources([other], ImportOptions())


# ---- Zarr


def write_ome(path: Path, axes: str, frames: np.ndarray, version: int = 2) -> Path:
    """Write an image of these axes; the step is that of `foreign_files`, and 0.25 s."""
    names = {"t": "time", "c": "channel"}
    units = {"t": "second", "z": "micrometer", "y": "micrometer", "x": "micrometer"}
    steps = {"t": 0.25, "c": 1.0, "z": 5.0, "y": 1e6 * DEPTH_M, "x": 1e6 * LATERAL_M}
    stated = [
        {
            "name": n,
            "type": names.get(n, "space"),
            **({"unit": units[n]} if n in units else {}),
        }
        for n in axes
    ]
    scale = {"type": "scale", "scale": [steps[name] for name in axes]}
    image = {
        "version": "0.4",
        "axes": stated,
        "datasets": [{"path": "0", "coordinateTransformations": [scale]}],
    }
    group = zarr.open_group(path, mode="w", zarr_format=version)
    group.create_array("0", data=frames)
    group.attrs.update(
        {"multiscales": [image]}
        if version == 2
        else {"ome": {"version": "0.5", "multiscales": [image]}}
    )
    return path


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("axes", ["tyx", "tczyx"])
def test_a_folder_of_ome_zarr_gives_frames_scale_and_times(tmp_path, version, axes):
    frames = FRAMES if axes == "tyx" else FRAMES[:, np.newaxis, np.newaxis]
    path = write_ome(tmp_path / "a.zarr", axes, frames, version)
    assert source_kind(path) == "zarr"
    scan = gather_sources([path], ImportOptions()).scan
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert sizes_of(scan) == pytest.approx((DEPTH_M, LATERAL_M))
    assert scan.times.time_s.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_an_image_of_bioformats2raw_and_a_plain_array_are_read(tmp_path):
    zarr.open_group(tmp_path / "b.zarr", mode="w", zarr_format=2).attrs[
        "bioformats2raw.layout"
    ] = 3
    write_ome(tmp_path / "b.zarr" / "0", "tyx", FRAMES)
    assert (
        len(gather_sources([tmp_path / "b.zarr"], ImportOptions()).scan.names) == COUNT
    )
    write_ome(tmp_path / "b.zarr" / "1", "tyx", FRAMES)
    with pytest.raises(InputError, match=r"b\.zarr: 2 images \(0, 1\); import one"):
        gather_sources([tmp_path / "b.zarr"], ImportOptions())

    zarr.save_array(tmp_path / "c.zarr", FRAMES)
    with pytest.raises(UnansweredError, match="`axes`"):
        gather_sources([tmp_path / "c.zarr"], ImportOptions())
    named = ImportOptions(axes="frame,depth,lateral")
    np.testing.assert_array_equal(
        pictures_of(gather_sources([tmp_path / "c.zarr"], named).scan), FRAMES
    )


def test_zarr_that_has_no_frames_is_named(tmp_path):
    zarr.open_group(tmp_path / "g.zarr", mode="w").create_array("walls", data=FRAMES)
    both = np.zeros((2, 3, ROWS, COLUMNS), np.uint8)
    for path, words in (
        (tmp_path / "g.zarr", "without multiscales, .* it has walls"),
        (
            write_ome(tmp_path / "z.zarr", "zyx", FRAMES),
            r"OME-Zarr states 5 slices \(z\)",
        ),
        (
            write_ome(tmp_path / "k.zarr", "cyx", FRAMES),
            r"OME-Zarr states 5 channels \(c\)",
        ),
        (write_ome(tmp_path / "t.zarr", "tzyx", both), "axes t 2, z 3"),
        (
            write_ome(tmp_path / "x.zarr", "txy", FRAMES),
            "axes t, x, y",
        ),
    ):
        with pytest.raises(InputError, match=words) as caught:
            gather_sources([path], ImportOptions(rate_hz=1.0))
        assert str(path) in str(caught.value)

    damaged = write_ome(tmp_path / "d.zarr", "tyx", FRAMES)
    os.remove(damaged / "0" / ".zarray")
    with pytest.raises(InputError, match=r"d\.zarr: "):
        gather_sources([damaged], ImportOptions())
