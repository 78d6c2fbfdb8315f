"""The page on hazards has ISO 14971's columns and cites requirements that tests show; the trace is of today's tests."""

import re
import tomllib
from pathlib import Path

import pytest

from requirements_trace import ROOT, STATED, trace_page

PAGE = (ROOT / "docs" / "hazards.md").read_text(encoding="utf-8")
HEAD = ["", "hazard", "foreseeable sequence of events", "hazardous situation", "what the software does", "verified by",
        "what is left"]  # fmt: skip
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if line.startswith("| H")]
REQUIREMENTS = tomllib.loads(STATED.read_text(encoding="utf-8"))["requirement"]


def test_the_tables_have_the_columns_of_a_risk_file_and_no_empty_cell() -> None:
    heads = [line for line in PAGE.splitlines() if line.startswith("| | hazard")]
    assert heads
    assert all([cell.strip() for cell in line.strip("|").split("|")] == HEAD for line in heads)
    assert all(len(row) == len(HEAD) and all(row) for row in ROWS)
    assert [row[0] for row in ROWS] == [f"H{number}" for number in range(1, len(ROWS) + 1)]


def test_each_hazard_cites_requirements_and_each_requirement_belongs_to_one() -> None:
    cited = [name for row in ROWS for name in row[HEAD.index("verified by")].split(", ")]
    assert set(cited) == {requirement["id"] for requirement in REQUIREMENTS}
    assert [one["id"] for one in REQUIREMENTS] == [f"R{number}" for number in range(1, len(REQUIREMENTS) + 1)]


def test_the_trace_is_of_todays_tests() -> None:
    written = (ROOT / "docs" / "requirements.md").read_text(encoding="utf-8")
    assert written == trace_page(), "run `make trace`"


@pytest.mark.parametrize("page", ["hazards.md", "requirements.md"])
def test_research_use_is_stated_first(page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8").split("\n\n", 2)[1]
    assert text.startswith("**Research use only: not a medical device, not for use on patients.**")


@pytest.mark.parametrize(
    ("tests", "fault"),
    [
        ('["tests/monitor/test_decision.py::test_that_is_not_there"]', "there is no such test"),
        ('["tests/nowhere.py::test_the_table_is_total"]', "there is no such test"),
        ("[]", "R1: no test"),
    ],
)
def test_a_requirement_without_a_test_is_found(tests: str, fault: str, tmp_path: Path) -> None:
    stated = tmp_path / "requirements.toml"
    stated.write_text(f'[[requirement]]\nid = "R1"\ntext = "..."\ntests = {tests}\n')
    with pytest.raises(ValueError, match=fault):
        trace_page(stated)


def test_a_slow_test_is_marked_so() -> None:
    page = trace_page()
    assert re.search(r"::test_a_bound_that_adapts\w+` \*\(slow\)\*", page)
    assert re.search(r"::test_a_steep_ramp_is_foreseen`$", page, flags=re.MULTILINE)
