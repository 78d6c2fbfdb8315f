"""The user's cache of libraries: made on first need, kept under the key of everything that they depend on.

The cache is the folder that the system keeps for such files (`XDG_CACHE_HOME`, or ~/.cache, on Linux), below
`scleraforce`. A library is built beside its place and renamed when it is whole. Who finds another process building the
same library waits for it; an interrupted build is taken up by the next.
"""

import shutil
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

from filelock import FileLock
from platformdirs import user_cache_path

from scleraforce.errors import InputError
from scleraforce.library.build import PathSolver, build_library
from scleraforce.library.plan import plan_library
from scleraforce.library.responses import Library
from scleraforce.library.store import open_library
from scleraforce.study import Study

KEY_LETTERS = 32  # of the key, in a file name


def library_cache() -> Path:
    """Return the folder of the cache."""
    return user_cache_path("scleraforce") / "libraries"


def cached_library(
    study: Study,
    *,
    folder: Path | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
    solve: PathSolver | None = None,
) -> Library:
    """Return the library of a study; the first time it is built, which takes a minute or two.

    Args:
        study: the study.
        folder: the cache; None: the user's.
        workers: processes that build it; None: one for each core that this process may use.
        progress: called with the number of paths that are newly done, only where the library has to be built.
        solve: as of `build_library`.

    Raises:
        InputError: the cache cannot be written.
        SolverError: a path could not be followed.
    """
    folder = folder or library_cache()
    place = folder / f"{_name(study)}.zarr"
    if found := _stored(place):
        return found
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with FileLock(place.with_suffix(".lock")):  # it ends with the process that holds it
            if found := _stored(place):  # somebody else has built it meanwhile
                return found
            _build(study, place, workers, progress, solve)
    except OSError as fault:
        raise InputError(f"{folder}: {fault.strerror}; XDG_CACHE_HOME names another folder for caches") from fault
    return open_library(place)


def _name(study: Study) -> str:
    return f"{version('scleraforce')}-{plan_library(study).key[:KEY_LETTERS]}"


def _stored(place: Path) -> Library | None:
    """Return the library of a place; None where there is none, or a damaged one."""
    if place.is_dir():
        with suppress(InputError):
            return open_library(place)
    return None


def _build(
    study: Study,
    place: Path,
    workers: int | None,
    progress: Callable[[int], None] | None,
    solve: PathSolver | None,
) -> None:
    """Build a library, or finish what an interrupted run has left, and put it into its place."""
    begun = place.with_suffix(".begun")
    try:
        build_library(study, begun, workers=workers, progress=progress, solve=solve)
    except InputError:  # what was left there cannot be continued
        shutil.rmtree(begun, ignore_errors=True)
        build_library(study, begun, workers=workers, progress=progress, solve=solve)
    if place.exists():
        shutil.rmtree(place)  # it was damaged
    begun.rename(place)
