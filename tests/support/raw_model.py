"""A model folder of kind "raw-reader" with random weights: what it reads means nothing."""

from dataclasses import replace
from pathlib import Path

from scleraforce.models.folder import write_folder
from scleraforce.study import RawReaderStudy, ReaderStudy, Study, format_study, study_hash

__all__ = ["RAW_STUDY", "write_raw_model"]

RAW_STUDY = replace(
    Study(),
    reader=ReaderStudy(channels=(6, 8), hidden=(24,), bins=32),
    raw_reader=RawReaderStudy(channels=(4, 6, 8)),
)


def write_raw_model(path: Path, study: Study = RAW_STUDY) -> None:
    """Write the folder."""
    import torch

    from scleraforce.learning.raw_reader import RawReaderNetwork, raw_reader_bytes
    from scleraforce.learning.reader import ReaderNetwork

    with torch.random.fork_rng():
        torch.manual_seed(3)
        reads_slices = ReaderNetwork(study.reader, study.slice, study.eye.radius_m)
        network = RawReaderNetwork(study, reads_slices).eval()
    content = raw_reader_bytes(network, {"study_sha256": study_hash(study)})
    write_folder(path, content, format_study(study), "# card\n", {"kind": "raw-reader", "metrics": {}})
