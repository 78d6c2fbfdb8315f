"""Load a wall finder from its model folder (ONNX Runtime only; PyTorch is not needed)."""

from os import PathLike
from pathlib import Path

from scleraforce.errors import ModelError
from scleraforce.models.folder import NETWORK_FILE, WALL_FINDER, read_folder
from scleraforce.models.session import check_provenance, folder_session, folder_study
from scleraforce.segmentation.wall_finder import WallFinder


def load_wall_finder(path: str | PathLike[str], threads: int = 1) -> WallFinder:
    """Load a model folder of kind "wall-finder".

    Args:
        path: the folder that `scleraforce train --kind wall-finder` wrote.
        threads: of ONNX Runtime within one operation.

    Raises:
        ModelError: a file is missing, was changed, or does not fit the study beside it; or it is of another kind.
    """
    folder = read_folder(Path(path))
    if folder.record["kind"] != WALL_FINDER:
        raise ModelError(f"{folder.path}: kind: found {folder.record['kind']!r}, a {WALL_FINDER} is needed here")
    finder = WallFinder(
        folder_session(folder, threads), folder_study(folder).wall_finder, str(folder.path / NETWORK_FILE)
    )
    check_provenance(folder, finder.session)
    return finder
