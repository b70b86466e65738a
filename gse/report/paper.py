"""Table 4-1 of [S]: what the sensors of LAPAN-A2 and LAPAN-ORARI reached, and its layout for the sensor under test.

[S]: Saifudin & Triharjanto, the neighbour technique of the LAPAN star sensor, section 4.
"""

import math
from dataclasses import dataclass

from gse.statistics.subject_statistics import SubjectStatistics

ARCMIN_PER_DEG = 60.0
LIMIT_DEG = 1 / 60
"""The greatest error that [S] allows: 1 arcmin."""


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One sensor: mean |dRA| (not times cos DE) and mean |dDE| in degrees, and its processing time as text."""

    name: str
    d_ra_deg: float
    d_de_deg: float
    time: str


PAPER = (
    PaperRow("Star Sensor 1 of the paper", 0.006676, 0.009221, "< 200 ms"),
    PaperRow("Star Sensor 2 of the paper", 0.003552, 0.00866, "< 200 ms"),
    PaperRow("Star Sensor 3 of the paper", 0.005, 0.005, "< 200 ms"),
    PaperRow("mean of the paper", 0.005076, 0.007627, ""),
)


def this_sensor(name: str, figures: SubjectStatistics) -> PaperRow:
    """The row of the sensor under test; its time is the 99th percentile, of this host where none is stated."""
    p99_ms = figures.time_ms.p99
    where = "" if figures.time_is_stated else " (this host)"
    time = "not recorded" if math.isnan(p99_ms) else f"{p99_ms:.3g} ms{where}"
    return PaperRow(name, figures.mean_abs_d_ra_deg, figures.mean_abs_d_de_deg, time)
