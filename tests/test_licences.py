"""Everything that an installation brings along has a permissive licence, as its own metadata says it."""

import re
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PERMISSIVE = {
    "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "HPND", "ISC", "LLVM-exception", "MIT",
    "MIT-CMU", "MPL-2.0", "PSF-2.0", "Python-2.0", "Unlicense", "Zlib",
}  # fmt: skip
CLASSIFIERS = {
    "Apache Software License", "BSD License", "ISC License (ISCL)", "MIT License",
    "Mozilla Public License 2.0 (MPL 2.0)", "Python Software Foundation License",
    "Historical Permission Notice and Disclaimer (HPND)", "The Unlicense (Unlicense)",
}  # fmt: skip
# What older packages write into the free field; the LICENSE of APSW ("any-OSI") is that of zlib.
IN_WORDS = {
    "Apache 2.0": "Apache-2.0",
    "BSD": "BSD-3-Clause",
    "3-Clause BSD License": "BSD-3-Clause",
    "any-OSI": "Zlib",
}
FOR_DEVELOPERS = {"dev", "docs"}
NVIDIA = re.compile(r"nvidia-|cuda-|triton$")  # PyTorch's wheels for a GPU, which nothing of ours uses


def licence_of(found: Distribution) -> str:
    """What a package's metadata says: an SPDX expression, a classifier, or a name in the free field."""
    stated = found.metadata
    if expression := stated.get("License-Expression"):
        return expression
    classifiers = [line.split(" :: ")[-1] for line in stated.get_all("Classifier") or () if line.startswith("License")]
    named = [name for name in classifiers if name != "OSI Approved"]
    return " AND ".join(named) or IN_WORDS.get(stated.get("License", ""), stated.get("License", ""))


def is_permissive(licence: str) -> bool:
    if all(part in CLASSIFIERS for part in licence.split(" AND ")):
        return True
    words = re.split(r"\s+(?:AND|OR|WITH)\s+|[()]", licence)
    names = [word.strip() for word in words if word.strip()]
    return bool(names) and all(name in PERMISSIVE for name in names)


@cache
def brought_along() -> dict[str, Distribution]:
    """What `pip install 'scleraforce[every extra of users]'` brings on this system, as far as it is installed here."""
    found: dict[str, Distribution] = {}
    extras = set(distribution("scleraforce").metadata.get_all("Provides-Extra") or ()) - FOR_DEVELOPERS
    waiting = [("scleraforce", frozenset(extras))]
    seen = set(waiting)
    while waiting:
        name, wanted = waiting.pop()
        try:
            one = distribution(name)
        except PackageNotFoundError:
            continue
        found[canonicalize_name(name)] = one
        for line in one.requires or ():
            needed = Requirement(line)
            if needed.marker and not any(needed.marker.evaluate({"extra": extra}) for extra in {"", *wanted}):
                continue
            entry = (canonicalize_name(needed.name), frozenset(needed.extras))
            if entry not in seen and not NVIDIA.match(entry[0]):
                seen.add(entry)
                waiting.append(entry)
    return found


def test_the_packages_that_are_looked_at_are_those_that_come_along() -> None:
    assert {"scleraforce", "numpy", "scipy", "onnxruntime", "protobuf", "zarr", "numcodecs"} <= set(brought_along())
    assert "pytest" not in brought_along()


def test_every_package_is_under_a_permissive_licence() -> None:
    stated = {name: licence_of(one) for name, one in brought_along().items()}
    others = {name: licence[:80] for name, licence in stated.items() if not is_permissive(licence)}
    assert not others, "not in the list; read their LICENSE files"


@pytest.mark.parametrize(
    ("licence", "permissive"),
    [
        ("MIT", True),
        ("Apache-2.0 OR BSD-2-Clause", True),
        ("(MIT AND BSD-3-Clause) OR Zlib", True),
        ("BSD License AND MIT License", True),
        ("Apache-2.0 WITH LLVM-exception", True),
        ("MIT AND GPL-3.0-only", False),
        ("LGPL-2.1-or-later", False),
        ("GNU General Public License v3 (GPLv3)", False),
        ("", False),
    ],
)
def test_the_list_tells_permissive_licences_from_others(licence: str, permissive: bool) -> None:
    assert is_permissive(licence) is permissive
