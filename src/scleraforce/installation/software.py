"""The packages that scleraforce needs, and those of its extras, as its own metadata states them."""

from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, requires, version

from packaging.requirements import Requirement

from scleraforce.installation.finding import Finding

DISTRIBUTION = "scleraforce"
FOR_DEVELOPERS = {"dev", "docs"}


def packages() -> Iterator[Finding]:
    """Yield what was found of the required packages together, then of each extra."""
    stated = [Requirement(line) for line in requires(DISTRIBUTION) or ()]
    needed = [requirement for requirement in stated if _wanted(requirement, "")]
    lacking = [words for requirement in needed if (words := _lacking(requirement))]
    if lacking:
        yield Finding("packages", "failed", ", ".join(lacking), f"pip install --upgrade {DISTRIBUTION}")
    else:
        yield Finding("packages", "ok", ", ".join(f"{one.name} {version(one.name)}" for one in needed))
    for extra in sorted({name for requirement in stated for name in _extras(requirement)} - FOR_DEVELOPERS):
        of_extra = [requirement for requirement in stated if requirement not in needed and _wanted(requirement, extra)]
        lacking = [words for requirement in of_extra if (words := _lacking(requirement))]
        name, remedy = f"extra [{extra}]", f"pip install '{DISTRIBUTION}[{extra}]'"
        if lacking:
            yield Finding(name, "missing", ", ".join(lacking), remedy)
        else:
            yield Finding(name, "ok", ", ".join(f"{one.name} {version(one.name)}" for one in of_extra))


def _wanted(requirement: Requirement, extra: str) -> bool:
    """Whether a package is needed here with an extra; "" is none."""
    return requirement.marker is None or requirement.marker.evaluate({"extra": extra})


def _extras(requirement: Requirement) -> list[str]:
    """Return the extras that a requirement's marker names."""
    if requirement.marker is None:
        return []
    words = str(requirement.marker).split('extra == "')[1:]
    return [word.split('"')[0] for word in words]


def _lacking(requirement: Requirement) -> str:
    """Return what is wrong with a package; nothing where it is there and new enough."""
    try:
        found = version(requirement.name)
    except PackageNotFoundError:
        return f"no {requirement.name}"
    return "" if requirement.specifier.contains(found, prereleases=True) else f"{requirement.name} {found} is too old"
