"""The study: one typed record of everything that a run depends on, read from TOML."""

from scleraforce.study.eye import (
    CorneaStudy as CorneaStudy,
    EyeStudy as EyeStudy,
    FormStudy as FormStudy,
    GlobeStudy as GlobeStudy,
    MechanicsStudy as MechanicsStudy,
    MeshStudy as MeshStudy,
    NeedleStudy as NeedleStudy,
    RegionStudy as RegionStudy,
    SupportsStudy as SupportsStudy,
    TissueStudy as TissueStudy,
    WaveStudy as WaveStudy,
)
from scleraforce.study.fields import Choice as Choice, Range as Range, Sampled as Sampled, draw as draw, fixed as fixed
from scleraforce.study.imaging import OctStudy as OctStudy, PhantomStudy as PhantomStudy, SliceStudy as SliceStudy
from scleraforce.study.networks import (
    NetworkStudy as NetworkStudy,
    RawReaderStudy as RawReaderStudy,
    ReaderStudy as ReaderStudy,
    WallFinderStudy as WallFinderStudy,
)
from scleraforce.study.records import (
    CalibrationStudy as CalibrationStudy,
    ClassesStudy as ClassesStudy,
    DatasetGroup as DatasetGroup,
    DatasetStudy as DatasetStudy,
    LibraryStudy as LibraryStudy,
    Study as Study,
)
from scleraforce.study.scenes import (
    SceneEyeStudy as SceneEyeStudy,
    SceneOverStudy as SceneOverStudy,
    SceneScannerStudy as SceneScannerStudy,
    ScenesStudy as ScenesStudy,
    SceneTissueStudy as SceneTissueStudy,
    SceneWindowStudy as SceneWindowStudy,
)
from scleraforce.study.toml import (
    PRESETS as PRESETS,
    format_study as format_study,
    parse_study as parse_study,
    preset_toml as preset_toml,
    read_study as read_study,
    study_hash as study_hash,
)
