"""The sources that decide a classifier of linear mechanics: its slices and its weights."""

from scleraforce.source_hash import PACKAGE, hash_files, sources_in_rooms

STEPS = (
    "scleraforce.dataset.samples", "scleraforce.dataset.plan", "scleraforce.learning.classifier.training",
    "scleraforce.learning.classifier.graph", "scleraforce.learning.classifier.half_weights",
)  # fmt: skip
# Imported on the way, and not run: the store, data sets of finite strain, a calibration's modulus.
NOT_RUN = (
    "scleraforce.dataset.generate", "scleraforce.dataset.store", "scleraforce.dataset.library_samples",
    "scleraforce.dataset.modulus", "scleraforce.dataset.workers",
)  # fmt: skip
ROOMS = ("dataset", "eye", "learning", "mechanics", "section")


def classifier_files() -> list[str]:
    """Return the files that count, as places in the package."""
    return sources_in_rooms(*STEPS, rooms=ROOMS, beside=["study/sampled.py"], apart_from=NOT_RUN)


def classifier_sources_hash() -> str:
    """Return the SHA-256, in hexadecimal, of the sources that decide a classifier."""
    return hash_files(PACKAGE / name for name in classifier_files())
