"""The errors of the drivers.

DriverError
    PortError           the port cannot be opened or used; says what was asked for and what to try
        UrlError        it never will: its URL is wrong
    CaptureError        a session file that is missing, foreign or damaged beyond reading
    CommandError        a command that the sensor refused (NAK) or never answered
"""


class DriverError(Exception):
    """Root of all errors of the drivers; the text is one or two lines for a person."""


class PortError(DriverError):
    """A port that cannot be opened or used."""


class UrlError(PortError):
    """A URL that is wrong, or has an option that is: no waiting helps."""


class CaptureError(DriverError):
    """A session file that is missing, foreign or damaged beyond reading."""


class CommandError(DriverError):
    """A command that the sensor refused or never answered."""
