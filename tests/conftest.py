"""What all tests share."""

import gc
import signal
import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from types import ModuleType

import pytest
from hypothesis import HealthCheck, settings

import scleraforce  # noqa: F401 - before ONNX Runtime, which tests import too: it switches off what that sends

# A shell without job control starts background jobs with SIGINT and SIGQUIT ignored, and children inherit that: tests
# that send these to a child would wait for ever where CI runs that way.
for ignored, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGQUIT, signal.SIG_DFL)):
    if signal.getsignal(ignored) is signal.SIG_IGN:
        signal.signal(ignored, handler)

# No timed assertions: a machine with other work may draw slowly.
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")

# What collection makes - thousands of tests, the modules that they import - stays to the end: the collector of cycles
# looks at it never again.
gc.disable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.get_closest_marker("first") is None)


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


_FORMER = {
    "stiffened_library": "analytic_library",
    "without_rests": "analytic_library",
    "analytic_walls": "analytic_frames",
    "shafts": "analytic_frames",
    "drawn_eyes": "analytic_frames",
    "fixed_reader": "small_models",
    "fixed_network": "small_models",
    "raw_model": "small_models",
    "small_finder": "small_models",
    "told_finder": "small_models",
    "rehash": "small_models",
    "small_recording": "small_recordings",
    "known_forces": "small_recordings",
    "looked_at": "small_recordings",
    "frame_answers": "small_recordings",
    "logged_info": "small_recordings",
    "notebook_folder": "small_recordings",
    "calibration_file": "small_recordings",
    "calibrated_eye": "small_recordings",
    "dicom_file": "foreign_files",
    "plus_fields": "foreign_files",
    "format_frames": "foreign_files",
    "turned_clock": "small_monitor",
    "peer": "small_monitor",
    "fake_companion": "small_monitor",
    "decisions": "small_monitor",
    "clocked_client": "fake_monitor",
    "ended": "commands",
    "monitor_command": "commands",
    "machine_code": "commands",
    "traced": "effects",
    "folder_contents": "effects",
    "peak_memory": "effects",
    "parsed": "sources",
    "example_module": "sources",
}


class _FormerNames:
    """Former names of merged modules in tests/support, until all branches of this session are merged."""

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        return ModuleSpec(name, self) if name in _FORMER else None  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return import_module(_FORMER[spec.name])

    def exec_module(self, module: ModuleType) -> None:
        pass


sys.meta_path.append(_FormerNames())  # type: ignore[arg-type]
