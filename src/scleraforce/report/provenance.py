"""What a page was made from: versions, seeds, hashes, so that it can be made again."""

import platform
from importlib.metadata import version

from scleraforce.reader.model import ForceReader
from scleraforce.report.html import Html, table
from scleraforce.study import Study, study_hash

__all__ = ["provenance_table"]

PACKAGES = (
    "scleraforce",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "onnxruntime",
    "zarr",
    "matplotlib",
)


def provenance_table(study: Study, reader: ForceReader) -> Html:
    """Return study hash, seeds, model and data set hashes, and the versions of what computes."""
    provenance = reader.provenance
    rows: list[list[object]] = [
        ["study, SHA-256", study_hash(study)],
        ["data set, SHA-256", provenance.get("dataset_sha256", "")],
        ["seed of the data set", study.dataset.seed],
        ["seed of the network", study.network.seed],
        ["seed of the virtual eyes", study.phantom.seed],
        ["Python", platform.python_version()],
        ["PyTorch", provenance.get("torch", "")],
    ]
    rows += [[name, version(name)] for name in PACKAGES]
    return table(
        ["", "value"], rows, "What this run depends on; the same study and versions give the same result.", prose=True
    )
