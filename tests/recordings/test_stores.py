"""Bags in parts, MCAP of ROS 1 and Foxglove, cut files, and OME-Zarr."""

import json
import os
from base64 import b64encode
from functools import partial

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
    SIZES_M,
    check_scan,
)

from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.picture_streams import UnansweredError
from scleraforce.recordings.import_sources import (
    ImportOptions,
    gather_sources,
    source_kind,
)

pytest.importorskip("rosbags")
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.json_format import ParseDict
from google.protobuf.message_factory import GetMessages
from google.protobuf.timestamp_pb2 import DESCRIPTOR as TIMESTAMP
from ros_bag import (
    FORCE_TIMES_S,
    FRAME_TIMES_S,
    ROS1,
    SECOND_NS,
    START_NS,
    Messages,
    stamps,
    write_bag,
    write_mcap,
    write_parts,
)

START_S = START_NS / 1e9


def gathered(*sources, **options):
    return gather_sources(sources, ImportOptions(**options))


def check_forces(log):
    np.testing.assert_allclose(log.time_s - START_S, FORCE_TIMES_S, atol=1e-6)
    assert log.force_n("fx").tolist() == [*range(len(FORCE_TIMES_S))]


# ---- parts


@pytest.mark.parametrize("kind", ["ros1", "sqlite", "mcap"])
@pytest.mark.parametrize("by_files", [False, True])
def test_parts_of_a_bag_are_one_recording(tmp_path, kind, by_files):
    folder = write_parts(tmp_path / "bag", kind)
    sources = sorted(folder.iterdir(), reverse=True) if by_files else [folder]
    found = gathered(*sources)
    check_scan(found.scan, time_s=np.add(START_S, FRAME_TIMES_S))
    check_forces(found.log)
    assert found.one_clock


def test_bags_of_two_recordings_and_parts_with_one_missing_are_refused(tmp_path):
    parts = sorted(write_parts(tmp_path / "p", "sqlite").iterdir())
    whole = write_bag(tmp_path / "whole", "sqlite")
    before = r"its forces begin before those of .* end: an"
    with pytest.raises(InputError, match=before):
        gathered(*parts, whole)

    apart = write_parts(tmp_path / "q", "mcap", (0.0, 0.1, 2.3, 9.0))
    after = r"bag_2\.mcap: its forces begin 2\.2\d* s after"
    with pytest.raises(InputError, match=after):
        gathered(apart / "bag_0.mcap", apart / "bag_2.mcap")


def test_images_and_forces_of_two_bags_are_not_on_one_clock(tmp_path):
    images = write_bag(tmp_path / "images", "sqlite", forces=False)
    forces = write_bag(tmp_path / "forces", "sqlite", topics=())
    assert not gathered(images, forces).one_clock


# ---- MCAP

IMAGES = [*zip(stamps(FRAME_TIMES_S), FRAMES, strict=True)]
FORCES = [*zip(stamps(FORCE_TIMES_S), range(len(FORCE_TIMES_S)), strict=True)]


def ros1_mcap(path):
    messages = Messages(ROS1)
    names = ("sensor_msgs/msg/Image", "geometry_msgs/msg/WrenchStamped")
    channels = [
        (
            topic,
            "ros1",
            name.replace("/msg", ""),
            "ros1msg",
            ROS1.generate_msgdef(name)[0].encode(),
        )
        for topic, name in zip(("/oct", "/ft"), names, strict=True)
    ]
    sent = [(0, at, messages.image(at, frame)) for at, frame in IMAGES]
    sent += [(1, at, messages.wrench(at, [n, 0, 0, 0, 0, 0])) for at, n in FORCES]
    packed = [
        (channel, at, bytes(ROS1.serialize_ros1(message, names[channel])))
        for channel, at, message in sent
    ]
    return write_mcap(path, "ros1", channels, packed)


def png(frame):
    return cv2.imencode(".png", frame)[1].tobytes()


RAW = {"encoding": "mono16", "width": COLUMNS, "height": ROWS, "step": 2 * COLUMNS}


def json_mcap(path, raw=False, seconds=("sec", "nsec")):
    def packed(time_ns, **fields):
        stamp = dict(zip(seconds, divmod(time_ns, SECOND_NS), strict=True))
        return json.dumps({"timestamp": stamp, **fields}).encode()

    messages = []
    for at, frame in IMAGES:
        data = frame.astype("<u2").tobytes() if raw else png(frame)
        fields = RAW if raw else {"format": "png"}
        image = packed(at, frame_id="oct", data=b64encode(data).decode(), **fields)
        messages.append((0, at, image))

    for at, force_n in FORCES:
        vector = dict.fromkeys("xyz", force_n)
        messages.append((1, at, packed(at, force=vector, torque=vector)))

    name = "foxglove.RawImage" if raw else "foxglove.CompressedImage"
    channels = [
        ("/oct", "json", name, "jsonschema", b"{}"),
        ("/ft", "json", "Wrench", "jsonschema", b"{}"),
    ]
    return write_mcap(path, "", channels, messages)


FIELDS = {
    "timestamp": {"type": "TYPE_MESSAGE", "typeName": ".google.protobuf.Timestamp"},
    "frame_id": {"type": "TYPE_STRING"},
    "data": {"type": "TYPE_BYTES"},
    "format": {"type": "TYPE_STRING"},
}
SCHEMA = {
    "name": "foxglove/CompressedImage.proto",
    "package": "foxglove",
    "syntax": "proto3",
    "dependency": ["google/protobuf/timestamp.proto"],
    "messageType": [
        {
            "name": "CompressedImage",
            "field": [
                {"name": name, "number": nth, "label": "LABEL_OPTIONAL", **kind}
                for nth, (name, kind) in enumerate(FIELDS.items(), start=1)
            ],
        }
    ],
}


def protobuf_mcap(path):
    name = "foxglove.CompressedImage"
    stamp = FileDescriptorProto()
    TIMESTAMP.CopyToProto(stamp)
    files = [stamp, ParseDict(SCHEMA, FileDescriptorProto())]
    image = GetMessages(files)[name]
    messages = []
    for at, frame in IMAGES:
        message = image(frame_id="oct", data=png(frame), format="png")
        message.timestamp.seconds, message.timestamp.nanos = divmod(at, SECOND_NS)
        messages.append((0, at, message.SerializeToString()))

    schema = FileDescriptorSet(file=files).SerializeToString()
    channels = [("/oct", "protobuf", name, "protobuf", schema)]
    return write_mcap(path, "", channels, messages)


@pytest.mark.parametrize(
    "write",
    [
        ros1_mcap,
        json_mcap,
        partial(json_mcap, raw=True),
        partial(json_mcap, seconds=("seconds", "nanos")),
        protobuf_mcap,
    ],
)
def test_mcap_of_ros_1_and_foxglove_is_read(tmp_path, write):
    path = write(tmp_path / "a.mcap")
    assert source_kind(path) == "bag"
    found = gathered(path)
    check_scan(found.scan, time_s=np.add(START_S, FRAME_TIMES_S))
    if write is protobuf_mcap:
        assert found.log is None
    else:
        check_forces(found.log)


@pytest.mark.parametrize(
    ("kind", "name", "way"),
    [
        ("ros1", "bag_0.bag", "rosbag reindex bag_0"),
        ("sqlite", "bag_0.db3", "sqlite3 bag_0"),
    ],
)
def test_a_damaged_bag_is_named_with_the_way_to_what_is_left(tmp_path, kind, name, way):
    path = write_parts(tmp_path / kind, kind, (0.0, 9.0)) / name
    path.write_bytes(path.read_bytes()[:-30000])
    with pytest.raises(InputError, match=rf"{name}: .*`{way}"):
        gathered(path)


def test_mcap_that_is_not_read_is_named(tmp_path):
    cut = json_mcap(tmp_path / "cut.mcap")
    cut.write_bytes(cut.read_bytes()[:-500])
    recovered = r"cut\.mcap: its end is missing.*`mcap recover cut\.mcap"
    with pytest.raises(InputError, match=recovered):
        gathered(cut)

    channels = [("/oct", "flatbuffer", "foxglove.RawImage", "flatbuffer", b"")]
    other = write_mcap(tmp_path / "b.mcap", "", channels, [(0, 1, b"x")])
    unknown = r"b\.mcap: .*/oct \(foxglove\.RawImage \(flatbuffer\)\)"
    with pytest.raises(InputError, match=unknown):
        gathered(other)


# ---- Zarr

UNITS = {"t": "second", "z": "micrometer", "y": "micrometer", "x": "micrometer"}
STEPS = {"t": 0.25, "c": 1.0, "z": 5.0, "y": 1e6 * DEPTH_M, "x": 1e6 * LATERAL_M}
TYPES = {"t": "time", "c": "channel"}


def write_ome(path, axes, frames=FRAMES, version=2):
    """Write an image of these axes; the step is that of `foreign_files`, and 0.25 s."""
    stated = [{"name": axis, "type": TYPES.get(axis, "space")} for axis in axes]
    for axis in stated:
        if axis["name"] in UNITS:
            axis["unit"] = UNITS[axis["name"]]

    scale = {"type": "scale", "scale": [STEPS[axis] for axis in axes]}
    dataset = {"path": "0", "coordinateTransformations": [scale]}
    image = {"version": "0.4", "axes": stated, "datasets": [dataset]}
    group = zarr.open_group(path, mode="w", zarr_format=version)
    group.create_array("0", data=frames)
    multiscales = {"multiscales": [image]}
    group.attrs.update(
        multiscales if version == 2 else {"ome": {"version": "0.5", **multiscales}}
    )
    return path


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("axes", ["tyx", "tczyx"])
def test_a_folder_of_ome_zarr_gives_frames_scale_and_times(tmp_path, version, axes):
    frames = FRAMES if axes == "tyx" else FRAMES[:, np.newaxis, np.newaxis]
    path = write_ome(tmp_path / "a.zarr", axes, frames, version)
    assert source_kind(path) == "zarr"
    check_scan(gathered(path).scan, FRAMES, SIZES_M, 0.25 * np.arange(COUNT))


def test_an_image_of_bioformats2raw_is_read(tmp_path):
    folder = tmp_path / "b.zarr"
    group = zarr.open_group(folder, mode="w", zarr_format=2)
    group.attrs["bioformats2raw.layout"] = 3
    write_ome(folder / "0", "tyx")
    check_scan(gathered(folder).scan)
    write_ome(folder / "1", "tyx")
    with pytest.raises(InputError, match=r"b\.zarr: 2 images \(0, 1\); import one"):
        gathered(folder)


def test_the_axes_of_a_plain_array_are_asked_for(tmp_path):
    zarr.save_array(tmp_path / "c.zarr", FRAMES)
    with pytest.raises(UnansweredError, match="`axes`"):
        gathered(tmp_path / "c.zarr")
    check_scan(gathered(tmp_path / "c.zarr", axes="frame,depth,lateral").scan)


def write_group(path):
    zarr.open_group(path, mode="w").create_array("walls", data=FRAMES)


def write_damaged(path):
    os.remove(write_ome(path, "tyx") / "0" / ".zarray")


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (write_group, "without multiscales, .* it has walls"),
        (write_damaged, ""),
        (partial(write_ome, axes="zyx"), r"OME-Zarr states 5 slices \(z\)"),
        (partial(write_ome, axes="cyx"), r"OME-Zarr states 5 channels \(c\)"),
        (
            partial(write_ome, axes="tzyx", frames=np.stack([FRAMES[:3]] * 2)),
            "axes t 2, z 3",
        ),
        (partial(write_ome, axes="txy"), "axes t, x, y"),
    ],
)
def test_zarr_that_has_no_frames_is_named(tmp_path, write, words):
    path = tmp_path / "a.zarr"
    write(path)
    with pytest.raises(InputError, match=rf"a\.zarr: .*{words}"):
        gathered(path, rate_hz=1.0)
