"""The errors of the station.

GseError                exit code 2 unless a subclass says otherwise: what this computer has not, or does not do
    UsageError          what was asked for does not make sense
        ConfigError     the station file
        CatalogError    a star catalogue file
        TableError      a panorama table or another input file
        TruthError      no truth for this instant or site
    CampaignError       exit code 3: a campaign that is not finished; what it committed is whole
"""


class GseError(Exception):
    """Root of all errors of the station; the text is one or two lines for a person."""

    exit_code = 2


class UsageError(GseError):
    """What was asked for does not make sense."""


class ConfigError(UsageError):
    """A station file that is missing, malformed or out of range; the text names file, line and key."""


class CatalogError(UsageError):
    """A star catalogue file that is missing, foreign or corrupt."""


class TableError(UsageError):
    """A panorama table or other input file that cannot be read; the text names file and line."""


class TruthError(UsageError):
    """There is no sidereal truth for this instant or site."""


class CampaignError(GseError):
    """A campaign that could not be finished; what it committed is whole, and the same command goes on."""

    exit_code = 3
