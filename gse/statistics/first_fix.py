"""Time to first fix: from a cold start to the first good answer, as a list over the starts of a session.

A start is the first panorama, or the first one after the sensor's frame numbers began anew: a reset, or power that came
back. ECSS-E-ST-60-20C Rev.2 asks for the acquisition time as a distribution.
"""

import numpy as np
from numpy.typing import NDArray


def first_fixes_s(
    utc_ns: NDArray[np.int64], frame_no: NDArray[np.uint32], good: NDArray[np.bool_]
) -> tuple[float, ...]:
    """Seconds from the first panorama (M,) of each start to its first good answer; NaN where none came.

    ``frame_no`` (M,) are the sensor's own numbers, ``good`` (M,) tells answers that are neither absent nor false.
    """
    if len(utc_ns) == 0:
        return ()
    numbers = frame_no.astype(np.int64)
    starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0]) < 0)
    fixes = []
    for rows in np.split(np.arange(len(utc_ns)), starts):
        first = rows[good[rows]][:1]
        fixes.append(float(utc_ns[first[0]] - utc_ns[rows[0]]) / 1e9 if len(first) else float("nan"))
    return tuple(fixes)
