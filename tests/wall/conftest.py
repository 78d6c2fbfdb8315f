import pytest

from scleraforce.reading.load_model import load_wall_finder
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.wall.wall_network import WallFinder


@pytest.fixture(scope="module")
def shipped() -> WallFinder:
    return load_wall_finder(SHIPPED_WALL_FINDER)
