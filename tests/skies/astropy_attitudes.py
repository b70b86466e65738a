"""Attitudes that a sensor answers under skies of astropy alone, on sites and mounts that may not be the stated ones."""

import functools

import numpy as np

from gse.diagnosis.gross_causes import RawAttitudes
from gse.inspection.made_session import AstropySky, mounted
from gse.truth import EarthOrientation
from gse.values.attitude import solve_attitude
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.site import Site

START_NS = from_text("2026-03-20T15:00:00Z")
TABLE = EarthOrientation.from_disk(START_NS)
AIR = {"pressure_hpa": 985.0, "temperature_c": 15.0}
MUNICH = Site(latitude_deg=48.2, longitude_deg=11.6, height_m=500.0, **AIR)
BOGOR = Site(latitude_deg=-6.53, longitude_deg=106.7, height_m=250.0, **AIR)
CERRO = Site(latitude_deg=-35.3, longitude_deg=-70.2, height_m=400.0, **AIR)
SITES = (MUNICH, BOGOR, CERRO)
MOUNT = Mount(azimuth_deg=130.0, altitude_deg=60.0, roll_deg=25.0)
GRID = np.array([[x, y, 1.0] for x in (-0.08, 0.0, 0.08) for y in (-0.08, 0.0, 0.08)])
FIELD = GRID / np.linalg.norm(GRID, axis=1)[:, None]


@functools.cache
def attitudes(site: Site, mount: Mount, clock_s: float = 0.0, frames: int = 3) -> RawAttitudes:
    """What a sensor on a true mount at a true site answers; its host's clock is ``clock_s`` fast."""
    utc_ns = START_NS + np.arange(frames) * 20 * NS_PER_S
    sky = AstropySky(site)
    axes = mounted(mount.azimuth_deg, mount.altitude_deg, mount.roll_deg)
    right_down_out = np.array([axes[0], -axes[1], axes[2]])
    near = sky.boresight_and_up(np.broadcast_to(axes, (frames, 3, 3)), utc_ns, air=True)
    rotations = []
    for boresight, up, instant in zip(*near, utc_ns, strict=True):
        about = np.array([np.cross(boresight, up), -up, boresight])
        stars = FIELD @ about
        seen = sky.seen(stars, np.array([instant]))[0] @ right_down_out.T
        rotations.append(solve_attitude(seen, stars, 1e-4).icrs_to_sensor)
    return RawAttitudes(utc_ns + round(clock_s * NS_PER_S), np.array(rotations), FIELD)
