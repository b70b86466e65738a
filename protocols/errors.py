"""The errors of the protocols.

ProtocolError
    DescriptionError    a YAML description that cannot be compiled: file, key, reason
    EncodeError         a message that does not fit its wire format
"""


class ProtocolError(Exception):
    """Root of all errors of the protocols; the text is one or two lines for a person."""


class DescriptionError(ProtocolError):
    """A protocol description that cannot be compiled; the text names file, key and reason."""


class EncodeError(ProtocolError):
    """A message that does not fit its wire format."""
