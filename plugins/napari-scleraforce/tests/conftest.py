"""A virtual recording, and Qt without a screen."""

import os
import shutil
from pathlib import Path

import pytest

import scleraforce as sf

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def virtual_eye(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of four frames of 12 to 36 mN."""
    folder = tmp_path_factory.mktemp("virtual") / "eye-1"
    sf.phantom(
        folder,
        sf.read_study(ROOT / "docs" / "quick.toml"),
        thickness_m=650e-6,
        youngs_modulus_pa=0.3e6,
        mechanics="finite-strain",
        forces_n=[0.012, 0.024, 0.036, 0.020],
    )

    return folder


@pytest.fixture
def eye(virtual_eye: Path, tmp_path: Path) -> Path:
    """Return a copy of the recording that a test may change."""
    return Path(shutil.copytree(virtual_eye, tmp_path / "eye-1"))
