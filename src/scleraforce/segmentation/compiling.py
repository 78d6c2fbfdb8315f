"""Whether this process finds walls by compiled loops: only one that asked for it, as Numba takes long to import."""

from scleraforce.compiled import can_compile, code_is_kept

CALLED = ("boundaries", "contrast", "lit", "slices", "workplace")  # of the kernels: the others are called by these

_compiles = False


def compile_wall() -> bool:
    """Have walls found by compiled loops in this process from now on, where it can; return whether it does.

    For processes that read many frames: the import takes 0.3 s, and the first two frames as long as the compilation,
    half a minute on an idle machine, where `compiled_is_kept` says no.
    """
    global _compiles
    _compiles = can_compile()
    return _compiles


def wall_is_compiled() -> bool:
    """Return whether this process finds walls by compiled loops."""
    return _compiles


def compiled_is_kept() -> bool:
    """Return whether a process before this one has left the compiled loops in the user's cache."""
    return all(code_is_kept(f"scleraforce.segmentation.kernels.{module}") for module in CALLED)
