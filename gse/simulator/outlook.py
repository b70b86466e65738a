"""Outlook of a simulated sensor: what it looks at, in words for whoever starts it."""

import math

import numpy as np

from gse.config.station import Station
from gse.simulator.photometry import Photometry
from gse.simulator.scenario import Scenario
from gse.simulator.scene import SimulatedScene, scene_of
from gse.simulator.sky import MOON, SUN
from gse.values.instant import to_text

_MERGED_PX = 2.0
_TEMPERATURE_C = 20.0
_BELOW = "the mount looks below the horizon"


def outlook(station: Station, scenario: Scenario, hint: str) -> str:
    """What a device sees at the start of a scenario: Sun, Moon, and the stars within its limit in the field.

    ``hint`` says what to do where daylight leaves no star.
    """
    utc_ns = scenario.start_utc_ns
    scene = scene_of(station, scenario, np.random.default_rng(0), _MERGED_PX)
    if (shown := station.mount.inertial) is not None:
        stars = _stars(scene, station, scenario, utc_ns)
        return f"looks at what is shown: RA {shown.ra_deg:g}, DE {shown.de_deg:g} deg; {stars} stars in the field"
    bodies = scene.bodies(utc_ns).track.directions(utc_ns)
    sun_deg, moon_deg = (math.degrees(math.asin(float(bodies[body][2]))) for body in (SUN, MOON))
    site = station.site
    where = f"{to_text(utc_ns, 0)} at {site.latitude_deg:g}, {site.longitude_deg:g}"
    sun = f"the Sun is {abs(sun_deg):.0f} deg {'up' if sun_deg >= 0 else 'down'} at this site"
    moon = f"the Moon {abs(moon_deg):.0f} deg {'up' if moon_deg >= 0 else 'down'}"
    if scene.horizon_to_sensor[2, 2] <= 0:
        return f"looks at {where}: {_BELOW}: no stars"
    stars = _stars(scene, station, scenario, utc_ns)
    if stars:
        return f"looks at {where}: {sun}, {moon}; {stars} stars in the field"
    return f"looks at {where}: {sun}, {moon}: no stars" + (f"; {hint}" if sun_deg > -12 else "")


def _stars(scene: SimulatedScene, station: Station, scenario: Scenario, utc_ns: int) -> int:
    """How many stars stand on the detector that it can see; none where the sky overexposes it."""
    photometry = Photometry.from_scenario(station.sensor, scenario)
    sky_magnitude = scene.boresight_sky_magnitude(utc_ns)
    if photometry.is_overexposed(photometry.background_index(sky_magnitude, scenario.exposure_s)):
        return 0
    limit = photometry.faintest_magnitude(sky_magnitude, scenario.exposure_s, _TEMPERATURE_C)
    (xy_px,), magnitude = scene.objects(utc_ns, limit)
    return int((scene.camera.contains(xy_px) & (magnitude < limit)).sum())
