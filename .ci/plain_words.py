"""Find inverted or vague English in comments, docstrings, messages, names and pages, and say what to write instead.

`python .ci/plain_words.py` checks the folders in CLEAN, or the given ones, and fails on a hit; `--all` counts the hits
of each folder.
"""

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
# Folders and files without hits; extend this list, and drop it when every package is in it.
CLEAN = (
    *("benchmarks", "examples", "tests/benchmarks", "tests/support", "tests/conftest.py", "tests/reproduction"),
    "src/scleraforce/installation.py",
    *("src/scleraforce/report", "src/scleraforce/reproduction", "src/scleraforce/calibration", "src/scleraforce/known"),
    *("tests/calibration", "tests/known", "tests/report", "tests/test_gallery.py"),
    *("docs", "src/scleraforce/recording", "src/scleraforce/study"),
    *("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"),
    *("src/scleraforce/checked_store.py", "src/scleraforce/cluster.py", "src/scleraforce/compiled.py"),
    *("src/scleraforce/errors.py", "src/scleraforce/plain_json.py", "src/scleraforce/plain_text.py"),
    *("src/scleraforce/processes.py", "src/scleraforce/units.py", "src/scleraforce/whole_files.py"),
    *("src/scleraforce/__init__.py", "src/scleraforce/cli", "src/scleraforce/notebook", "src/scleraforce/replay"),
    *("src/scleraforce/service", "src/scleraforce/monitor", "src/scleraforce/openigtlink"),
    *("tests/notebook", "tests/replay", "tests/service", "tests/monitor", "tests/openigtlink"),
    *("src/scleraforce/laboratory", "src/scleraforce/learning", "src/scleraforce/library", "src/scleraforce/reader"),
    *("tests/library", "tests/reader", "tests/laboratory", "tests/learning", "tests/test_whole_files.py"),
    *("src/scleraforce/mechanics", "src/scleraforce/segmentation", "tests/mechanics", "tests/segmentation"),
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
    r"(?:goes|go) on": "continues",
    r"stands?(?! (?:for|out))|lies under": "is",
    r"that ships?": "the bundled ...",
    r"(?:two|both) ways": "the two methods",
    r"as (?:it is|they are|it comes|they come)(?=[,.;:)]|$)": "unchanged; with default settings",
    r"(?:by|of|to|from|with) (?:what|who|whom)": "rewrite the sentence",
    r"likewise": "repeat the noun",
    r"the rooms?": "the package",
}
ALLOWED = ("there is no", "there are no", "there is none", "regardless of what", "as long as it is")
HIT = re.compile("|".join(rf"(?P<w{n}>\b(?:{words})\b)" for n, words in enumerate(WORDS)), re.IGNORECASE)
CLAUSE = re.compile(r"(?:What|Whether|How|Where|Which|When|Who|Why)\b")
FENCE = re.compile(r"^```.*?^```|`[^`\n]*`|<!--.*?-->", re.MULTILINE | re.DOTALL)


def texts(path: Path) -> Iterator[tuple[int, str, bool]]:
    """Yield the prose of a file (comments, strings and names, or a page), its line, and whether it is a docstring."""
    content = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        bare = FENCE.sub(lambda block: "\n" * block[0].count("\n"), content)
        yield from ((number, line, False) for number, line in enumerate(bare.splitlines(), start=1))
        return
    for token in tokenize.generate_tokens(io.StringIO(content).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string, False
    tree = ast.parse(content)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, documented) and ast.get_docstring(node) is not None
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            yield node.lineno, node.value, id(node) in docstrings
        elif isinstance(node, ast.FunctionDef | ast.ClassDef) and "_" in node.name.strip("_"):
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
    """Yield the Python files and pages of folders, or of the whole tree."""
    for place in places:
        path = ROOT / place
        found = sorted([*path.rglob("*.py"), *path.rglob("*.md")]) if path.is_dir() else [path]
        yield from (file for file in found if ".venv" not in file.parts)


def main() -> int:
    """Print the hits of the clean folders, or with `--all` the count of each package."""
    if "--all" in sys.argv:
        whole = files("src", "tests", "benchmarks", "examples", "docs", "README.md", "CONTRIBUTING.md")
        counts = Counter("/".join(file.relative_to(ROOT).parts[:-1][:3]) for file in whole for _ in hits(file))
        print(*(f"{count:>6}  {place or 'top'}" for place, count in counts.most_common()), sep="\n")
        return 0
    found = [line for file in files(*(sys.argv[1:] or CLEAN)) for line in hits(file)]
    print(*found, sep="\n", end="\n" if found else "")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
