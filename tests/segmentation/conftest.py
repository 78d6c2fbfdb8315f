import pytest

from scleraforce.models import SHIPPED_WALL_FINDER
from scleraforce.reader.model import load_wall_finder
from scleraforce.segmentation.wall_finder import WallFinder


@pytest.fixture(scope="module")
def shipped() -> WallFinder:
    return load_wall_finder(SHIPPED_WALL_FINDER)
