"""What `doctor` says of packages: what the metadata asks for is looked up, version by version."""

from importlib.metadata import PackageNotFoundError

import pytest

from scleraforce import installation
from scleraforce.installation import Finding

STATED = [
    "numpy>=2.0",
    'pywin32>=300; sys_platform == "never"',
    'torch>=2.6; extra == "train"',
    'onnx>=1.17; extra == "train"',
    'fastapi>=0.115; extra == "web"',
    'pytest>=8; extra == "dev"',
]


@pytest.fixture
def there(monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """The versions of what is installed, by name; a test changes them."""
    found = {"numpy": "2.4.6", "torch": "2.13.0+cpu", "onnx": "1.23.2", "fastapi": "0.165.0"}

    def version(name: str) -> str:
        if name not in found:
            raise PackageNotFoundError(name)
        return found[name]

    monkeypatch.setattr(installation, "requires", lambda _: STATED)
    monkeypatch.setattr(installation, "version", version)
    return found


def test_packages_of_this_system_and_each_extra_of_users_are_named_with_their_versions(there) -> None:
    assert list(installation.packages()) == [
        Finding("packages", "ok", "numpy 2.4.6"),
        Finding("extra [train]", "ok", "torch 2.13.0+cpu, onnx 1.23.2"),
        Finding("extra [web]", "ok", "fastapi 0.165.0"),
    ]
    del there["torch"]
    there["onnx"] = "1.2"
    assert list(installation.packages())[1] == Finding(
        "extra [train]", "missing", "no torch, onnx 1.2 is too old", "pip install 'scleraforce[train]'"
    )


def test_a_required_package_that_is_too_old_has_failed(there) -> None:
    there["numpy"] = "1.26.4"
    assert next(installation.packages()) == Finding(
        "packages", "failed", "numpy 1.26.4 is too old", "pip install --upgrade scleraforce"
    )
