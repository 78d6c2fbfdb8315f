"""The app on a folder of the test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from running_app import Client, running_app


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Client]:
    """The app of the test's own folder, with a client that has its cookie."""
    with running_app(tmp_path) as client:
        yield client.open()
