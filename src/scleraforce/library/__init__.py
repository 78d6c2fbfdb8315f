"""The response library: finite-strain load paths over thickness, pressure and force,
interpolated to any eye.
"""

from scleraforce.library.library_file import (
    load_library as load_library,
    save_library as save_library,
)
from scleraforce.library.wall_responses import (
    INNER as INNER,
    OUTER as OUTER,
    Library as Library,
    Responses as Responses,
)
