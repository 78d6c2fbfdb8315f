"""scleraforce: the force of a needle on the eye, read from a single OCT slice."""

from importlib.metadata import version

__all__ = ["__version__"]
__version__ = version("scleraforce")
