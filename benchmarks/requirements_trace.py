"""Requirements and the tests that show them: `docs/requirements.toml` and the names of the tests as one page.

python benchmarks/requirements_trace.py > docs/requirements.md     (`make trace`)

The names of tests are sentences. One that is not there any more ends the run.
"""

import ast
import sys
import tomllib
from functools import cache
from pathlib import Path

__all__ = ["ROOT", "STATED", "trace_page"]

ROOT = Path(__file__).parents[1]
STATED = ROOT / "docs" / "requirements.toml"
HEAD = """# Requirements and their tests

**Research use only: not a medical device, not for use on patients.**

What [the hazards](hazards.md) rely on, each with the tests that show it, by their names. `make trace` writes this page
from `requirements.toml` and from the tests; a test fails where it is old. Tests marked *slow* are left out of `make
test`; `make slow` has them. That a test passes shows what it tests, on virtual eyes and on faults that were thought of.
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
        lines = [f"- {_sentence(name)}" for name in requirement["tests"]]
        parts.append("\n".join([f"## {requirement['id']}", requirement["text"], "", *lines, ""]))
    return "\n".join(parts)


def _sentence(name: str) -> str:
    """Return a test as a line of the page."""
    file, _, function = name.partition("::")
    found = _tests(file)
    if function not in found:
        raise ValueError(f"{name}: there is no such test; it was renamed or removed: mend docs/requirements.toml")
    words = function.removeprefix("test_").replace("_", " ")
    return f"{words[0].upper()}{words[1:]}{' *(slow)*' if found[function] else ''} (`{file}`)"


@cache
def _tests(file: str) -> dict[str, bool]:
    """Return the tests of a file, and whether each is slow as a whole."""
    if not (ROOT / file).is_file():
        return {}
    body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
    whole = [ast.unparse(node) for node in body if isinstance(node, ast.Assign)]
    slow = any(line.startswith("pytestmark") and "slow" in line for line in whole)
    return {
        node.name: slow or any(ast.unparse(mark).endswith(("mark.slow", "mark.long")) for mark in node.decorator_list)
        for node in body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


if __name__ == "__main__":
    sys.stdout.write(trace_page())
