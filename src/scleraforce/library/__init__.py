"""The response library: finite-strain load paths over thickness, pressure and force, interpolated to any eye."""

from scleraforce.library.files import load_library, save_library
from scleraforce.library.responses import INNER, OUTER, Library
from scleraforce.library.states import Responses

__all__ = ["INNER", "OUTER", "Library", "Responses", "load_library", "save_library"]
