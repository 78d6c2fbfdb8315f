"""What a page was made from: versions, seeds, hashes, so that it can be made again."""

import platform
from datetime import UTC, datetime
from importlib.metadata import version

from scleraforce import __version__
from scleraforce.reader import Reader
from scleraforce.report.html import Html, table
from scleraforce.study import Study, study_hash

RESEARCH_USE = "Research use only: not a medical device."

PACKAGES = (
    "scleraforce",
    "numpy",
    "scipy",
    "opencv-python-headless",
    "onnxruntime",
    "zarr",
    "matplotlib",
)


def made_line(made_at: datetime) -> str:
    """Return which version made a page, when, and what it may be used for.

    >>> from datetime import timedelta, timezone
    >>> made_line(datetime(2026, 3, 1, 0, 30, tzinfo=timezone(timedelta(hours=1)))).partition(", ")[2]
    '2026-02-28 23:30 UTC. Research use only: not a medical device.'

    Raises:
        ValueError: `made_at` has no time zone.
    """
    if made_at.tzinfo is None:
        raise ValueError("made_at: a time without a time zone; give one, like datetime.now(UTC)")
    return f"scleraforce {__version__}, {made_at.astimezone(UTC):%Y-%m-%d %H:%M} UTC. {RESEARCH_USE}"


def provenance_table(study: Study, reader: Reader) -> Html:
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
