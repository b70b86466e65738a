"""Stars on the detector of a wrongly described station, as error angles and residuals: no bytes, no identifier.

Catalogue stars over a true site and mount become pixels with noise; the station's own steps (camera, refraction,
attitude, truth) make rows of FRAME and MATCH of them, all frames at once.
"""

import math
from dataclasses import dataclass

import numpy as np

from gse.catalog import load_catalog
from gse.diagnosis.field_patterns import field_of_errors
from gse.diagnosis.fine_findings import Setting, fine_findings
from gse.diagnosis.session_model import SessionModel, error_series
from gse.station.columns import FRAME
from gse.station.session_tables import MATCH
from gse.truth import EarthOrientation, Refraction, SiderealTruth, horizon_to_sensor
from gse.values.camera import Camera
from gse.values.constants import ARCSEC_PER_RAD, ARCSEC_RAD
from gse.values.instant import NS_PER_S, from_text
from gse.values.mount import Mount
from gse.values.site import Site
from gse.values.star_influence import attitude_operators, boresight_shifts

START_NS = from_text("2026-03-20T15:00:00Z")
TABLE = EarthOrientation.from_disk(START_NS)
CAMERA = Camera(1024, 1024, 4169.905, (511.5, 511.5))
SETTINGS = (
    (
        Site(latitude_deg=-6.53, longitude_deg=106.70, height_m=250.0),
        Mount(azimuth_deg=130, altitude_deg=60, roll_deg=25),
    ),
    (
        Site(latitude_deg=48.2, longitude_deg=11.6, height_m=500.0),
        Mount(azimuth_deg=200, altitude_deg=45, roll_deg=-10),
    ),
    (
        Site(latitude_deg=-35.3, longitude_deg=-70.2, height_m=2400.0),
        Mount(azimuth_deg=20, altitude_deg=75, roll_deg=100),
    ),
)
FRAMES = 1200
STARS = 20
STARS_ICRS = load_catalog(stars=6000).icrs


@dataclass(frozen=True)
class Truth:
    """What is true where it is not what the station file says; times in s from the start."""

    site: Site
    mount: Mount
    camera: Camera = CAMERA
    clock_s: float = 0.0
    clock_ppm: float = 0.0
    clock_step_s: float = 0.0
    slip_arcsec: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moves_arcsec_per_h: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wave_arcsec: tuple[float, float] = (0.0, 0.0)
    wave_period_s: float = 1.0
    vibration_arcsec: float = 0.0
    at_s: float = 0.0


def made(truth, site, mount, duration_s, rng, *, noise_px=0.25, wander=(0.0, 1.0), whole_pixels=False):
    """Rows of FRAME and MATCH of a session that the station believes to be on ``site`` and ``mount``.

    ``wander`` is a correlated error of the boresight on each axis: arcsec and its time constant in s.
    """
    time_s = np.linspace(0, duration_s, FRAMES)
    true_ns = START_NS + np.round(time_s * NS_PER_S).astype(np.int64)
    late = (time_s > truth.at_s).astype(float)
    fast_s = truth.clock_s + 1e-6 * truth.clock_ppm * time_s + truth.clock_step_s * late
    utc_ns = true_ns + np.round(fast_s * NS_PER_S).astype(np.int64)
    sky, stated_sky = SiderealTruth(truth.site, TABLE), SiderealTruth(site, TABLE)
    turns = late[:, None] * np.array(truth.slip_arcsec) + time_s[:, None] / 3600 * np.array(truth.moves_arcsec_per_h)
    phase = 2 * math.pi * time_s / truth.wave_period_s + rng.uniform(0, 2 * math.pi)
    turns[:, :2] += np.sin(phase)[:, None] * np.array(truth.wave_arcsec)
    turns[:, :2] += rng.normal(0, truth.vibration_arcsec + 1e-12, (FRAMES, 2))
    turns[:, :2] += correlated(rng, time_s, *wander)
    axes = horizon_to_sensor(truth.mount)
    pointing = axes @ sky.icrs_to_horizon_at(true_ns)
    middle = pointing[FRAMES // 2]
    reach = math.cos(CAMERA.diagonal_rad / 2 + math.radians(16 * duration_s / 7200 / 2 + 1))
    near = STARS_ICRS[STARS_ICRS @ middle[2] > reach]
    exact = np.einsum("mij,nj->mni", pointing, near)
    exact = exact + np.cross(turns[:, None] * ARCSEC_RAD, exact)
    seen = Refraction.at(truth.site).added(exact.reshape(-1, 3), axes[:, 2])
    px = truth.camera.pixels(seen).reshape(FRAMES, len(near), 2)
    inside = CAMERA.contains(px.reshape(-1, 2)).reshape(FRAMES, len(near))
    inside &= np.cumsum(inside, axis=1) <= STARS
    frame, star = np.nonzero(inside)
    px = px[frame, star] + rng.normal(0, noise_px, (len(frame), 2))
    px = np.rint(px) if whole_pixels else px
    measured = Refraction.at(site).removed(CAMERA.directions(px), horizon_to_sensor(mount)[:, 2])
    expected = (horizon_to_sensor(mount) @ stated_sky.icrs_to_horizon_at(utc_ns))[frame]
    expected = np.einsum("nij,nj->ni", expected, near[star])
    operators = attitude_operators(measured, frame)
    total = np.zeros((FRAMES, 3))
    rest = measured - expected
    for _ in range(3):
        turn = np.zeros((FRAMES, 3))
        np.add.at(turn, frame, np.einsum("nij,nj->ni", operators, rest[:, :2]))
        total += turn
        angle = total[frame]
        size = np.linalg.norm(angle, axis=1, keepdims=True)
        turned = expected + np.sinc(size / math.pi) * np.cross(angle, expected)
        turned += 0.5 * np.sinc(size / 2 / math.pi) ** 2 * np.cross(angle, np.cross(angle, expected))
        rest = measured - turned
    frames = np.zeros(FRAMES, dtype=FRAME)
    frames["utc_ns"], frames["exposure_s"] = utc_ns, 0.1
    shifts = boresight_shifts(total) * ARCSEC_PER_RAD
    for name, column in zip(("cross_x", "cross_y", "d_roll"), shifts.T, strict=True):
        frames[f"{name}_arcsec"] = column
    matches = np.zeros(len(frame), dtype=MATCH)
    matches["named"] = True
    matches["frame"], matches["star"], matches["x_px"], matches["y_px"] = frame, star, px[:, 0], px[:, 1]
    matches["residual_x_arcsec"], matches["residual_y_arcsec"] = rest[:, :2].T * ARCSEC_PER_RAD
    return frames, matches


def correlated(rng, time_s, size, tau_s):
    """A first-order autoregressive course (M, 2)."""
    share = math.exp(-float(time_s[1]) / tau_s)
    steps = rng.normal(0, size * math.sqrt(1 - share**2) + 1e-12, (len(time_s), 2))
    course = np.empty_like(steps)
    course[0] = rng.normal(0, size + 1e-12, 2)
    for row in range(1, len(steps)):
        course[row] = share * course[row - 1] + steps[row]
    return course


def model_of(frames, matches, site, mount):
    """The session as the causes compete for it."""
    used = np.ones(len(frames), dtype=bool)
    series = error_series(frames, used)
    zenith = horizon_to_sensor(mount)[:, 2]
    field = field_of_errors(matches, frames["utc_ns"], used, CAMERA, site, zenith)
    return SessionModel.from_series(series, field, site, mount, is_fitted=False)


def findings_of(truth, site, mount, duration_s, rng, **noise):
    model = model_of(*made(truth, site, mount, duration_s, rng, **noise), site, mount)
    return fine_findings(model, model.series, Setting(CAMERA, site, mount, START_NS, 0.1, FRAMES / duration_s))
