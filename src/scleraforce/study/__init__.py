"""The study: one typed record of everything that a run depends on, read from TOML."""

from scleraforce.study.form import CorneaStudy, FormStudy, RegionStudy, WaveStudy
from scleraforce.study.globe import GlobeStudy
from scleraforce.study.library import LibraryStudy
from scleraforce.study.mechanics import MechanicsStudy
from scleraforce.study.phantom import PhantomStudy
from scleraforce.study.raw_reader import RawReaderStudy
from scleraforce.study.reader import ReaderStudy
from scleraforce.study.records import (
    CalibrationStudy,
    ClassesStudy,
    DatasetGroup,
    DatasetStudy,
    EyeStudy,
    MeshStudy,
    NeedleStudy,
    NetworkStudy,
    OctStudy,
    SliceStudy,
    Study,
)
from scleraforce.study.sampled import Choice, Range, Sampled, draw, fixed
from scleraforce.study.scenes import (
    SceneEyeStudy,
    SceneOverStudy,
    SceneScannerStudy,
    ScenesStudy,
    SceneTissueStudy,
    SceneWindowStudy,
)
from scleraforce.study.supports import SupportsStudy
from scleraforce.study.tissue import TissueStudy
from scleraforce.study.toml import (
    PAPER_STUDY_TOML,
    PRESETS,
    format_study,
    parse_study,
    preset_toml,
    read_study,
    study_hash,
)
from scleraforce.study.wall_finder import WallFinderStudy

__all__ = [
    "PAPER_STUDY_TOML",
    "PRESETS",
    "CalibrationStudy",
    "Choice",
    "ClassesStudy",
    "CorneaStudy",
    "DatasetGroup",
    "DatasetStudy",
    "EyeStudy",
    "FormStudy",
    "GlobeStudy",
    "LibraryStudy",
    "MechanicsStudy",
    "MeshStudy",
    "NeedleStudy",
    "NetworkStudy",
    "OctStudy",
    "PhantomStudy",
    "Range",
    "RawReaderStudy",
    "ReaderStudy",
    "RegionStudy",
    "Sampled",
    "SceneEyeStudy",
    "SceneOverStudy",
    "SceneScannerStudy",
    "SceneTissueStudy",
    "SceneWindowStudy",
    "ScenesStudy",
    "SliceStudy",
    "Study",
    "SupportsStudy",
    "TissueStudy",
    "WallFinderStudy",
    "WaveStudy",
    "draw",
    "fixed",
    "format_study",
    "parse_study",
    "preset_toml",
    "read_study",
    "study_hash",
]
