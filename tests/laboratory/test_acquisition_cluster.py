"""Many virtual acquisitions made by a Dask cluster: the bytes of those made here."""

import signal
from pathlib import Path

import pytest
from effects import contents
from workers import NEEDS_DASK, Cluster

from scleraforce.cluster import cluster_workers
from scleraforce.laboratory.acquisition import Acquisition, acquire_all, sample_eyes
from scleraforce.laboratory.phantom import write_phantom
from scleraforce.laboratory.virtual_eye import study_sections
from scleraforce.study import MeshStudy, OctStudy, Study

pytestmark = [*NEEDS_DASK, pytest.mark.slow]

STUDY = Study(oct=OctStudy(columns=128, rows=96), mesh=MeshStudy(divisions=4, level=0))
ACQUISITION = Acquisition((0.002, 0.01), STUDY, 3)


def test_a_worker_killed_half_way_changes_no_byte(tmp_path: Path) -> None:
    eyes = sample_eyes(STUDY, 4, 3, "pig", {})
    cluster = Cluster(tmp_path)
    try:
        victim, _ = cluster.worker(), cluster.worker()

        def kill(done: int) -> None:
            if done:
                victim.send_signal(signal.SIGKILL)

        workers = cluster_workers(cluster.address)
        assert acquire_all(tmp_path / "there", eyes, ACQUISITION, workers=workers, progress=kill) == 4
        assert victim.wait() == -signal.SIGKILL
    finally:
        cluster.end()
    for eye in eyes:
        write_phantom(tmp_path / "here" / eye.id, ACQUISITION.plan(eye), study_sections(eye, STUDY), STUDY)
    assert contents(tmp_path / "there") == contents(tmp_path / "here")
