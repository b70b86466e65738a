"""What a session of a station must be to pass, before there is one."""

import functools
import math
from collections.abc import Mapping

from drivers.clock import read_clock
from gse.assessment.planning import Expected
from gse.assessment.session_plan import AxisQuestion, SessionPlan, session_plan
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
    """The plan of a session now, of a sensor that performs as expected; as ``gse plan`` without options."""
    return _planned(questions(station, {}, RATE_HZ), station.limits, expected_availability(station))


@functools.lru_cache(maxsize=8)
def _planned(axes: tuple[AxisQuestion, ...], limits: Limits, availability: float) -> SessionPlan:
    """Cached: it takes some seconds of simulation."""
    return session_plan(axes, limits, availability=availability, frames_per_s=RATE_HZ)


def expected_availability(station: Station) -> float:
    """Half-way between the limit and all frames."""
    return (1 + station.limits.availability) / 2


def questions(station: Station, given: Mapping[str, float | None], frames_per_s: float) -> tuple[AxisQuestion, ...]:
    """What is expected of each axis: as ``given`` by name, else of whole-pixel positions of 20 stars."""

    camera, limits = station.sensor.camera(), station.limits
    pixel_arcsec = camera.pixel_rad * ARCSEC_PER_RAD
    noise = _or(given.get("noise_arcsec"), CENTROID_SIGMA_PX * pixel_arcsec / math.sqrt(_STARS))
    # The roll error acts at the stars' distance from the boresight: root mean square over the detector.
    reach_rad = math.hypot(camera.rows, camera.columns) / math.sqrt(12) / camera.focal_length_px
    roll_noise = _or(given.get("roll_noise_arcsec"), noise / reach_rad)
    tau_s = _or(given.get("tau_s"), pixel_arcsec / EARTH_RATE_ARCSEC_PER_S)
    bias = _or(given.get("bias_arcsec"), 0.0)
    truth_arcsec = _truth_arcsec(station, given.get("truth_arcsec"))
    stated = limits.d_ra_cosde_arcsec, limits.d_de_arcsec
    ra_limit, de_limit = (_or(given.get("limit_arcsec"), limit) for limit in stated)
    on_sky, about = Expected(bias, noise, tau_s, frames_per_s), Expected(0.0, roll_noise, tau_s, frames_per_s)
    return (
        AxisQuestion("dRA*", on_sky, ra_limit, truth_arcsec),
        AxisQuestion("dDE", on_sky, de_limit, truth_arcsec),
        AxisQuestion("roll", about, limits.d_roll_arcsec, 0.0),
    )


def _truth_arcsec(station: Station, given: float | None) -> float:
    """The standard uncertainty of truth for a session now, with a perfect clock; the greater of both axes."""
    if given is not None:
        return given
    utc_ns = read_clock().utc_ns
    budget = truth_budget(SessionFacts(station.site, station.mount, EarthOrientation.from_disk(utc_ns), utc_ns, 0.0))
    return round(max(budget.axes[axis].one_sided_arcsec for axis in ("d_ra_cosde", "d_de")) / COVERAGE_FACTOR, 3)


def _or(given: float | None, default: float) -> float:
    return default if given is None else given
