"""The response library: finite-strain load paths over thickness, pressure and force,
interpolated to any eye.
"""

from scleraforce.library.files import (
    load_library as load_library,
    save_library as save_library,
)
from scleraforce.library.responses import (
    INNER as INNER,
    OUTER as OUTER,
    Library as Library,
    Responses as Responses,
)
