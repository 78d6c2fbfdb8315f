"""What a source is: its format is told by its content, by its name only where the content has no mark of its own."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scleraforce.errors import FrameError, InputError
from scleraforce.formats.foreign import foreign_kind
from scleraforce.recording.scan import Scan
from scleraforce.whole_files import FileKind, check_regular

SOURCE = FileKind("source", 64 * 2**30, "", FrameError)
HEAD_BYTES = 512
TIFF_MARKS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
MATROSKA, SQLITE, MCAP = b"\x1a\x45\xdf\xa3", b"SQLite format 3\0", b"\x89MCAP0\r\n"
NIFTI_NAMES = (".nii", ".nii.gz")
TEXT_NAMES = (".csv", ".txt", ".tsv", ".log", ".dat", ".lvm")
HEADERS = {".img": (".hdr",), ".raw": (".mhd", ".nhdr"), ".zraw": (".mhd",), ".gz": (".nhdr",)}  # of files of pixels
KINDS = (
    "PNG, JPEG, TIFF, DICOM, NumPy (.npy, .npz), NIfTI, MetaImage (.mha, .mhd), NRRD, films (AVI, MP4, MOV, MKV), "
    "ROS bags (.bag, .db3, .mcap), Thorlabs .oct, force logs (.csv, .txt, .lvm)"
)


@dataclass(frozen=True)
class SourceOrder:
    """What was answered on how to read sources: order of axes, name of the array in a .npz."""

    axes: tuple[str, ...] | None = None
    array: str | None = None


def files_of(given: Sequence[Path]) -> list[Path]:
    """Return sources with folders replaced by the files in them, in the order of the numbers in their names.

    A folder with a metadata.yaml is a ROS bag and stays one. Pixels that lie beside their header are read with it.

    Raises:
        InputError: there is no such file, or a folder is empty.
    """
    found: list[Path] = []
    for path in given:
        if not path.is_dir() or (path / "metadata.yaml").exists():
            found.append(path)
            continue
        inside = sorted((each for each in path.iterdir() if _shown(each)), key=natural_order)
        if not inside:
            raise InputError(f"{path}: no files in this folder")
        found += inside
    return [path for path in found if not any(header in found for header in _headers_of(path))]


def _headers_of(path: Path) -> list[Path]:
    """Return the names that the header of a file of pixels may have.

    >>> [path.name for path in _headers_of(Path("a.raw.gz")) + _headers_of(Path("b.img"))]
    ['a.nhdr', 'b.hdr']
    """
    base = path.with_suffix("") if path.suffixes[-2:] == [".raw", ".gz"] else path
    return [base.with_suffix(ending) for ending in HEADERS.get(path.suffix.lower(), ())]


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts frame2 before frame10.

    >>> sorted(map(Path, ["f10.png", "f9.png"]), key=natural_order)[0].name
    'f9.png'
    """
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts]


def source_kind(path: Path) -> str:
    """Return what a source is: what `read_scan` reads, "bag" or "log".

    Raises:
        InputError: it is no regular file, or of no kind that is read.
    """
    if path.is_dir():
        return "bag"
    try:
        check_regular(path, path.stat(), SOURCE)
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}") from fault
    kind = _by_content(head) or _by_name(path.name.lower(), head)
    if kind is None and path.suffix.lower() == ".img" and path.with_suffix(".hdr").exists():
        return source_kind(path.with_suffix(".hdr"))
    # A log is text, which has no byte of 0.
    foreign = foreign_kind(path.name, head) if (kind == "log" and b"\0" in head) or (kind is None and head) else None
    if foreign is not None:
        raise InputError(f"{path}: {foreign}")
    if kind is None:
        raise InputError(f"{path}: {'an empty file' if not head else 'of no kind that is read'}; give {KINDS}")
    return kind


def read_scan(path: Path, kind: str, order: SourceOrder) -> Scan:
    """Return the frames of a source of a kind that `source_kind` tells.

    Raises:
        InputError: it cannot be read, or leaves open what `order` does not answer.
    """
    # Each format brings its own packages, which take long to import: only that of this file is.
    match kind:
        case "picture":
            from scleraforce.recording.images import read_picture

            return oriented(path, read_picture(path), order)
        case "tiff":
            from scleraforce.recording.tiff_image import read_tiff

            return oriented(path, read_tiff(path), order)
        case "dicom":
            from scleraforce.recording.dicom_image import read_dicom

            return oriented(path, read_dicom(path), order)
        case "film":
            from scleraforce.formats.video import read_film

            return oriented(path, read_film(path), order)
        case "thorlabs":
            from scleraforce.formats.thorlabs import read_thorlabs

            return read_thorlabs(path)
        case "numpy":
            from scleraforce.formats.numpy_file import read_numpy

            return read_numpy(path, order.axes, order.array)
        case "metaimage":
            from scleraforce.formats.metaimage import read_metaimage

            return read_metaimage(path, order.axes)
    from scleraforce.formats.volumes import read_nifti, read_nrrd

    return {"nifti": read_nifti, "nrrd": read_nrrd}[kind](path, order.axes)


def oriented(path: Path, scan: Scan, order: SourceOrder) -> Scan:
    """Return pictures, whose rows are depth unless the axes say that their columns are.

    Raises:
        InputError: the axes do not begin with the frames.
    """
    if order.axes is None:
        return scan
    if order.axes[0] != "frame" and len(order.axes) == 3:
        raise InputError(f"--axes: {','.join(order.axes)}: {path} has frame after frame; begin with frame")
    return scan.turned() if order.axes[-2:] == ("lateral", "depth") else scan


def _shown(path: Path) -> bool:
    return path.is_file() and not path.name.startswith(".")


def _by_content(head: bytes) -> str | None:
    marks = {
        "picture": head.startswith((b"\x89PNG", b"\xff\xd8\xff")),
        "dicom": head[128:132] == b"DICM",  # before TIFF: its preamble may be the head of one
        "tiff": head.startswith(TIFF_MARKS),
        "numpy": head.startswith(b"\x93NUMPY"),
        "nrrd": head.startswith(b"NRRD"),
        "bag": head.startswith((b"#ROSBAG", SQLITE, MCAP)),
        "film": head.startswith(MATROSKA) or head[4:8] == b"ftyp" or (head[:4] == b"RIFF" and head[8:12] == b"AVI "),
        "nifti": head[344:347] in (b"n+1", b"ni1") or head[4:7] == b"n+2",
        "metaimage": bool(re.match(rb"\s*(ObjectType|NDims|Comment)\s*=", head)),
    }
    return next((kind for kind, found in marks.items() if found), None)


def _by_name(name: str, head: bytes) -> str | None:
    if name.endswith(".npz"):
        return "numpy"
    if name.endswith(".oct") and head.startswith(b"PK"):
        return "thorlabs"
    if name.endswith(NIFTI_NAMES) and head:
        return "nifti"
    return "log" if name.endswith(TEXT_NAMES) and head else None
