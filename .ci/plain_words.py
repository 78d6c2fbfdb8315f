"""Find inverted or vague English in comments, docstrings, messages, names and pages, and say what to write instead.

`python .ci/plain_words.py` checks the whole tree, or the given files and folders, and fails on a hit.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
# The whole tree; the cards of the bundled models change only with the models.
WHOLE = (
    "src",
    "tests",
    "benchmarks",
    "examples",
    "docs",
    "plugins",
    *(path.name for path in ROOT.glob("*.md")),
)
# What must not be written -> what to write. A phrase of ALLOWED around a hit excuses it.
WORDS = {
    r"told": "given, declared",
    r"kept for later": "cached",
    r"(?:when|where|if) (?:it is|they are) asked for": "lazily, on demand",
    r"(?:comes|come|came) before|counts more": "takes precedence over",
    r"where nothing is (?:said|stated)": "by default, if omitted",
    r"so many": "n, the number of",
    r"(?:is|are) none": "does not exist",
    r"(?:is|are) no (?!longer|more|less)\w+": "is not a ...",
    r"(?:of )?those (?:of|that|which|in|with)": "a plain noun",
    r"(?:goes|go|going|went|gone) on": "continues",
    r"stands?(?! (?:for|out))|lies? (?:under|in (?:a|the) (?:file|folder))": "is, is stored",
    r"that ships?|out of the box": "the bundled ...",
    r"(?:is|are|not) taken up(?! by)": "reused",
    r"makes of (?:a|an|the)": "renders ... as",
    r"(?:two|both) ways": "the two methods",
    r"as (?:it is|they are|it comes|they come)(?=[,.;:)]|$)": "unchanged; with default settings",
    r"(?:by|of|to|from|with) (?:what|who|whom)": "rewrite the sentence",
    r"likewise": "repeat the noun",
    r"the rooms?": "the package",
}
ALLOWED = (
    "there is no",
    "there are no",
    "there is none",
    "regardless of what",
    "as long as it is",
)
HIT = re.compile(
    "|".join(rf"(?P<w{n}>\b(?:{words})\b)" for n, words in enumerate(WORDS)),
    re.IGNORECASE,
)
CLAUSE = re.compile(r"(?:What|Whether|How|Where|Which|When|Who|Why)\b")
FENCE = re.compile(r"^```.*?^```|`[^`\n]*`|<!--.*?-->", re.MULTILINE | re.DOTALL)


def texts(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Yield the prose of a file (comments, strings and names, or a page), its line, and whether it is a docstring."""
    content = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        bare = FENCE.sub(lambda block: "\n" * block[0].count("\n"), content)
        yield from (
            (number, line, False)
            for number, line in enumerate(bare.splitlines(), start=1)
        )
        return
    for token in tokenize.generate_tokens(io.StringIO(content).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string, False
    tree = ast.parse(content)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and ast.get_docstring(node) is not None
    }
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and " " in node.value
        ):
            yield node.lineno, node.value, id(node) in docstrings
        elif isinstance(
            node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
        ) and "_" in node.name.strip("_"):
            yield node.lineno, node.name.replace("_", " "), False


def hits(path: Path) -> Iterator[str]:
    """Yield a line for each hit in a file."""
    place = path.relative_to(ROOT)
    for line, text, is_docstring in texts(path):
        if is_docstring and CLAUSE.match(text):
            yield f"{place}:{line}: docstring opens with {text.split()[0]!r}: write an imperative or a noun phrase"
        plain = re.sub(r"\s+", " ", text)
        for found in HIT.finditer(plain):
            around = plain[max(0, found.start() - 20) : found.end() + 20].lower()
            if not any(phrase in around for phrase in ALLOWED):
                instead = list(WORDS.values())[int((found.lastgroup or "w0")[1:])]
                yield f"{place}:{line}: {found[0]!r}: write {instead!r}"


def files(*places: str) -> Iterator[Path]:
    """Yield the Python files and pages of folders, and the given files."""
    for place in places:
        path = ROOT / place
        found = (
            sorted([*path.rglob("*.py"), *path.rglob("*.md")])
            if path.is_dir()
            else [path]
        )
        yield from (file for file in found if not {".venv", "shipped"} & {*file.parts})


def main() -> int:
    """Print the hits of the whole tree, or of the given files and folders."""
    found = [line for file in files(*(sys.argv[1:] or WHOLE)) for line in hits(file)]
    print(*found, sep="\n", end="\n" if found else "")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
