"""A workplace as a structure of Numba, which is one argument of a kernel; imported only where loops are compiled."""

from numba import types
from numba.experimental import structref


@structref.register
class _WorkplaceType(types.StructRef):
    """The type of a workplace."""


class Structure(structref.StructRefProxy):
    """See `workplace.Workplace`; to be made by a compiled function only, whose code is kept."""


structref.define_proxy(Structure, _WorkplaceType, ["sizes", "tables", "memory"])
