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


@pytest.mark.parametrize("ending", [".png", ".svg", ".pdf"])
def test_the_same_figure_gives_the_same_bytes(tmp_path: Path, ending: str) -> None:
    for name in ("one", "two"):
        figure = Figure()
        figure.subplots().plot([0, 1], [1, 0], label="line")
        write_figure(figure, tmp_path / f"{name}{ending}")
    assert (tmp_path / f"one{ending}").read_bytes() == (tmp_path / f"two{ending}").read_bytes()
