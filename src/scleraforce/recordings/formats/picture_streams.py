"""Frames of any file, one or many: pixels, grey levels, the size of a pixel, and what
files state; None: not stated.
"""

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Counts, Floats, Integers, Places
from scleraforce.base.errors import FrameError, InputError
from scleraforce.base.units import from_si
from scleraforce.recordings.formats.pixels_without_value import (
    HUGE,
    NOT_FINITE,
    TOO_LARGE,
    PictureValues,
)
from scleraforce.records.frame import Pixels
from scleraforce.records.remark import Remark

if TYPE_CHECKING:
    from lzma import LZMADecompressor


MAX_PIXELS = 64 * 2**20
MAX_SAMPLES = 4  # of a pixel: colour and transparency
GZIP_OR_ZLIB = zlib.MAX_WBITS | 32
OVERFULL = "damaged: more is packed in it than its header says"
# axes, by TIFF's and EXIF's Orientation
MIRRORED = {
    2: (1,),
    3: (0, 1),
    4: (0,),
    6: (1,),
    7: (0, 1),
    8: (0,),
}
TRANSPOSED = 5  # from this Orientation on, rows are stored as columns


class OtherPictureError(FrameError):
    """A picture beside B-scans that is none itself, such as one from the front."""


def check_image_size(rows: int, columns: int, samples: int = 1) -> None:
    """Check the size that a file states, before memory is taken for its pixels."""
    if min(rows, columns) < 2:
        raise FrameError(
            f"an image of {rows} x {columns} pixels; give one frame, rows x columns"
        )

    if rows * columns > MAX_PIXELS or not 1 <= samples <= MAX_SAMPLES:
        many = f" with {samples} samples each" if samples > 1 else ""
        most = (
            f"a frame may have {MAX_PIXELS // 2**20} million pixels"
            " (docs/recordings.md)"
        )
        raise FrameError(f"{rows} x {columns} pixels{many}; {most}")


def grey_pixels(pixels: NDArray[Any], colour: int = cv2.COLOR_RGB2GRAY) -> Pixels:
    """Return grey uint8 or uint16 pixels (rows, columns) of (rows, columns[, 1, 3 or
    4]); `colour` is OpenCV's code.
    """
    if pixels.dtype not in (np.uint8, np.uint16):
        lost = int(np.count_nonzero(~np.isfinite(pixels)))
        found = (
            f"{lost} pixels that are NaN or infinite"
            if lost
            else f"{pixels.dtype} pixels"
        )
        raise FrameError(f"{found}; give whole numbers of 8 or 16 bits")

    if pixels.ndim == 3 and pixels.shape[-1] in (3, 4):
        pixels = np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels[..., :3]), colour))
    elif pixels.ndim == 3 and pixels.shape[-1] == 1:
        pixels = pixels[..., 0]

    if pixels.ndim != 2:
        raise FrameError(
            f"an image of shape {pixels.shape}; give one frame, rows x columns"
        )

    check_image_size(*pixels.shape)
    return pixels


def one_grey(picture: NDArray[Any]) -> NDArray[Any]:
    """Return a picture without colour."""
    return grey_pixels(picture) if picture.ndim == 3 else picture


def inverted_pixels(pixels: NDArray[Any], bits: int) -> NDArray[Any]:
    """Exchange dark and bright: subtract unsigned pixels from the largest value of
    `bits`, change others' sign.
    """
    if pixels.dtype.kind == "f":
        return -pixels
    if pixels.dtype not in (np.uint8, np.uint16):
        return -pixels.astype(np.int64 if pixels.dtype != np.uint64 else np.float64)

    top = 2**bits - 1
    if int(pixels.max()) > top:
        raise FrameError(
            f"damaged: a pixel of {int(pixels.max())} is more than {bits} bits"
        )

    turned: NDArray[Any] = pixels.dtype.type(top) - pixels
    return turned


def as_shown(pixels: NDArray[Any], orientation: int) -> NDArray[Any]:
    """Return pixels turned by TIFF's or EXIF's Orientation (1 to 8), rows and columns
    first.
    """
    turned = pixels.swapaxes(0, 1) if orientation >= TRANSPOSED else pixels
    return np.flip(turned, MIRRORED.get(orientation, ()))


def unpacked_bytes(
    packed: bytes, most: int, lzma: "LZMADecompressor | None" = None
) -> bytes:
    """Return what packed bytes (zlib, gzip or LZMA) hold; refuse more than `most`
    before it takes memory.
    """
    data = (lzma or zlib.decompressobj(GZIP_OR_ZLIB)).decompress(packed, most + 1)
    if len(data) > most:
        raise FrameError(OVERFULL)
    return data


def check_packbits(packed: bytes, most: int) -> None:
    """Refuse PackBits data (TIFF, DICOM's RLE) of more than `most` bytes; decoders
    would take up to 512 for each.
    """
    at = 0
    count = 0

    while at < len(packed):
        code = packed[at]
        if code < 128:
            count += min(code + 1, len(packed) - at - 1)
            at += code + 2
        else:
            count += 257 - code if code > 128 else 0
            at += 2 if code > 128 else 1

        if count > most:
            raise FrameError(OVERFULL)


MOST_BITS = 16
TOP = 2**MOST_BITS - 1


@dataclass(frozen=True, kw_only=True)
class GreyMap:
    """The map of pixels to counts: (pixel - `low`) * TOP / (`high` - `low`), or pixel -
    `low`.

    Pixels without a value, like those beyond `most`, are 0; `without` counts them by
    their kinds.
    """

    low: float
    high: float
    scaled: bool
    most: float = HUGE
    without: Mapping[str, int] = field(default_factory=dict)

    @property
    def lost(self) -> int:
        """The number of pixels without a value."""
        return sum(self.without.values())

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What became of the pixels, if they are not the counts."""
        found = []
        if self.scaled:
            found.append(
                f"pixels of {self.low:.6g} to {self.high:.6g} became counts of 0 to"
                f" {TOP}"
            )
        elif self.low:
            found.append(
                f"{-self.low:g} was added to all pixels, so that the smallest is 0"
            )
        if self.lost:
            found.append(self.words)
        return tuple(Remark("pixels-scaled", words) for words in found)

    @property
    def words(self) -> str:
        """A sentence on the pixels without a value; "" without such."""
        kinds = ", ".join(f"{count} {kind}" for kind, count in self.without.items())
        what = (
            "pixel has no value and is 0"
            if self.lost == 1
            else ("pixels have no value and are 0")
        )
        return f"{self.lost} {what}: {kinds}" if kinds else ""

    def fit(self, bits: int) -> bool:
        """Return whether this number of bits holds the counts."""
        return (TOP if self.scaled else self.high - self.low) < 1 << bits

    def counts(self, picture: NDArray[Any]) -> Counts:
        """Return a picture (row, column) as counts, row after row in memory."""
        picture = np.ascontiguousarray(picture)
        if not self.scaled:
            return np.asarray(picture.astype(np.int64) - int(self.low), dtype=np.uint16)

        values = picture.astype(np.float64)
        # not "> most", which NaN is not
        values[~(values <= self.most)] = self.low
        scaled = np.clip((values - self.low) * (TOP / (self.high - self.low)), 0.0, TOP)
        return np.asarray(np.rint(scaled), dtype=np.uint16)


def check_grey_range(given: tuple[float, float]) -> None:
    """Raise an `InputError` unless the first of two values is below the other."""
    if not given[0] < given[1]:
        raise InputError(
            f"`grey_range`: {given[0]:g} {given[1]:g}; give the darkest value before a"
            " larger one"
        )


def find_greys(
    pictures: Iterable[NDArray[Any]], given: tuple[float, float] | None, name: str
) -> GreyMap:
    """Return the map of pixels to counts: whole numbers that 16 bits hold stay or are
    shifted, others are scaled.

    Values that are none (`recordings.formats.pixels_without_value`) do not count in the
    range of the others.
    """
    if given is not None:
        check_grey_range(given)

    low = np.inf
    high = -np.inf
    whole = True
    values = PictureValues()

    for picture in pictures:
        if picture.dtype.kind not in "uif":
            raise FrameError(
                f"{name}: pixels of type {picture.dtype}; give whole numbers or floats"
            )

        is_whole = picture.dtype.kind != "f"
        whole = whole and is_whole
        if is_whole and picture.size:
            low = min(low, float(picture.min()))
            high = max(high, float(picture.max()))
        if not is_whole or picture.itemsize > 2:
            values.add(picture)

    found = values.limits()
    if given is not None:
        without = {
            kind: count
            for kind, count in found.lost.items()
            if kind in (NOT_FINITE, TOO_LARGE)
        }
        return GreyMap(low=given[0], high=given[1], scaled=True, without=without)
    if whole and high - min(low, 0.0) <= TOP:
        return GreyMap(low=min(low, 0.0), high=high, scaled=False)

    if not found.low < found.high:
        raise FrameError(
            f"{name}: all pixels have one value or none; there is nothing to see in"
            " them"
        )

    return GreyMap(
        low=found.low,
        high=found.high,
        scaled=True,
        most=found.high,
        without=found.lost,
    )


@contextmanager
def named_faults(path: Path | str, kind: str) -> Iterator[None]:
    """Name the file in every exception of a reader, and its kind in errors of packages;
    errors of the system pass.
    """
    try:
        yield
    except InputError as fault:
        fault.args = (f"{path}: {fault}",)
        raise
    except Exception as fault:
        # packages raise whatever the damage leads to: OSError without a name,
        # MemoryError
        if isinstance(fault, OSError) and fault.filename is not None:
            raise

        words = " ".join(str(fault).split()) or type(fault).__name__
        raise FrameError(
            f"{path}: damaged or an unknown kind of {kind}: {words}"
        ) from fault


PictureStream = Iterator[NDArray[Any]]

LARGEST_BYTES = 16 * 2**30  # of the frames of one source, unpacked
METRES = {
    "m": 1.0,
    "meter": 1.0,
    "metre": 1.0,
    "cm": 1e-2,
    "centimeter": 1e-2,
    "inch": 25.4e-3,
    "in": 25.4e-3,
    "mm": 1e-3,
    "millimeter": 1e-3,
    "millimetre": 1e-3,
    "µm": 1e-6,
    "μm": 1e-6,
    "um": 1e-6,
    "micron": 1e-6,
    "microns": 1e-6,
    "micrometer": 1e-6,
    "micrometre": 1e-6,
    "nm": 1e-9,
    "nanometer": 1e-9,
}
SECONDS = {
    "s": 1.0,
    "sec": 1.0,
    "second": 1.0,
    "seconds": 1.0,
    "sek": 1.0,
    "sekunden": 1.0,
    "secondes": 1.0,
    "min": 60.0,
    "h": 3600.0,
    "d": 86400.0,
    "days": 86400.0,
    "ms": 1e-3,
    "msec": 1e-3,
    "milliseconds": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "usec": 1e-6,
    "microseconds": 1e-6,
    "ns": 1e-9,
    "nsec": 1e-9,
    "nanoseconds": 1e-9,
}
ROUNDED = 0.001  # sizes of a pixel that differ by less were rounded


@dataclass(frozen=True, eq=False)
class FrameTimes:
    """Times of frames, s, on a clock of the source's own, and the source."""

    time_s: Floats
    source: str


@dataclass(frozen=True, eq=False)
class FrameNumbers:
    """Whole numbers that order frames, and their source."""

    values: Integers
    source: str


@dataclass(frozen=True)
class PixelSize:
    """The size of a pixel that one field of a file states; None: not stated."""

    source: str
    _: KW_ONLY
    depth_m: float | None
    lateral_m: float | None

    def __str__(self) -> str:
        sizes = (
            "?" if size_m is None else f"{from_si(size_m, 'mm'):.6g}"
            for size_m in (self.depth_m, self.lateral_m)
        )
        return (
            f"{self.source} states pixels of {' x '.join(sizes)} mm (depth x lateral)"
        )


UNKNOWN_SIZE = PixelSize("nothing", depth_m=None, lateral_m=None)


@dataclass(frozen=True, eq=False)
class PictureSource:
    """Frames of one or several files.

    `pictures` gives the frames (row, column) from the first on, at every call: whole
    numbers or floats, larger is brighter. Rows are depth, columns lateral. After a
    contradiction in the file, `scale_fault` or `times_fault` is set, and the size of a
    pixel or the times are not.
    """

    names: tuple[str, ...]
    rows: int
    columns: int
    pictures: Callable[[], PictureStream]
    _: KW_ONLY
    bits: int | None = None
    size: PixelSize = UNKNOWN_SIZE
    times: FrameTimes | None = None
    notes: tuple[str, ...] = ()
    scale_fault: str | None = None
    times_fault: str | None = None
    other_times: tuple[FrameTimes, ...] = ()
    numbers: tuple[FrameNumbers, ...] = ()
    series: str | None = None
    labels: tuple[str, ...] | None = None
    one_moment: str | None = None
    steps: Integers | None = None

    def turned(self) -> "PictureSource":
        """Return the scan with rows and columns exchanged: depth ran along the rows."""
        size = replace(
            self.size, depth_m=self.size.lateral_m, lateral_m=self.size.depth_m
        )
        pictures = self.pictures

        return replace(
            self,
            rows=self.columns,
            columns=self.rows,
            size=size,
            pictures=lambda: (p.T for p in pictures()),
        )

    def flipped(self, flip: str | None) -> "PictureSource":
        """Return the scan with its "rows" upside down, or its "columns" mirrored; None:
        as it is.
        """
        if flip is None:
            return self

        pictures = self.pictures
        turned = np.s_[::-1] if flip == "rows" else np.s_[:, ::-1]
        return replace(self, pictures=lambda: (p[turned] for p in pictures()))

    def between(self, first: int | None, last: int | None) -> "PictureSource":
        """Return the frames from the first to the last one, counted from 1; None: from
        the beginning, to the end.
        """
        start = (first or 1) - 1
        stop = len(self.names) if last is None else last
        if not 0 <= start < stop <= len(self.names):
            name = "last_frame" if first is None or last is not None else "first_frame"
            raise InputError(
                f"`{name}`: frames {start + 1} to {stop} of {len(self.names)}; give a"
                " stretch of these"
            )

        stream = self.pictures
        kept = self._stated_at(np.arange(start, stop))
        return replace(kept, pictures=lambda: islice(stream(), start, stop))

    def reordered(self, order: Places) -> "PictureSource":
        """Return the frames in another order; those read before their turn wait."""
        stream = self.pictures
        return replace(
            self._stated_at(order), pictures=lambda: in_order(stream(), order.tolist())
        )

    def _stated_at(self, order: Places) -> "PictureSource":
        """Return what is stated of frames, in another order; the pictures stay."""

        def chosen(stated: FrameTimes) -> FrameTimes:
            return replace(stated, time_s=stated.time_s[order])

        return replace(
            self,
            names=tuple(self.names[nth] for nth in order),
            labels=self.labels and tuple(self.labels[nth] for nth in order),
            times=self.times and chosen(self.times),
            other_times=tuple(map(chosen, self.other_times)),
            numbers=tuple(
                replace(each, values=each.values[order]) for each in self.numbers
            ),
            steps=None if self.steps is None else self.steps[order],
        )

    def of_file(self, path: Path | str) -> "PictureSource":
        """Return the scan with the file's name before each note and fault."""
        scale_fault, times_fault = (
            fault and f"{path}: {fault}"
            for fault in (self.scale_fault, self.times_fault)
        )
        notes = tuple(f"{path}: {note}" for note in self.notes)

        return replace(
            self, notes=notes, scale_fault=scale_fault, times_fault=times_fault
        )


def in_order(stream: PictureStream, order: Sequence[int]) -> PictureStream:
    """Yield the pictures of a stream in an order of their places; others are left out.

    Pictures that come before their turn wait in memory.
    """
    waiting: dict[int, NDArray[Any]] = {}
    wanted = set(order)
    turns = iter(order)
    due = next(turns, -1)

    for nth, picture in enumerate(stream):
        if nth in wanted:
            waiting[nth] = picture
        while due in waiting:
            yield waiting.pop(due)
            due = next(turns, -1)


def one_size(sizes: Sequence[PixelSize]) -> tuple[PixelSize, str | None]:
    """Return the size by the first field that states one, and the fault if fields
    differ.
    """
    first, *others = [size for size in sizes if size.depth_m or size.lateral_m] or [
        UNKNOWN_SIZE
    ]
    for other in others:
        pairs = ((first.depth_m, other.depth_m), (first.lateral_m, other.lateral_m))
        if any(
            mine and theirs and abs(mine - theirs) > ROUNDED * mine
            for mine, theirs in pairs
        ):
            return UNKNOWN_SIZE, f"{first}, {other}"

    return first, None


def frame_names(path: Path, count: int) -> tuple[str, ...]:
    """Return the names of a file's frames: a.tif[0], a.tif[1]; of its only one
    b.tif.
    """
    return (
        tuple(f"{path}[{nth}]" for nth in range(count)) if count > 1 else (str(path),)
    )


def even_times(count: int, step_s: float, source: str) -> FrameTimes | None:
    """Return times in even steps from 0 on; None if the step is not positive."""
    return (
        FrameTimes(np.arange(count, dtype=np.float64) * step_s, source)
        if step_s > 0.0
        else None
    )


def rising(time_s: Floats) -> bool:
    """Return whether every time is later than the one before."""
    return bool(np.isfinite(time_s).all() and (np.diff(time_s) > 0.0).all())


def check_bytes(count: int) -> None:
    """Check the memory or disk space of a file's frames before they are read."""
    if count > LARGEST_BYTES:
        raise FrameError(
            f"{count:,} bytes of frames; {LARGEST_BYTES // 2**30} GiB at most"
            " (docs/formats.md)"
        )


class UnansweredError(InputError):
    """A source leaves open what a field of an import (like "axes") answers; `forms` are
    of answers given several times.
    """

    def __init__(self, field: str, question: str, *forms: str) -> None:
        answers = [f"`{field}={form}`" for form in forms] or [f"`{field}`"]
        super().__init__(f"{question}; give {' '.join(answers)}")
        self.field = field
        self.question = question
        self.forms = forms


def joined_files(scans: Sequence[PictureSource]) -> PictureSource:
    """Return several files of frames as one scan: in the order of the times that all
    state, else of their numbers, else in the given order.
    """
    first = scans[0]
    check_kinds(scans)
    given = _concatenated(scans)
    ordered = given
    times = scans[0].times if len(given.names) == 1 else None
    numbers: tuple[FrameNumbers, ...] = ()

    if len(given.names) == 1:
        pass
    elif (found := _ordered_by_times(scans)) is not None:
        ordered, times = found
    elif (by_number := _ordered_by_numbers(scans)) is not None:
        ordered, numbers = by_number

    return replace(
        first,
        names=ordered.names,
        pictures=ordered.pictures,
        labels=ordered.labels,
        times=times,
        other_times=(),
        numbers=numbers,
        scale_fault=next(
            (scan.scale_fault for scan in scans if scan.scale_fault), None
        ),
        times_fault=next(
            (scan.times_fault for scan in scans if scan.times_fault), None
        ),
        notes=tuple(dict.fromkeys(note for scan in scans for note in scan.notes)),
    )


def check_kinds(scans: Sequence[PictureSource]) -> None:
    """Refuse files whose frames differ in size, scale or bits."""
    first = scans[0]
    kind = _kind(first)

    for scan in scans[1:]:
        for name, mine in _kind(scan).items():
            if mine != kind[name]:
                found = f"{name} {mine}, where {first.names[0]} has {kind[name]}"
                raise FrameError(
                    f"{scan.names[0]}: {found}; import frames of one kind at a time"
                )


def _concatenated(scans: Sequence[PictureSource]) -> PictureSource:
    labels = [scan.labels for scan in scans if scan.labels is not None]
    return replace(
        scans[0],
        names=tuple(name for scan in scans for name in scan.names),
        pictures=lambda: (
            picture for scan in scans for picture in checked_pictures(scan)
        ),
        labels=(
            tuple(label for each in labels for label in each)
            if len(labels) == len(scans)
            else None
        ),
        times=None,
        other_times=(),
        numbers=(),
    )


def _ordered_by_times(
    scans: Sequence[PictureSource],
) -> tuple[PictureSource, FrameTimes] | None:
    """Return frames in the order of the first clock by which all times differ."""
    clocks = [[scan.times for scan in scans if scan.times is not None]]
    clocks += [
        [times for scan in scans for times in scan.other_times if times.source == name]
        for name in dict.fromkeys(times.source for times in scans[0].other_times)
    ]

    for clock in clocks:
        if len(clock) == len(scans):
            ordered, time_s = _sorted(scans, [times.time_s for times in clock])
            if rising(time_s):
                return ordered, FrameTimes(time_s, clock[0].source)

    return None


def _ordered_by_numbers(
    scans: Sequence[PictureSource],
) -> tuple[PictureSource, tuple[FrameNumbers, ...]] | None:
    """Return frames in the order of the first numbers that all differ."""
    for name in dict.fromkeys(each.source for each in scans[0].numbers):
        numbers = [
            each.values
            for scan in scans
            for each in scan.numbers
            if each.source == name
        ]
        if len(numbers) == len(scans):
            ordered, values = _sorted(scans, [each.astype(float) for each in numbers])
            if rising(values):
                return ordered, (FrameNumbers(values.astype(np.int64), name),)

    return None


def _sorted(
    scans: Sequence[PictureSource], keys: Sequence[Floats]
) -> tuple[PictureSource, Floats]:
    """Return the frames of all files in the order of their keys, and these."""
    files = sorted(range(len(scans)), key=lambda nth: float(keys[nth][0]))
    whole = _concatenated([scans[nth] for nth in files])
    values = np.concatenate([keys[nth] for nth in files])
    if rising(values):  # no file has frames between those of another
        return whole, values

    order = np.argsort(values, kind="stable")
    return whole.reordered(order), values[order]


def checked_pictures(scan: PictureSource) -> PictureStream:
    """Yield a scan's frames, and check their number, size and type, which damaged files
    break.
    """
    count = 0
    kind = None

    for count, picture in enumerate(scan.pictures(), start=1):
        kind = kind or picture.dtype
        if (picture.shape, picture.dtype) != (
            (scan.rows, scan.columns),
            kind,
        ) or count > len(scan.names):
            found = f"a frame of {picture.shape} {picture.dtype}, number {count}"
            raise FrameError(f"{scan.names[0]}: damaged: {found}, is not stated")

        yield picture

    if count < len(scan.names):
        raise FrameError(
            f"{scan.names[0]}: damaged: {count} of {len(scan.names)} frames can be read"
        )


def _kind(scan: PictureSource) -> dict[str, str]:
    sizes = (
        from_si(size_m, "um") for size_m in (scan.size.depth_m, scan.size.lateral_m)
    )
    names = (
        "rows",
        "columns",
        "bits",
        "depth of a pixel (um)",
        "width of a pixel (um)",
    )
    values = (scan.rows, scan.columns, scan.bits, *sizes)

    return {
        name: "not stated" if value is None else f"{value:.9g}"
        for name, value in zip(names, values, strict=True)
    }


AXES = ("frame", "depth", "lateral")
# along each axis, m, and the field that states them
Steps = tuple[Sequence[float | None], str]


def parse_axes(text: str) -> tuple[str, ...]:
    """Return the axes that a text names, like "lateral, depth,frame"."""
    names = tuple(name.strip() for name in text.split(","))
    if sorted(names) not in (sorted(AXES), sorted(AXES[1:])):
        raise InputError(
            f"`axes`: {text!r}; give {','.join(AXES)} in the order of the file, or"
            " depth,lateral of one"
        )
    return names


def array_scan(
    path: Path,
    array: NDArray[Any],
    axes: tuple[str, ...] | None,
    stated: Sequence[Steps] = (),
) -> PictureSource:
    """Return an array as a scan; `axes` names those longer than 1 (None: ask), fields
    have `stated` steps along all.
    """
    sizes = " x ".join(map(str, array.shape))
    long = [axis for axis, size in enumerate(array.shape) if size > 1]

    array = array.squeeze()
    if array.ndim not in (2, 3):
        raise FrameError(
            f"an array of {sizes}; give frames x rows x columns, or one frame"
        )
    if array.dtype.kind not in "uif":
        raise FrameError(
            f"pixels of type {array.dtype}; give whole numbers or floats, one of a"
            " pixel (grey)"
        )
    if axes is None:
        question = (
            f"which axis is which? Name {','.join(AXES[-array.ndim :])} in the order of"
            " the sizes"
        )
        raise UnansweredError("axes", f"an array of {sizes}: {question}")

    if array.ndim == 2:
        axes = tuple(name for name in axes if name != "frame")

    if len(axes) != array.ndim:
        raise FrameError(
            f"`axes` names {len(axes)} axes ({','.join(axes)}); the array is of {sizes}"
        )

    check_bytes(array.nbytes)
    frames = np.transpose(array, [axes.index(name) for name in AXES if name in axes])
    frames = frames if frames.ndim == 3 else frames[np.newaxis]
    count, rows, columns = frames.shape
    check_image_size(rows, columns)
    depth, lateral = (long[axes.index(name)] for name in AXES[1:])
    size, fault = one_size(
        [
            PixelSize(source, depth_m=m[depth], lateral_m=m[lateral])
            for m, source in stated
        ]
    )
    names = frame_names(path, count)
    bits = 8 if frames.dtype == np.uint8 else None

    return PictureSource(
        names,
        rows,
        columns,
        lambda: iter(frames),
        bits=bits,
        size=size,
        scale_fault=fault,
    )
