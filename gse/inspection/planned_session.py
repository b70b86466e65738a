"""What a session of a station must be to pass, before there is one."""

import functools
import math

from drivers.clock import read_clock
from gse.assessment.planning import Expected
from gse.assessment.requirements import AxisQuestion, ExpectedSession
from gse.assessment.session_plan import SessionPlan, session_plan
from gse.axis import D_ROLL, ON_SKY
from gse.budget.truth_budget import SessionFacts, truth_budget
from gse.config.station import Station
from gse.constants import ARCSEC_PER_RAD, EARTH_RATE_ARCSEC_PER_S
from gse.limits import Limits
from gse.station.frame_processor import CENTROID_SIGMA_PX
from gse.statistics.guard_band import COVERAGE_FACTOR
from gse.truth import EarthOrientation

RATE_HZ = 10.0
_STARS = 20
"""In an ordinary panorama."""


def planned_session(station: Station) -> SessionPlan:
    """The plan of a session now, of a sensor that performs as expected; availability half-way between limit and 1."""
    return _planned(_questions(station), station.limits, (1 + station.limits.availability) / 2)


@functools.lru_cache(maxsize=8)
def _planned(axes: tuple[AxisQuestion, ...], limits: Limits, availability: float) -> SessionPlan:
    """Cached: it takes some seconds of simulation."""
    return session_plan(ExpectedSession(axes, limits, availability, RATE_HZ))


def _questions(station: Station) -> tuple[AxisQuestion, ...]:
    """What is expected of each axis: whole-pixel positions of 20 stars, each for the time a star takes over a pixel."""
    camera, limits = station.sensor.camera(), station.limits
    pixel_arcsec = camera.pixel_rad * ARCSEC_PER_RAD
    noise = CENTROID_SIGMA_PX * pixel_arcsec / math.sqrt(_STARS)
    # The roll error acts at the stars' distance from the boresight: root mean square over the detector.
    reach_rad = math.hypot(camera.rows, camera.columns) / math.sqrt(12) / camera.focal_length_px
    tau_s, truth_arcsec = pixel_arcsec / EARTH_RATE_ARCSEC_PER_S, _truth_arcsec(station)
    on_sky, about = Expected(0.0, noise, tau_s, RATE_HZ), Expected(0.0, noise / reach_rad, tau_s, RATE_HZ)
    return (
        *(AxisQuestion(axis, on_sky, limits.of(axis), truth_arcsec) for axis in ON_SKY),
        AxisQuestion(D_ROLL, about, limits.of(D_ROLL), 0.0),
    )


def _truth_arcsec(station: Station) -> float:
    """The standard uncertainty of truth for a session now, with a perfect clock; the greater of both axes."""
    utc_ns = read_clock().utc_ns
    budget = truth_budget(SessionFacts(station.site, station.mount, EarthOrientation.from_disk(utc_ns), utc_ns, 0.0))
    return round(max(budget.axes[axis.key].one_sided_arcsec for axis in ON_SKY) / COVERAGE_FACTOR, 3)
