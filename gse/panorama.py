"""A panorama: the objects that the sensor saw in one exposure."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

MAX_OBJECTS = 30
"""Slots of a panorama, [S] section 2."""


@dataclass(frozen=True, slots=True, eq=False)
class Panorama:
    """The objects of one exposure, brightest first, at the UTC of mid-exposure.

    ``xy_px`` is (N, 2), columns x then rows y, 0-based at pixel centres; ``index`` is (N,), the brightness on the
    sensor's scale; ``flags`` are the fault bits of the sensor by name (``overexposed``, ``detector fault``, ...).
    ``time_us`` is the sensor's own clock, ``host_utc_ns`` the host's when the frame's first byte was read, 0 if
    unknown, ``sequence`` the frame's number on the wire, ``problems`` what the sensor should not have sent, in words.
    ``wire_rows`` (N,) is the place of each object on the wire, None where that is its place here.
    """

    utc_ns: int
    xy_px: NDArray[np.float64]
    brightness: NDArray[np.float64]
    frame_no: int = 0
    exposure_s: float = 0.0
    time_us: int = 0
    host_utc_ns: int = 0
    sequence: int = 0
    problems: tuple[str, ...] = ()
    temperature_c: float = float("nan")
    flags: frozenset[str] = field(default_factory=frozenset)
    wire_rows: NDArray[np.int64] | None = None
