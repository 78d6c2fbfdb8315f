"""A cache of its own for commands that tests start, with the machine code that all share."""

from pathlib import Path

from platformdirs import user_cache_path


def cache_of_its_own(folder: Path) -> dict[str, str]:
    """Return the environment of commands whose cache is a folder; only the compiled loops are shared."""
    shared = user_cache_path("scleraforce") / "compiled"
    shared.mkdir(parents=True, exist_ok=True)
    (folder / "scleraforce").mkdir()
    (folder / "scleraforce" / "compiled").symlink_to(shared)
    return {"XDG_CACHE_HOME": str(folder)}
