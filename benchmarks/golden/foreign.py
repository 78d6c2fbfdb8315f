"""Files of other programs as a user brings them: the same five small frames, and a
push, in each format.
"""

import csv
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import cv2
import numpy as np

ROWS, COLUMNS, COUNT = 24, 40, 5
FRAMES = np.arange(COUNT * ROWS * COLUMNS, dtype=np.uint16).reshape(
    COUNT, ROWS, COLUMNS
)
DEPTH_M, WIDTH_M = 0.096e-3, 0.6e-3
STEP_MM = (WIDTH_M / COLUMNS * 1e3, DEPTH_M / ROWS * 1e3, 0.1)
SIZE = {"width_m": WIDTH_M, "depth_m": DEPTH_M}
RATE = {"rate_hz": 2.0}
VOLUME = {"axes": "frame,depth,lateral"}
FASTEST_FIRST = {"axes": "lateral,depth,frame"}
SECOND_NS = 10**9
START_NS = 1_700_000_000 * SECOND_NS
FRAME_TIMES_S = (0.5, 0.75, 1.0, 1.5, 2.25)
LATE_NS = 80_000_000  # after which images arrive; forces arrive after 1 ms

UNPACKED = (cv2.IMWRITE_TIFF_COMPRESSION, 1)

Make = Callable[[Path], list[Path]]


@dataclass(frozen=True)
class Source:
    """Files that `make` writes into a folder, and the arguments that an import of them
    needs.
    """

    make: Make
    arguments: Mapping[str, Any] = field(default_factory=dict)


def pushes(rate_hz: float = 200.0, seconds: float = 4.0) -> tuple[Any, Any]:
    """Return times in s and forces in N of a push to 20 mN that begins after 1 s;
    contact is negative.
    """
    time_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    return time_s, -0.02 * np.clip(2.0 * (time_s - 1.0), 0.0, 1.0)


def _one(name: str, write: Callable[[Path], object]) -> Make:
    """Return what makes a single file of a name."""

    def make(folder: Path) -> list[Path]:
        write(folder / name)
        return [folder / name]

    return make


def _pictures(folder: Path, ending: str, frames: Any = FRAMES) -> list[Path]:
    paths = [folder / f"scan-{number:02}{ending}" for number in range(len(frames))]
    options = UNPACKED if ending == ".tif" else ()
    for path, pixels in zip(paths, frames, strict=True):
        assert cv2.imwrite(str(path), pixels, options)
    return paths


def _film(path: Path, code: str) -> None:
    levels = np.array((20, 60, 100, 140, 180), np.uint8)
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*code), 12.5, (96, 64)
    )
    if not writer.isOpened():
        raise RuntimeError(f"OpenCV cannot write {code} here")
    for level in levels:
        writer.write(np.full((64, 96, 3), level, np.uint8))
    writer.release()


def _dicom(path: Path, pixels: Any, compressed: bool = False, **tags: Any) -> None:
    dataset_module, uid = import_module("pydicom.dataset"), import_module("pydicom.uid")
    meta = dataset_module.FileMetaDataset()
    meta.MediaStorageSOPClassUID = uid.SecondaryCaptureImageStorage
    meta.MediaStorageSOPInstanceUID = "1.2.3"
    meta.TransferSyntaxUID = uid.ExplicitVRLittleEndian
    image = dataset_module.FileDataset(path, {}, file_meta=meta, preamble=b"\0" * 128)
    bits = 8 * pixels.dtype.itemsize
    image.Rows, image.Columns = pixels.shape[-2:]
    image.SamplesPerPixel = 1
    image.PhotometricInterpretation = "MONOCHROME2"
    image.BitsAllocated = bits
    image.BitsStored = bits
    image.HighBit = bits - 1
    image.PixelRepresentation = 0
    if pixels.ndim == 3:
        image.NumberOfFrames = len(pixels)
    image.PixelData = pixels.tobytes()
    for name, value in tags.items():
        setattr(image, name, value)
    if compressed:
        image.compress(uid.RLELossless)
    image.save_as(path)


def _tiff(path: Path, **options: Any) -> None:
    import_module("tifffile").imwrite(path, FRAMES, **options)


def _imagej(path: Path) -> None:
    resolution = (1e-6 * COLUMNS / WIDTH_M, 1e-6 * ROWS / DEPTH_M)
    metadata = {"axes": "TYX", "unit": "um", "finterval": 0.5}
    _tiff(path, imagej=True, resolution=resolution, metadata=metadata)


def _ome(path: Path) -> None:
    metadata = {
        "axes": "TYX",
        "PhysicalSizeX": STEP_MM[0],
        "PhysicalSizeXUnit": "mm",
        "PhysicalSizeY": STEP_MM[1],
        "PhysicalSizeYUnit": "mm",
        "TimeIncrement": 0.5,
        "TimeIncrementUnit": "s",
    }
    _tiff(path, metadata=metadata, photometric="minisblack")


def _nifti(path: Path, in_time: bool = False) -> None:
    nibabel = import_module("nibabel")
    volume = np.ascontiguousarray(FRAMES.T)
    volume = volume[:, :, np.newaxis] if in_time else volume
    image = nibabel.Nifti1Image(volume, np.eye(4))
    image.header.set_xyzt_units("mm", "sec")
    image.header.set_zooms((*STEP_MM, 0.5) if in_time else STEP_MM)
    nibabel.save(image, path)


def _nrrd(path: Path) -> None:
    nrrd = import_module("nrrd")
    header = {"space dimension": 3, "space directions": np.diag(STEP_MM)}
    header |= {"space units": ["mm", "mm", "mm"]}
    nrrd.write(str(path), FRAMES.T, header, index_order="F")


def _metaimage(path: Path) -> None:
    metaimageio = import_module("metaimageio")
    metaimageio.write(path, FRAMES, ElementSpacing=list(STEP_MM), CompressedData=True)


def _thorlabs(path: Path) -> None:
    sizes = f'SizeZ="{ROWS}" SizeX="{COLUMNS}" SizeY="{COUNT}"'
    ranges = 'RangeZ="0.096" RangeX="0.6" RangeY="1"'
    name = "data\\Intensity.data"
    entry = (
        f'<DataFile Type="Real" {sizes} {ranges} BytesPerPixel="4">{name}</DataFile>'
    )
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        header = f"<Ocity><DataFiles>{entry}</DataFiles></Ocity>"
        archive.writestr("Header.xml", f'<?xml version="1.0"?>{header}')
        pixels = np.asarray(FRAMES, dtype="<f4").swapaxes(1, 2)
        archive.writestr(name, pixels.tobytes())


def _bag(kind: str, packed: str | None = None) -> Make:
    """Return what makes a ROS bag of five frames that arrive late, and a wrench at 200
    Hz.
    """

    def make(folder: Path) -> list[Path]:
        path = folder / ("scan.bag" if kind == "ros1" else "scan")
        _write_bag(path, kind, packed)
        return [path]

    return make


def _write_bag(path: Path, kind: str, packed: str | None) -> None:
    typesys = import_module("rosbags.typesys")
    one = kind == "ros1"
    stores = typesys.Stores
    store = typesys.get_typestore(stores.ROS1_NOETIC if one else stores.ROS2_HUMBLE)
    module = import_module("rosbags.rosbag1" if one else "rosbags.rosbag2")
    if one:
        writer = module.Writer(path)
    else:
        plugin = module.StoragePlugin[{"sqlite": "SQLITE3", "mcap": "MCAP"}[kind]]
        writer = module.Writer(path, version=9, storage_plugin=plugin)
    if packed is not None:
        way = module.CompressionMode[packed]
        writer.set_compression(way, module.CompressionFormat.ZSTD)

    sent = []
    for time_s, pixels in zip(FRAME_TIMES_S, FRAMES, strict=True):
        stamp_ns = START_NS + round(time_s * SECOND_NS)
        image = _image_message(store, stamp_ns, pixels)
        arrived_ns = stamp_ns + LATE_NS
        sent.append((arrived_ns, "/oct/image", "sensor_msgs/msg/Image", image))
    for time_s, force_n in zip(*pushes(), strict=True):
        stamp_ns = START_NS + round(time_s * SECOND_NS)
        wrench = _wrench_message(store, stamp_ns, force_n)
        kind_name = "geometry_msgs/msg/WrenchStamped"
        sent.append((stamp_ns + 1_000_000, "/ft/wrench", kind_name, wrench))
    serialize = store.serialize_ros1 if one else store.serialize_cdr
    with writer:
        connections = {
            topic: writer.add_connection(topic, name, typestore=store)
            for topic, name in {topic: name for _, topic, name, _ in sent}.items()
        }
        for arrived_ns, topic, name, message in sorted(sent, key=lambda each: each[0]):
            data = serialize(message, name)
            writer.write(connections[topic], arrived_ns, data)


def _header(store: Any, stamp_ns: int) -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](
        stamp_ns // SECOND_NS, stamp_ns % SECOND_NS
    )
    kind = store.types["std_msgs/msg/Header"]
    counted = {"seq": 0} if "seq" in kind.__dataclass_fields__ else {}
    return kind(**counted, stamp=stamp, frame_id="oct")


def _image_message(store: Any, stamp_ns: int, pixels: Any) -> Any:
    return store.types["sensor_msgs/msg/Image"](
        header=_header(store, stamp_ns),
        height=ROWS,
        width=COLUMNS,
        encoding="mono16",
        is_bigendian=0,
        step=2 * COLUMNS,
        data=np.ascontiguousarray(pixels).view(np.uint8).ravel(),
    )


def _wrench_message(store: Any, stamp_ns: int, force_n: float) -> Any:
    vector = store.types["geometry_msgs/msg/Vector3"]
    wrench = store.types["geometry_msgs/msg/Wrench"](
        force=vector(0.0, 0.0, float(force_n)), torque=vector(0.0, 0.0, 0.0)
    )
    kind = store.types["geometry_msgs/msg/WrenchStamped"]
    return kind(header=_header(store, stamp_ns), wrench=wrench)


def _log(header: str, row: Callable[[float, float], str], above: str = "") -> Make:
    """Return what makes pictures and a force log of a header, and of a row for each
    time in s and force in N.
    """

    def make(folder: Path) -> list[Path]:
        lines = [
            row(time_s, force_n) for time_s, force_n in zip(*pushes(), strict=True)
        ]
        text = "\n".join([*filter(None, [above, header]), *lines, ""])
        (folder / "log.csv").write_text(text, encoding="utf-8")
        return [*_pictures(folder, ".png"), folder / "log.csv"]

    return make


def _labview(time_s: float, force_n: float) -> str:
    return f"{time_s:.3f}\t{force_n:.6f}\t0.5".replace(".", ",")


LABVIEW_HEADER = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t,
Multi_Headings\tNo
X_Columns\tOne
Time_Pref\tRelative
***End_of_Header***\t
\t
Channels\t2\t
Samples\t800\t800
Y_Unit_Label\tNewtons\tVolts
X_Dimension\tTime\tTime
***End_of_Header***\t\t"""
ATI_HEADER = """Start Time: 8/3/26 2:15 PM
RDT Sample Rate: 200
Force Units: mN
Counts per Unit Force: 1000.0
Torque Units: Nmm
Counts per Unit Torque: 2000.0"""


def _ati(time_s: float, force_n: float) -> str:
    number = round(200 * time_s)
    counts = round(1e6 * force_n)
    status = "0x80020000" if number == 500 else "0x0"
    values = [
        status,
        str(4097 + number),
        str(number),
        "0",
        "0",
        str(counts),
        "0",
        "0",
        "0",
    ]
    file = io.StringIO()
    csv.writer(file, quoting=csv.QUOTE_ALL).writerow(
        [*values, "Aug 3, 2026 2:15:07 PM"]
    )
    return file.getvalue().strip()


def _planes(folder: Path) -> list[Path]:
    places = [folder / "along", folder / "across"]
    for number, place in enumerate(places):
        place.mkdir()
        _pictures(place, ".png", FRAMES + number)
    return places


def _ros_topic(time_s: float, force_n: float) -> str:
    stamp_ns = START_NS + round(time_s * SECOND_NS)
    return f"{stamp_ns},1,{stamp_ns},ft,0,0,{force_n:.6f},0,0,0"


ROS_TOPIC_NAMES = (
    "header.seq",
    "header.stamp",
    "header.frame_id",
    "wrench.force.x",
    "wrench.force.y",
    "wrench.force.z",
    "wrench.torque.x",
    "wrench.torque.y",
    "wrench.torque.z",
)
LOG = {
    **SIZE,
    **RATE,
    "clock_offset_s": 0.0,
    "contact_sign": -1,
    "average_s": 0.1,
}
LOG_OF_AXES = {**LOG, "axis": "fz"}
BYTES = (FRAMES % 251).astype(np.uint8)

SOURCES: Mapping[str, Source] = {
    "pictures/PNG": Source(lambda folder: _pictures(folder, ".png"), {**SIZE, **RATE}),
    "pictures/TIFF": Source(lambda folder: _pictures(folder, ".tif"), {**SIZE, **RATE}),
    "pictures/JPEG": Source(
        lambda folder: _pictures(folder, ".jpg", BYTES), {**SIZE, **RATE, "bits": None}
    ),
    "pictures/no scale": Source(lambda folder: _pictures(folder, ".png"), RATE),
    "TIFF/stack": Source(
        _one("a.tif", lambda path: _tiff(path, photometric="minisblack")),
        {**SIZE, **RATE},
    ),
    "TIFF/packed": Source(
        _one(
            "a.tif",
            lambda path: _tiff(path, photometric="minisblack", compression="zlib"),
        ),
        {**SIZE, **RATE},
    ),
    "TIFF/ImageJ": Source(_one("a.tif", _imagej)),
    "TIFF/OME": Source(_one("a.ome.tif", _ome)),
    "DICOM/frames": Source(
        _one(
            "a.dcm",
            lambda path: _dicom(
                path, FRAMES, FrameTime=500.0, PixelSpacing=[STEP_MM[1], STEP_MM[0]]
            ),
        )
    ),
    "DICOM/run lengths": Source(
        _one("a.dcm", lambda path: _dicom(path, FRAMES, compressed=True)),
        {**SIZE, **RATE},
    ),
    "DICOM/inverted": Source(
        _one(
            "a.dcm",
            lambda path: _dicom(path, BYTES, PhotometricInterpretation="MONOCHROME1"),
        ),
        {**SIZE, **RATE, "bits": None},
    ),
    "NumPy/npy": Source(
        _one("a.npy", lambda path: np.save(path, FRAMES)), {**SIZE, **RATE, **VOLUME}
    ),
    "NumPy/npz": Source(
        _one("a.npz", lambda path: np.savez(path, frames=FRAMES, other=BYTES)),
        {**SIZE, **RATE, **VOLUME, "array": "frames"},
    ),
    "NumPy/floats": Source(
        _one("a.npy", lambda path: np.save(path, FRAMES / 4800.0)),
        {**SIZE, **RATE, **VOLUME, "bits": None},
    ),
    "NIfTI/volume": Source(_one("a.nii", _nifti), {**RATE, **FASTEST_FIRST}),
    "NIfTI/packed": Source(_one("a.nii.gz", _nifti), {**RATE, **FASTEST_FIRST}),
    "NIfTI/in time": Source(
        _one("a.nii", lambda path: _nifti(path, in_time=True)), FASTEST_FIRST
    ),
    "NRRD": Source(_one("a.nrrd", _nrrd), {**RATE, **FASTEST_FIRST}),
    "MetaImage": Source(_one("a.mha", _metaimage), {**RATE, **FASTEST_FIRST}),
    "Thorlabs": Source(_one("a.oct", _thorlabs), {**RATE, "bits": None}),
    "film/AVI": Source(
        _one("a.avi", lambda path: _film(path, "MJPG")), {**SIZE, "bits": None}
    ),
    "film/MP4": Source(
        _one("a.mp4", lambda path: _film(path, "mp4v")), {**SIZE, "bits": None}
    ),
    "film/MKV": Source(
        _one("a.mkv", lambda path: _film(path, "MJPG")), {**SIZE, "bits": None}
    ),
    "ROS/bag": Source(_bag("ros1"), {**SIZE, "axis": "fz", "contact_sign": -1}),
    "ROS/sqlite": Source(_bag("sqlite"), {**SIZE, "axis": "fz", "contact_sign": -1}),
    "ROS/sqlite packed": Source(
        _bag("sqlite", "MESSAGE"), {**SIZE, "axis": "fz", "contact_sign": -1}
    ),
    "ROS/MCAP": Source(_bag("mcap"), {**SIZE, "axis": "fz", "contact_sign": -1}),
    "ROS/by arrival": Source(
        _bag("mcap"), {**SIZE, "axis": "fz", "contact_sign": -1, "by_arrival": True}
    ),
    "log/ms and mN": Source(
        _log("Time (ms),Force_Z [mN]", lambda t, f: f"{1e3 * t:.3f},{1e3 * f:.4f}"), LOG
    ),
    "log/semicolons": Source(
        _log(
            "Zeit;Kraft Z",
            lambda t, f: f"{t:.3f};{1e3 * f:.3f}".replace(".", ","),
        ),
        {**LOG, "columns": ("time=Zeit:s", "fz=Kraft Z:mN")},
    ),
    "log/six axes": Source(
        _log(
            "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm",
            lambda t, f: f"{t:.4f},0.001,0.002,{f:.6f},0,0,0",
        ),
        LOG_OF_AXES,
    ),
    "log/dates": Source(
        _log("when,fz_n", lambda t, f: f"2026-01-02T03:04:{5 + t:09.6f}+00:00,{f:.6f}"),
        {
            **LOG,
            "columns": ("time=when:iso", "fz=fz_n:N"),
            "clock_offset_s": 1_767_323_045.0,
        },
    ),
    "log/rostopic": Source(
        _log(
            "%time," + ",".join(f"field.{name}" for name in ROS_TOPIC_NAMES), _ros_topic
        ),
        {**LOG_OF_AXES, "clock_offset_s": START_NS / SECOND_NS},
    ),
    "log/ATI": Source(
        _log(
            "Status (hex), RDT Sequence, F/T Sequence, Fx, Fy, Fz, Tx, Ty, Tz, Time",
            _ati,
            ATI_HEADER,
        ),
        {**LOG_OF_AXES, "clock_offset_s": 4097 / 200},
    ),
    "log/LabVIEW": Source(_log("X_Value\tFz\tVoltage", _labview, LABVIEW_HEADER), LOG),
    "log/flagged": Source(
        _log(
            "time_s,status,fz_n",
            lambda t, f: f"{t:.4f},{int(2.0 <= t < 2.1)},{f:.6f}",
        ),
        LOG,
    ),
    "log/gaps": Source(
        _log(
            "time_s,fz_n", lambda t, f: f"{t:.4f},{'nan' if 2.0 <= t < 2.1 else f:.6}"
        ),
        LOG,
    ),
    "log/two forces": Source(
        _log("time_s,Fz[N],ForceZ[mN]", lambda t, f: f"{t:.4f},{f:.6f},{1e3 * f:.6f}"),
        LOG,
    ),
    "log/counts": Source(
        _log("time_s,Fz(counts)", lambda t, f: f"{t:.4f},{1e6 * f:.0f}"), LOG
    ),
    "log/too slow": Source(
        _log("time_s,fz_n", lambda t, f: f"{100 * t:.4f},{f:.6f}"), LOG
    ),
    "planes": Source(_planes, {**SIZE, **RATE}),
}
