"""The exceptions that scleraforce raises, as one family.

::

    ScleraforceError             anything that this package raises on purpose
    ├── InputError               what the user gave cannot be used: exit code 2
    │   ├── StudyError           study.toml
    │   ├── RecordingError       a recording folder: its settings, frames and forces
    │   ├── FrameError           one image file
    │   ├── DatasetError         a generated data set
    │   ├── CalibrationError     a calibration file, or recordings to calibrate on
    │   ├── ModelError           a model folder
    │   └── ProtocolError        bytes from or to a peer that OpenIGTLink lacks
    ├── SolverError              a numerical method failed: exit code 1
    ├── MessageError             an invalid message between the monitor's processes: 1
    └── LinkError                a connection was lost, or has an unexpected peer: 1

A message is one line: where (file and field), what was found, what to do or what is
allowed.
"""


class ScleraforceError(Exception):
    """Anything that this package raises on purpose."""


class InputError(ScleraforceError):
    """Unusable input; the message says where, and the allowed values.

    >>> import scleraforce as sf
    >>> try:
    ...     sf.read_study("nowhere.toml")
    ... except sf.InputError as fault:
    ...     print(fault)
    nowhere.toml: No such file or directory; ...
    """


class StudyError(InputError):
    """A study file, or a value in it, cannot be used."""


class RecordingError(InputError):
    """A recording folder cannot be used."""


class FrameError(InputError):
    """An image file cannot be used."""


class DatasetError(InputError):
    """A data set cannot be used."""


class CalibrationError(InputError):
    """A calibration file or its recordings cannot be used."""


class ModelError(InputError):
    """A model folder cannot be used."""


class ProtocolError(InputError):
    """Bytes of a peer that are not the protocol, or a message that the protocol cannot
    carry.
    """


class SolverError(ScleraforceError):
    """A numerical method failed on valid input."""


class MessageError(ScleraforceError):
    """A message from one process of the monitor to another is invalid."""


class LinkError(ScleraforceError):
    """An open connection was lost, or its other end does not do what it must."""
