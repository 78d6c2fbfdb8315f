"""What `import` tells of a recording that it wrote: for people, and for JSON."""

from pathlib import Path
from typing import Any

from scleraforce.notebook.importing import PREVIEW
from scleraforce.plain_text import wrapped
from scleraforce.recording.folder import RecordingInfo
from scleraforce.recording.importing import Complete, provenance
from scleraforce.recording.pixels import TOP, Greys
from scleraforce.units import from_si


def entries(out: Path, done: Complete, greys: Greys) -> dict[str, Any]:
    """Return what JSON tells."""
    info = done.info
    return {
        "recording": str(out),
        "preview": str(out / PREVIEW),
        "frames": len(done.gathered.scan.names),
        "force_samples": None if done.log is None else len(done.log.time_s),
        "width_mm": from_si(info.oct.width_m, "mm"),
        "depth_mm": from_si(info.oct.depth_m, "mm"),
        "refractive_index": info.oct.refractive_index,
        "bits": info.oct.bits,
        **provenance(done, greys),
    }


def lines(out: Path, done: Complete, greys: Greys) -> list[str]:
    """Return what people are told, at 80 columns."""
    told = [_frames(done), _times(done)]
    if done.log is not None:
        columns = ", ".join(column.answer() for column in done.gathered.columns) or ", ".join(done.log.columns)
        rate = f"{len(done.log.time_s)} samples, {done.log.sample_rate_hz:.4g} a second"
        told.append(f"forces: {rate} ({columns}){_contact(done.info)}")
    if greys.scaled:
        told.append(f"note: pixels of {greys.low:.6g} to {greys.high:.6g} became counts of 0 to {TOP}")
    elif greys.low:
        told.append(f"note: {-greys.low:g} was added to all pixels, so that the smallest is 0")
    if greys.lost:
        told.append(f"note: {greys.lost} pixels are not finite numbers; they became 0")
    told += [f"note: {note}" for note in done.gathered.notes]
    return [*map(wrapped, told), f"wrote {out}; look at {out / PREVIEW}"]


def _frames(done: Complete) -> str:
    scan, info, source = done.gathered.scan, done.info.oct, done.sources
    count = "1 frame" if len(scan.names) == 1 else f"{len(scan.names)} frames"
    return (
        f"{count} of {scan.rows} x {scan.columns} pixels (depth x lateral), {info.bits} bits; "
        f"{from_si(info.width_m, 'mm'):.4g} mm wide ({source['width_mm']}), {from_si(info.depth_m, 'mm'):.4g} mm deep "
        f"({source['depth_mm']}), refractive index {info.refractive_index:g} ({source['refractive_index']})"
    )


def _times(done: Complete) -> str:
    first_s, last_s = done.times.time_s[0], done.times.time_s[-1]
    begin = f"; 0 s is {done.origin_s:.0f} s of the sources' clock" if done.origin_s else ""
    return f"times: {first_s:.3f} to {last_s:.3f} s ({done.sources['times']}){begin}"


def _contact(info: RecordingInfo) -> str:
    return "" if info.force is None else f"; contact is {'+' if info.force.contact_sign > 0 else '-'}{info.force.axis}"
