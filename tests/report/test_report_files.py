"""Files are written whole or not at all, under names that say their kind."""

from pathlib import Path

import pytest
from matplotlib.figure import Figure

from scleraforce.errors import InputError
from scleraforce.report.files import write_figure


@pytest.mark.parametrize(("name", "start"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml"), ("a.PDF", b"%PDF")])
def test_a_figure_is_what_its_name_says(tmp_path: Path, name: str, start: bytes) -> None:
    write_figure(Figure(), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(start)
    assert list(tmp_path.iterdir()) == [tmp_path / name]


def test_an_ending_that_is_no_picture_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.xlsx: give a name that ends in \.png, \.svg, \.pdf"):
        write_figure(Figure(), tmp_path / "a.xlsx")
    assert not list(tmp_path.iterdir())
