"""What reads a file or folder of the user's takes its path as a string too, as a notebook gives it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from scleraforce.errors import InputError
from scleraforce.known.calibration_file import open_calibration, read_calibration
from scleraforce.learning.dataset import open_dataset, read_population_modulus
from scleraforce.library.files import load_library
from scleraforce.library.store import open_library
from scleraforce.reader import load_classifier, load_force_reader, load_model
from scleraforce.recording.folder import read_recording
from scleraforce.recording.images import read_frame, read_frame_image
from scleraforce.service.decision_log import DecisionLog, read_log
from scleraforce.study import read_study

READERS = (
    load_classifier, load_force_reader, load_library, load_model, open_calibration, open_dataset, open_library,
    read_calibration, read_frame, read_frame_image, read_population_modulus, read_recording, read_study,
)  # fmt: skip


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
def test_a_path_that_is_a_string_and_leads_nowhere_is_one_clear_line(
    read: Callable[[str], object], tmp_path: Path
) -> None:
    missing = str(tmp_path / "nothing")
    with pytest.raises(InputError, match="nothing") as told:
        read(missing)
    assert "\n" not in str(told.value)
    with pytest.raises(InputError) as same:
        read(Path(missing))  # type: ignore[arg-type]  # what the strings stand for
    assert str(same.value) == str(told.value)


def test_a_decision_log_is_read_by_a_string(tmp_path: Path) -> None:
    log = DecisionLog(tmp_path / "log")
    log.append({"kind": "note", "text": "said"})
    log.close()
    assert [part.record["text"] for part in read_log(str(tmp_path / "log")) if part.record] == ["said"]
