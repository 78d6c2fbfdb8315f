"""The study: one typed record of everything that a run depends on, read from TOML."""

from scleraforce.study.form import CorneaStudy as CorneaStudy
from scleraforce.study.form import FormStudy as FormStudy
from scleraforce.study.form import RegionStudy as RegionStudy
from scleraforce.study.form import WaveStudy as WaveStudy
from scleraforce.study.globe import GlobeStudy as GlobeStudy
from scleraforce.study.library import LibraryStudy as LibraryStudy
from scleraforce.study.mechanics import MechanicsStudy as MechanicsStudy
from scleraforce.study.phantom import PhantomStudy as PhantomStudy
from scleraforce.study.raw_reader import RawReaderStudy as RawReaderStudy
from scleraforce.study.reader import ReaderStudy as ReaderStudy
from scleraforce.study.records import (
    CalibrationStudy as CalibrationStudy,
)
from scleraforce.study.records import (
    ClassesStudy as ClassesStudy,
)
from scleraforce.study.records import (
    DatasetGroup as DatasetGroup,
)
from scleraforce.study.records import (
    DatasetStudy as DatasetStudy,
)
from scleraforce.study.records import (
    EyeStudy as EyeStudy,
)
from scleraforce.study.records import (
    MeshStudy as MeshStudy,
)
from scleraforce.study.records import (
    NeedleStudy as NeedleStudy,
)
from scleraforce.study.records import (
    NetworkStudy as NetworkStudy,
)
from scleraforce.study.records import (
    OctStudy as OctStudy,
)
from scleraforce.study.records import (
    SliceStudy as SliceStudy,
)
from scleraforce.study.records import (
    Study as Study,
)
from scleraforce.study.sampled import Choice as Choice
from scleraforce.study.sampled import Range as Range
from scleraforce.study.sampled import Sampled as Sampled
from scleraforce.study.sampled import draw as draw
from scleraforce.study.sampled import fixed as fixed
from scleraforce.study.scenes import (
    SceneEyeStudy as SceneEyeStudy,
)
from scleraforce.study.scenes import (
    SceneOverStudy as SceneOverStudy,
)
from scleraforce.study.scenes import (
    SceneScannerStudy as SceneScannerStudy,
)
from scleraforce.study.scenes import (
    ScenesStudy as ScenesStudy,
)
from scleraforce.study.scenes import (
    SceneTissueStudy as SceneTissueStudy,
)
from scleraforce.study.scenes import (
    SceneWindowStudy as SceneWindowStudy,
)
from scleraforce.study.supports import SupportsStudy as SupportsStudy
from scleraforce.study.tissue import TissueStudy as TissueStudy
from scleraforce.study.toml import (
    PAPER_STUDY_TOML as PAPER_STUDY_TOML,
)
from scleraforce.study.toml import (
    PRESETS as PRESETS,
)
from scleraforce.study.toml import (
    format_study as format_study,
)
from scleraforce.study.toml import (
    parse_study as parse_study,
)
from scleraforce.study.toml import (
    preset_toml as preset_toml,
)
from scleraforce.study.toml import (
    read_study as read_study,
)
from scleraforce.study.toml import (
    study_hash as study_hash,
)
from scleraforce.study.wall_finder import WallFinderStudy as WallFinderStudy
