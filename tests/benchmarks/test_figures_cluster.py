"""Eyes of the figures that a Dask cluster computes: the bytes of those computed here."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from effects import contents
from workers import NEEDS_DASK, Cluster

from figures import recordings
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.groups import draw_eyes
from scleraforce.errors import ScleraforceError
from scleraforce.processes import cluster_workers
from scleraforce.study import OctStudy, Study

pytestmark = [*NEEDS_DASK, pytest.mark.slow, pytest.mark.long]

BENCHMARKS = Path(recordings.__file__).parents[1]


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Cluster]:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(BENCHMARKS), os.environ.get("PYTHONPATH", "")]))
    made = Cluster(tmp_path)
    yield made
    made.end()


def small_eyes(count: int) -> list[FigureEye]:
    """Plain eyes with coarse meshes, small frames and two of them."""
    drawn = draw_eyes("plain", count, Study(oct=OctStudy(columns=128, rows=96)))
    coarse = replace(drawn[0].study.mesh, core=2, rings=4)
    return [replace(eye, study=replace(eye.study, mesh=coarse), shares=(0.1, 0.2)) for eye in drawn]


def test_eyes_are_the_same_on_a_cluster_that_loses_a_worker(cluster: Cluster, tmp_path: Path) -> None:
    victim, _ = cluster.worker(), cluster.worker()
    eyes, there, here = small_eyes(3), FiguresFolder(tmp_path / "there"), FiguresFolder(tmp_path / "here")
    bad = replace(eyes[0], eye=replace(eyes[0].eye, id="plain-99", iop_pa=14e3, youngs_modulus_pa=1e3))
    done: list[int] = []

    def kill_half_way(count: int) -> None:
        done.append(count)
        if sum(done) == 1:
            victim.send_signal(signal.SIGKILL)

    workers = cluster_workers(cluster.address)
    assert recordings.make_recordings(there, [*eyes, bad], workers, kill_half_way) == ("plain-99",)
    assert victim.wait() == -signal.SIGKILL
    assert sum(done) == 4
    for eye in eyes:
        recordings.make_eye(here, eye)
        assert recordings.read_made(there, eye).files == recordings.read_made(here, eye).files
    assert contents(there.path / "recordings") == contents(here.path / "recordings")
    assert recordings.make_recordings(there, eyes, workers, done.append) == ()
    assert sum(done) == 7  # found done


def test_workers_with_other_sources_are_refused(cluster: Cluster, tmp_path: Path, monkeypatch) -> None:
    cluster.worker()
    monkeypatch.setattr(recordings, "hash_sources", lambda *_: "another")
    with pytest.raises(ScleraforceError, match="a worker has other sources"):
        recordings.make_recordings(
            FiguresFolder(tmp_path / "there"), small_eyes(1), cluster_workers(cluster.address), lambda _: None
        )
    assert not (tmp_path / "there").exists()
