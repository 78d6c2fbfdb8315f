"""requirements.lock: what `make install` installs goes in with every Python that pyproject.toml admits."""

import tomllib
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]


def test_no_locked_package_wants_a_newer_python_than_ours() -> None:
    """CPython 3.11.2, which Debian 12 has, is not 3.11.7: one package refused it, and `make install` ended there."""
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    oldest = wanted.removeprefix(">=") + ".0"
    judged = []
    for line in (ROOT / "requirements.lock").read_text().splitlines():
        name, _, version = line.partition("==")
        try:
            found = distribution(name) if version else None
        except PackageNotFoundError:  # an extra that is not installed here
            continue
        if found is not None and found.version.partition("+")[0] == version:
            judged.append((name, found.metadata.get("Requires-Python") or ""))
    assert len(judged) > 50
    assert [one for one in judged if not SpecifierSet(one[1]).contains(oldest)] == []
