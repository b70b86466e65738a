"""The frame protocols of star sensors: bytes to messages and back, without port, clock or thread.

Part of gse-star-sensor, which gse/process/own_packages.py looks for here.
"""

from protocols.commands import ACK, NO_ANSWER, Answered, AwaitedAnswer, CommandLayout
from protocols.errors import DescriptionError, EncodeError, ProtocolError
from protocols.frame import REASONS, Discard, Frame
from protocols.framing import FrameDecoder
from protocols.items import COLOURS, Condition, Item, ItemValue
from protocols.messages import (
    Ack,
    AttitudeMessage,
    Command,
    Message,
    Nak,
    Other,
    PanoramaColumns,
    PanoramaMessage,
    StarsMessage,
    StatusMessage,
)
from protocols.protocol import Protocol, built_in_names, load_protocol, parse_protocol
from protocols.sequence import Arrival, SequenceTracker
from protocols.vocabulary import NAME_OF

__all__ = [
    "ACK",
    "COLOURS",
    "NAME_OF",
    "NO_ANSWER",
    "REASONS",
    "Ack",
    "Answered",
    "Arrival",
    "AttitudeMessage",
    "AwaitedAnswer",
    "Command",
    "CommandLayout",
    "Condition",
    "DescriptionError",
    "Discard",
    "EncodeError",
    "Frame",
    "FrameDecoder",
    "Item",
    "ItemValue",
    "Message",
    "Nak",
    "Other",
    "PanoramaColumns",
    "PanoramaMessage",
    "Protocol",
    "ProtocolError",
    "SequenceTracker",
    "StarsMessage",
    "StatusMessage",
    "built_in_names",
    "load_protocol",
    "parse_protocol",
]
