"""The models that ship with the package, by name: wherever MODEL is asked for, a name will do."""

from pathlib import Path

FOLDER = Path(__file__).parents[1] / "shipped"
SHIPPED_READER, SHIPPED_PAPER, SHIPPED_WALL_FINDER = FOLDER / "default", FOLDER / "paper", FOLDER / "wall_finder"
SHIPPED = {"default": SHIPPED_READER, "paper": SHIPPED_PAPER, "wall-finder": SHIPPED_WALL_FINDER}


def model_folder(given: Path) -> Path:
    """Return the folder that MODEL means: itself where it exists, else the shipped one of that name, if there is one.

    >>> model_folder(Path("default")) == SHIPPED_READER
    True
    >>> model_folder(Path("nowhere"))
    PosixPath('nowhere')
    """
    return given if given.exists() else SHIPPED.get(str(given), given)


def model_name(folder: Path) -> str:
    """Return what MODEL calls a folder: its path, or the name of one that ships, wherever that is installed.

    >>> model_name(SHIPPED_READER), model_name(Path("models/mine"))
    ('default', 'models/mine')
    """
    return next((name for name, shipped in SHIPPED.items() if shipped == folder), str(folder))
