"""The health of the host clock, as the kernel tells it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ClockReading:
    """What the kernel says of the host clock at an instant.

    ``source`` names what disciplines it (``kernel PLL``, ``simulated``, ``unsynchronised``, ...); ``offset_s`` is the
    kernel's current estimate, ``error_bound_s`` its bound on the error.
    """

    utc_ns: int
    mono_ns: int
    source: str
    synchronised: bool
    offset_s: float
    error_bound_s: float
