"""The response library of a study: the bundled one, or the cache's."""

from scleraforce.library import Library, load_library
from scleraforce.library.plan import plan_library
from scleraforce.models import LIBRARY_FILE, SHIPPED_READER, folder_study, read_folder
from scleraforce.notebook import Counting
from scleraforce.study import Study


def library_for(study: Study, mechanics: str, counting: Counting, workers: int | None = None) -> Library | None:
    """Return the library for finite strain (linear: None), the bundled one or the cache's; counts "library"."""
    if mechanics == "linear":
        return None
    plan, shipped = plan_library(study), read_folder(SHIPPED_READER)
    if plan_library(folder_study(shipped)).key == plan.key:
        return load_library(shipped.path / LIBRARY_FILE, shipped.files[LIBRARY_FILE])
    from scleraforce.library.build import cached_library  # with Zarr and the mechanics

    with counting("library", plan.units) as advance:
        return cached_library(study, workers=workers, progress=advance)
