"""The frame protocols of star sensors: bytes to messages and back, without port, clock or thread.

Part of gse-star-sensor, which gse/process/own_packages.py looks for here.
"""

from protocols.errors import DescriptionError, EncodeError, ProtocolError
from protocols.frame import REASONS, Discard, Frame
from protocols.framing import FrameDecoder
from protocols.messages import (
    Ack,
    AttitudeMessage,
    Message,
    Nak,
    Other,
    PanoramaColumns,
    PanoramaMessage,
    Ping,
    Request,
    SetExposure,
    Start,
    StatusMessage,
    Stop,
)
from protocols.protocol import Protocol, built_in_names, load_protocol, parse_protocol
from protocols.sequence import Arrival, SequenceTracker
from protocols.vocabulary import NAME_OF

__all__ = [
    "NAME_OF",
    "REASONS",
    "Ack",
    "Arrival",
    "AttitudeMessage",
    "DescriptionError",
    "Discard",
    "EncodeError",
    "Frame",
    "FrameDecoder",
    "Message",
    "Nak",
    "Other",
    "PanoramaColumns",
    "PanoramaMessage",
    "Ping",
    "Protocol",
    "ProtocolError",
    "Request",
    "SequenceTracker",
    "SetExposure",
    "Start",
    "StatusMessage",
    "Stop",
    "built_in_names",
    "load_protocol",
    "parse_protocol",
]
