from scleraforce.base.errors import InputError as InputError
from scleraforce.base.version import __version__ as __version__
from scleraforce.front.api.calibrating import (
    CalibrationMethod as CalibrationMethod,
    calibrate as calibrate,
)
from scleraforce.front.api.exporting import export as export
from scleraforce.front.api.importing import (
    ImportSettings as ImportSettings,
    import_recording as import_recording,
)
from scleraforce.front.api.monitoring import monitor as monitor
from scleraforce.front.api.reading_frames import (
    evaluate as evaluate,
    load_model as load_model,
    read as read,
    save_wall as save_wall,
    segment as segment,
)
from scleraforce.front.api.simulating import phantom as phantom, simulate as simulate
from scleraforce.front.api.training import (
    generate as generate,
    library_of as library_of,
    train as train,
)
from scleraforce.lab.training.slice_dataset import open_dataset as open_dataset
from scleraforce.library.library_store import open_library as open_library
from scleraforce.recordings.formats.image_files import read_frame as read_frame
from scleraforce.recordings.recording_folder import read_recording as read_recording
from scleraforce.records.eye import Eye as Eye, Modulus as Modulus
from scleraforce.records.frame import Frame as Frame, Moment as Moment
from scleraforce.records.globe import Globe as Globe
from scleraforce.records.motion import Motion as Motion
from scleraforce.records.needle import Needle as Needle
from scleraforce.records.remark import Remark as Remark
from scleraforce.records.scan import Plane as Plane, Scan as Scan
from scleraforce.records.study import (
    Study as Study,
    parse_study as parse_study,
    read_study as read_study,
)
from scleraforce.records.tissue_relaxation import Relaxation as Relaxation
