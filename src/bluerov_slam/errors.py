"""Every error this package raises on purpose.

Bad bytes are not errors: decoders count them. What is here is either something a caller is expected to handle
(`ExpectedError`) or a mistake of ours (`BugError`).
"""


class BlueRovSlamError(Exception):
    """Base of every error of this package."""


class ExpectedError(BlueRovSlamError):
    """Something outside went wrong; the text tells a user what and how to cure it."""


class BugError(BlueRovSlamError):
    """A broken promise inside this package."""


class ConfigError(ExpectedError):
    """A setting is unknown, has the wrong type or lies outside its range; names file, key and allowed range."""


class LinkError(ExpectedError):
    """The serial link cannot be opened or was lost."""


class RecordingError(ExpectedError):
    """A recording cannot be read, written, named or found."""


class CommandError(ExpectedError):
    """A command to the sonar or the ESP32 was refused, failed or was not answered."""


class OutOfValidityError(ExpectedError):
    """A formula was asked for a value outside its published range."""


class ArrayGeometryError(ExpectedError):
    """The receivers of an acoustic array are too few, coincident or otherwise no array; names them."""
