"""Requirements and their tests: `docs/requirements.toml` as a page.

python benchmarks/requirements_trace.py > docs/requirements.md     (`make trace`)

A test that does not exist ends the run.
"""

import ast
import sys
import tomllib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
STATED = ROOT / "docs" / "requirements.toml"
HEAD = """# Requirements and their tests

**Research use only: not a medical device, not for use on patients.**

The requirements that [the hazards](hazards.md) rely on, each with the tests that show
it, by their names for `pytest`. `make trace` writes this page from `requirements.toml`,
and a test fails if it is out of date. `make test` leaves out tests marked *slow*, which
`make slow` runs. A passing test shows what it tests, on virtual eyes and foreseen
faults.
"""


def trace_page(stated: Path = STATED) -> str:
    """Return the page.

    Raises:
        ValueError: a test is not there, or a requirement has none.
    """
    parts = [HEAD]
    for requirement in tomllib.loads(stated.read_text(encoding="utf-8"))["requirement"]:
        if not requirement["tests"]:
            raise ValueError(f"{requirement['id']}: no test")

        lines = [f"- {_line(name)}" for name in requirement["tests"]]
        parts.append(
            "\n".join([f"## {requirement['id']}", requirement["text"], "", *lines, ""])
        )

    return "\n".join(parts)


def _line(name: str) -> str:
    """Return a test as a line of the page."""
    file, _, function = name.partition("::")
    found = _tests(file)
    if function not in found:
        raise ValueError(
            f"{name}: there is no such test; it was renamed or removed: mend"
            " docs/requirements.toml"
        )

    return f"`{name}`{' *(slow)*' if found[function] else ''}"


@cache
def _tests(file: str) -> dict[str, bool]:
    """Return the tests of a file, and whether each is slow as a whole."""
    if not (ROOT / file).is_file():
        return {}

    body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
    whole = [ast.unparse(node) for node in body if isinstance(node, ast.Assign)]
    slow = any(line.startswith("pytestmark") and "slow" in line for line in whole)
    return {
        node.name: (
            slow
            or any(
                ast.unparse(mark).endswith(("mark.slow", "mark.long"))
                for mark in node.decorator_list
            )
        )
        for node in body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


if __name__ == "__main__":
    sys.stdout.write(trace_page())
