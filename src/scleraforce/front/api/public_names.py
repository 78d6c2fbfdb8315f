"""The names of `import scleraforce as sf`, each imported when it is first used."""

from collections.abc import Callable
from importlib import import_module

MODULES = {
    "base.errors": ("InputError",),
    "base.version": ("__version__",),
    "front.api.calibrating": ("CalibrationMethod", "calibrate"),
    "front.api.exporting": ("export",),
    "front.api.importing": ("ImportSettings", "import_recording"),
    "front.api.monitoring": ("monitor",),
    "front.api.reading_frames": (
        "evaluate",
        "load_model",
        "read",
        "save_wall",
        "segment",
    ),
    "front.api.simulating": ("phantom", "simulate"),
    "front.api.training": ("generate", "library_of", "train"),
    "lab.training.slice_dataset": ("open_dataset",),
    "library.library_store": ("open_library",),
    "recordings.formats.image_files": ("read_frame",),
    "recordings.recording_folder": ("read_recording",),
    "records.eye": ("Eye", "Modulus"),
    "records.frame": ("Frame", "Moment"),
    "records.globe": ("Globe",),
    "records.motion": ("Motion",),
    "records.needle": ("Needle",),
    "records.remark": ("Remark",),
    "records.scan": ("Plane", "Scan"),
    "records.tissue_relaxation": ("Relaxation",),
    "records.study": ("Study", "parse_study", "read_study"),
}
MODULE_OF = {name: module for module, names in MODULES.items() for name in names}


def names_on_demand(
    namespace: dict[str, object],
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Return `__getattr__` and `__dir__` (PEP 562) of a package with these names.

    A name is imported once: then it stands in the package's `namespace`.
    """
    package = namespace["__name__"]

    def named(name: str) -> object:
        if name not in MODULE_OF:
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}; docs/python.md lists"
                " what it offers"
            )

        value = getattr(import_module(f"{package}.{MODULE_OF[name]}"), name)
        namespace[name] = value
        return value

    def names() -> list[str]:
        return sorted(MODULE_OF)

    return named, names
