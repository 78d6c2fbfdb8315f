"""Files that are recognised and not read: what each is, and how to get frames or forces out of it."""

from pathlib import PurePath

VENDOR = "examples/vendor_frames.py writes its B-scans as .npy (docs/formats.md)"
NUMPY = "save the frames as .npy in Python (numpy.save), or as TIFF"
EXPORT = "export the B-scans from its program as TIFF or DICOM"
TABLE = "export the samples as text (.csv)"
UNPACK = "unpack it, and give the files in it"

# By what the file begins with.
MARKS: tuple[tuple[bytes, str, str], ...] = (
    (b"CMDb", "a Heidelberg Eye Explorer file (.e2e, .sdb)", VENDOR),
    (b"HSF-OCT-", "a Heidelberg raw export (.vol)", f"{EXPORT}, or as .e2e: {VENDOR}"),
    (b"FOCT", "a Topcon file (.fda)", VENDOR),
    (b"ZISRAWFILE", "a Zeiss ZEN image (.czi)", "export it from ZEN, or from Fiji with Bio-Formats, as OME-TIFF"),
    (b"\x89HDF\r\n\x1a\n", "an HDF5 file (.h5, .mat of MATLAB 7.3, .nxs)", f"{NUMPY}: h5py.File(...)[name]"),
    (b"MATLAB ", "a MATLAB file (.mat)", f"{NUMPY}: scipy.io.loadmat(...)[name], or h5py for version 7.3"),
    (b"TDSm", "a LabVIEW TDMS file", "export it from LabVIEW or DIAdem as .lvm or .csv"),
    (b"CDF\x01", "a NetCDF or MINC file", "convert it to NIfTI (mnc2nii), or save the frames as .npy"),
    (b"GIF8", "a GIF, which has 256 colours at most", "save the frames as PNG or TIFF"),
    (b"BM", "a BMP picture", "save it as PNG"),
    (b"#?RADIANCE", "a Radiance picture (.hdr)", "save it as PNG or TIFF"),
    (b"ENVI", "an ENVI header (.hdr)", NUMPY),
    (b"# vtk DataFile", "a VTK file", "save it as .mha or .nrrd (ParaView, SimpleITK)"),
    (b"\x30\x26\xb2\x75\x8e\x66\xcf\x11", "a Windows Media film (.wmv)", "convert it: ffmpeg -i FILE -c:v ffv1 a.mkv"),
    (b"\x00\x00\x01\xba", "an MPEG film (.mpg)", "convert it: ffmpeg -i FILE -c:v ffv1 a.mkv"),
    (b"%PDF", "a PDF", EXPORT),
    (b"PAR1", "a Parquet table", TABLE),
    (b"\xd0\xcf\x11\xe0", "a file of older Microsoft programs (.xls)", TABLE),
    (b"\x1f\x8b", "a gzip file", UNPACK),
    (b"BZh", "a bzip2 file", UNPACK),
    (b"7z\xbc\xaf", "a 7-Zip archive", UNPACK),
    (b"Rar!", "a RAR archive", UNPACK),
)
# By the name's ending, where the content has no mark.
ENDINGS = {
    ".e2e": ("named as a Heidelberg Eye Explorer file", VENDOR),
    ".sdb": ("named as a Heidelberg Eye Explorer file", VENDOR),
    ".vol": ("named as a Heidelberg raw export", EXPORT),
    ".fda": ("named as a Topcon file", VENDOR),
    ".fds": ("a Topcon file", VENDOR),
    ".img": (
        "raw pixels without a header (Zeiss Cirrus), or a volume's without its .hdr",
        f"give the .hdr, or {VENDOR}",
    ),
    ".hdr": ("a header that is neither NIfTI's nor Analyze's", "save the frames as NIfTI, TIFF or .npy"),
    ".oct": ("a .oct of Bioptigen, Optopol or another maker, not Thorlabs'", f"{EXPORT}; of Bioptigen {VENDOR}"),
    ".raw": ("raw pixels without a header", f"give their .mhd or .nhdr, or {NUMPY}: numpy.fromfile(...).reshape(...)"),
    ".czi": ("named as a Zeiss ZEN image", EXPORT),
    ".zip": ("named as a zip archive", UNPACK),
    ".xls": ("named as a spreadsheet", TABLE),
    ".json": ("a JSON file", "give frames, or forces as text (.csv)"),
    ".xml": ("an XML file", "give frames, or forces as text (.csv)"),
    ".toml": ("a TOML file", "give frames, or forces as text (.csv)"),
}
ANALYZE_BYTES = 348  # of a header, which begins with this number


def foreign_kind(name: str, head: bytes) -> str | None:
    r"""Return what a file is that is not read, and what to do; None: nothing is known of it.

    >>> foreign_kind("scan.h5", b"\x89HDF\r\n\x1a\n")
    'an HDF5 file (.h5, .mat of MATLAB 7.3, .nxs); save the frames as .npy in Python (numpy.save), or as TIFF: ...'
    """
    ending = PurePath(name).suffix.lower()
    if ending in (".hdr", ".img") and ANALYZE_BYTES in (int.from_bytes(head[:4], order) for order in ("little", "big")):
        return "an Analyze 7.5 volume, whose header has no unit; convert it to NIfTI (nibabel, MRIcroGL, fslchfiletype)"
    if head.startswith(b"PK"):
        if ending in (".xlsx", ".ods", ".xlsm"):
            return f"a spreadsheet; {TABLE}"
        return f"a zip archive; {UNPACK}"
    for mark, what, way in MARKS:
        if head.startswith(mark):
            return f"{what}; {way}"
    return "; ".join(ENDINGS[ending]) if ending in ENDINGS else None
