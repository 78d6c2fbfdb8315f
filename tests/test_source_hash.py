"""The hash of the sources that decide a result: it changes with them, and with nothing else."""

from pathlib import Path

import pytest

from scleraforce.source_hash import PACKAGE, hash_files, hash_sources, sources

FILES = {
    "__init__.py": "",
    "first.py": "from own.room import second\nimport json\n",
    "alone.py": "import own.first\n",
    "room/__init__.py": "from own.room.third import VALUE\n",
    "room/second.py": "def late():\n    from own import lazy\n    return lazy\n",
    "room/third.py": "VALUE = 3\n",
    "lazy.py": "from scleraforce.units import mn_to_n\n",
}


@pytest.fixture
def own(tmp_path: Path) -> dict[str, Path]:
    """A package of a few modules."""
    folder = tmp_path / "own"
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return {"own": folder}


def test_the_sources_are_all_that_is_imported_in_functions_too_and_no_other_package(own) -> None:
    found = sources("own.first", packages=own)
    assert {file.name for file in found if file.is_relative_to(own["own"])} == {
        "__init__.py", "first.py", "second.py", "third.py", "lazy.py"
    }  # fmt: skip
    assert PACKAGE / "units.py" in found
    assert all(file.is_relative_to(own["own"]) or file.is_relative_to(PACKAGE) for file in found)


@pytest.mark.parametrize("name", sorted(set(FILES) - {"alone.py"}))
def test_the_hash_changes_with_each_of_the_sources(own, name: str) -> None:
    before = hash_sources("own.first", packages=own)
    path = own["own"] / name
    path.write_text(path.read_text() + "# changed\n")
    assert hash_sources("own.first", packages=own) != before


def test_the_hash_does_not_change_with_other_sources_and_those_left_out(own) -> None:
    before = hash_sources("own.first", packages=own), hash_sources("own.first", apart_from=["own.lazy"], packages=own)
    (own["own"] / "alone.py").write_text("# changed")
    assert hash_sources("own.first", packages=own) == before[0]
    (own["own"] / "lazy.py").write_text("# changed")
    assert hash_sources("own.first", apart_from=["own.lazy"], packages=own) == before[1]


def test_a_file_that_is_renamed_or_whose_text_moves_to_another_changes_the_hash(own) -> None:
    folder = own["own"]
    both = [folder / "room" / "third.py", folder / "room" / "second.py"]
    before = hash_files(both, own)
    both[0].rename(folder / "room" / "fourth.py")
    assert hash_files([folder / "room" / "fourth.py", both[1]], own) != before
    first, second = "a = 1\n", "b = 2\n"
    (folder / "a.py").write_text(first + second)
    (folder / "b.py").write_text("")
    together = hash_files([folder / "a.py", folder / "b.py"], own)
    (folder / "a.py").write_text(first)
    (folder / "b.py").write_text(second)
    assert hash_files([folder / "b.py", folder / "a.py"], own) != together


def test_a_module_that_is_not_there_is_an_error(own) -> None:
    with pytest.raises(ValueError, match=r"own\.nothing: no such module"):
        hash_sources("own.nothing", packages=own)


def test_the_reproduction_counts_its_mechanics_and_its_network_but_neither_the_page_nor_the_monitor() -> None:
    found = sources("scleraforce.reproduction.stages", apart_from=["scleraforce.reproduction.page"])
    names = {file.relative_to(PACKAGE).with_suffix("").as_posix() for file in found}
    decide = {"mechanics/linear", "mechanics/axisymmetric/path", "learning/classifier/training", "reproduction/bent"}
    assert decide | {"study/records"} <= names
    assert not {name for name in names if name.startswith(("cli/", "service/", "monitor/"))}
    assert not {"report/html", "reproduction/page"} & names
