"""The user's cache: made once, found again, repaired, resumed, and safe among several makers."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from analytic_library import solve_analytic

from scleraforce.errors import InputError
from scleraforce.library.build import build_library, cached_library, library_cache
from scleraforce.library.plan import LibraryPlan
from scleraforce.study import LibraryStudy, Study

UNITS = 5 * 16 + 8 * 4 * 4  # paths of each stiffening, and those with other supports
STUDY = Study(library=LibraryStudy(thicknesses=4, tensions=4, tips=5, elements=8))


def places(folder):
    return sorted(path.suffix for path in folder.iterdir())


@pytest.mark.slow
def test_a_library_is_built_on_first_need_only(tmp_path):
    done = []
    first = cached_library(STUDY, folder=tmp_path, workers=1, progress=done.append, solve=solve_analytic)
    assert sum(done) == UNITS
    again = cached_library(STUDY, folder=tmp_path, progress=done.append)
    assert sum(done) == UNITS
    assert (first.curves_tpdbnc == again.curves_tpdbnc).all()
    assert places(tmp_path) == [".lock", ".zarr"]


@pytest.mark.slow
def test_an_interrupted_build_is_taken_up(tmp_path):
    done = []

    def interrupt(count):
        done.append(count)
        if sum(done) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cached_library(STUDY, folder=tmp_path, workers=1, progress=interrupt, solve=solve_analytic)
    assert places(tmp_path) == [".begun", ".lock"]
    done.clear()
    cached_library(STUDY, folder=tmp_path, workers=1, progress=done.append, solve=solve_analytic)
    assert done[0] == 3
    assert places(tmp_path) == [".lock", ".zarr"]


@pytest.mark.slow
def test_a_damaged_library_and_a_useless_beginning_are_made_again(tmp_path):
    cached_library(STUDY, folder=tmp_path, workers=1, solve=solve_analytic)
    (place,) = tmp_path.glob("*.zarr")
    shutil.rmtree(place / "curves" / "c" / "1")
    (place.with_suffix(".begun")).mkdir()
    (place.with_suffix(".begun") / "rubbish").write_text("")
    done = []
    cached_library(STUDY, folder=tmp_path, workers=1, progress=done.append, solve=solve_analytic)
    assert sum(done) == UNITS
    assert places(tmp_path) == [".lock", ".zarr"]


@pytest.mark.slow
def test_makers_at_the_same_time_do_no_harm_and_one_of_them_builds(tmp_path):
    code = (
        "import sys; from pathlib import Path; from analytic_library import solve_slowly\n"
        "from scleraforce.library.build import cached_library\n"
        "from scleraforce.study import LibraryStudy, Study\n"
        "if __name__ == '__main__':\n"
        "    study = Study(library=LibraryStudy(thicknesses=4, tensions=4, tips=5, elements=8))\n"
        "    done = []\n"
        "    library = cached_library(study, folder=Path(sys.argv[1]), workers=1, progress=done.append, "
        "solve=solve_slowly)\n"
        "    print(sum(done), library.force_ratio_tpd.sum())\n"
    )
    script = tmp_path / "make.py"
    script.write_text(code)
    support = str(Path(__file__).parents[1] / "support")
    makers = [
        subprocess.Popen(
            [sys.executable, script, tmp_path / "cache"], env={"PYTHONPATH": support}, stdout=subprocess.PIPE, text=True
        )
        for _ in range(3)
    ]
    answers = [maker.communicate(timeout=300)[0].split() for maker in makers]
    assert sorted(int(built) for built, _ in answers) == [0, 0, UNITS]
    assert len({total for _, total in answers}) == 1


@pytest.mark.slow
def test_the_key_changes_with_the_plan_and_with_the_code(monkeypatch, tmp_path):
    cached_library(STUDY, folder=tmp_path, workers=1, solve=solve_analytic)
    monkeypatch.setattr(LibraryPlan, "key", "another code")
    cached_library(STUDY, folder=tmp_path, workers=1, solve=solve_analytic)
    assert len(list(tmp_path.glob("*.zarr"))) == 2


def test_the_cache_lies_where_the_system_keeps_caches(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "caches"))
    assert library_cache() == tmp_path / "caches" / "scleraforce" / "libraries"


def test_a_cache_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="XDG_CACHE_HOME"):
        cached_library(STUDY, folder=tmp_path / "file" / "below", solve=solve_analytic)


@pytest.mark.slow
def test_the_cache_holds_what_build_library_makes(tmp_path):
    cached_library(STUDY, folder=tmp_path / "cache", workers=1, solve=solve_analytic)
    build_library(STUDY, tmp_path / "built", workers=1, solve=solve_analytic)
    (place,) = (tmp_path / "cache").glob("*.zarr")
    names = [path.relative_to(place) for path in sorted(place.rglob("*")) if path.is_file()]
    assert all((place / name).read_bytes() == (tmp_path / "built" / name).read_bytes() for name in names)
