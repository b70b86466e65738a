"""Diagnosis against injected causes: how often the right one is named, how often a wrong one, and on clean sessions.

Sessions are made of stars on a detector, without bytes and without an identifier: catalogue stars over a true site and
mount become pixels with noise, and the station's own steps (camera, refraction, attitude, truth) make error angles and
residuals of them, vectorised. Each cause is injected at a number of standard errors of its own estimate, which a clean
session of the same kind gives. Run: python benchmarks/diagnosis.py [--sessions 20] [--sigmas 6] [--clean 200]
"""

import argparse
import itertools
import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from gse.assessment.error_series import error_series
from gse.assessment.field_patterns import field_of_errors
from gse.assessment.fine_causes import SessionModel, fine_causes
from gse.assessment.fine_findings import Setting, fine_findings
from gse.camera import Camera
from gse.catalog import load_catalog
from gse.constants import ARCSEC_PER_RAD, ARCSEC_RAD
from gse.instant import NS_PER_S, from_text
from gse.mount import Mount
from gse.site import Site
from gse.star_influence import attitude_operators, boresight_shifts
from gse.station.frame_table import FRAME, MATCH
from gse.truth import EarthOrientation, Refraction, SiderealTruth, horizon_to_sensor

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
DURATIONS_S = (60.0, 600.0, 7200.0)
FRAMES = 1200
STARS = 20
STARS_ICRS = load_catalog().icrs[:6000]


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
    return SessionModel.of(series, field, site, mount, is_fitted=False)


def findings_of(truth, site, mount, duration_s, rng, **noise):
    model = model_of(*made(truth, site, mount, duration_s, rng, **noise), site, mount)
    return fine_findings(model, Setting(CAMERA, site, mount, START_NS, 0.1))


def turned(mount, arcsec):
    azimuth, altitude, roll = arcsec
    return Mount(
        azimuth_deg=mount.azimuth_deg + azimuth / 3600 / math.cos(math.radians(mount.altitude_deg)),
        altitude_deg=mount.altitude_deg + altitude / 3600,
        roll_deg=mount.roll_deg + roll / 3600,
    )


def _vector(rng, roll=8.0):
    direction = rng.normal(0, 1, 3) * (1, 1, roll)
    return 100 * direction / np.linalg.norm(direction / (1, 1, roll))


def _camera(**changes):
    return lambda truth, size: replace(truth, camera=replace(CAMERA, **{k: f(size) for k, f in changes.items()}))


def _site(name):
    return lambda truth, size: replace(truth, site=replace(truth.site, **{name: value(truth.site, name) + size}))


def value(site, name):
    return {"pressure_hpa": site.air_pressure_hpa, "temperature_c": site.air_temperature_c}.get(name) or getattr(
        site, name
    )


CAUSES = {
    # name: (words that a finding must have in its cause or equals, change of a truth by a size, a great size)
    "mount offset": (("mount",), lambda t, v: replace(t, mount=turned(t.mount, v)), _vector),
    "clock offset": (("clock offset",), lambda t, s: replace(t, clock_s=s), lambda rng: 20.0),
    "latency": (("latency",), lambda t, s: replace(t, clock_s=s), lambda rng: 2.0),
    "clock drift": (("clock drift",), lambda t, s: replace(t, clock_ppm=s), lambda rng: 3000.0),
    "clock step": (("clock step",), lambda t, s: replace(t, clock_step_s=s), lambda rng: 5.0),
    "slip of the mount": (("slip of the mount",), lambda t, v: replace(t, slip_arcsec=tuple(v)), _vector),
    "mount moves": (
        ("mount moves",),
        lambda t, v: replace(t, moves_arcsec_per_h=tuple(v)),
        lambda rng: _vector(rng) * 20,
    ),
    "thermal sinusoid": (
        ("thermal sinusoid",),
        lambda t, v: replace(t, wave_arcsec=(v[0], v[1])),
        lambda rng: rng.normal(0, 50, 2),
    ),
    "latitude": (("site", "latitude"), _site("latitude_deg"), lambda rng: 0.05),
    "longitude": (("longitude",), _site("longitude_deg"), lambda rng: 0.05),
    "pressure": (("refraction",), _site("pressure_hpa"), lambda rng: -400.0),
    "temperature": (("refraction",), _site("temperature_c"), lambda rng: -60.0),
    "focal length": (
        ("focal length",),
        _camera(focal_length_px=lambda size: CAMERA.focal_length_px * (1 + size)),
        lambda rng: 3e-3,
    ),
    "principal point": (
        ("principal point",),
        _camera(principal_point_px=lambda v: (511.5 + v[0], 511.5 + v[1])),
        lambda rng: rng.normal(0, 5, 2),
    ),
    "distortion": (("distortion",), _camera(radial_distortion=lambda size: (size, 0.0)), lambda rng: 4e-3),
    "vibration": (("vibration",), lambda t, s: replace(t, vibration_arcsec=s), lambda rng: 30.0),
}


def injected(name, site, mount, duration_s, rng, sigmas):
    """A truth with one cause at so many standard errors, as the finding of a great one has them, or None."""
    _, change, great = CAUSES[name]
    period_s = max(duration_s / rng.uniform(1.5, 12), 60.0)
    base = Truth(site, mount, at_s=duration_s * rng.uniform(0.2, 0.8), wave_period_s=period_s)
    size = great(rng)
    if name == "vibration":
        return change(base, 8.0)  # three times what the stars' own noise makes of a boresight
    seed = int(rng.integers(1 << 30))
    found = fine_causes(
        model_of(*made(change(base, size), site, mount, duration_s, np.random.default_rng(seed)), site, mount)
    )
    if not found:
        return None
    norm = math.sqrt(float(((found[0].coefficients / found[0].errors) ** 2).sum()))
    return change(base, np.multiply(size, sigmas / norm * rng.choice([-1, 1])))


def judged(name, findings):
    """right, wrong or silent, by the first finding."""
    if not findings:
        return "silent"
    said = (findings[0].cause, *findings[0].equals)
    return "right" if any(word in text for word in CAUSES[name][0] for text in said) else "wrong"


def cause_table(sessions, sigmas):
    rng = np.random.default_rng(7)
    total = Counter()
    print(f"| cause at {sigmas:g} standard errors | sessions | named first | wrong | silent |\n|---|---|---|---|---|")
    for name in CAUSES:
        counts, wrong = Counter(), Counter()
        for (site, mount), duration_s, _ in itertools.product(SETTINGS, DURATIONS_S, range(sessions)):
            truth = injected(name, site, mount, duration_s, rng, sigmas)
            found = findings_of(truth, site, mount, duration_s, rng) if truth else ()
            counts[judged(name, found)] += 1
            if judged(name, found) == "wrong":
                wrong[f"{found[0].cause} at {duration_s:g} s"] += 1
        total += counts
        _row(name, counts)
        if wrong:
            print(f"  <!-- {dict(wrong)} -->")
    _row("all", total)


def _row(name, counts):
    of = counts.total()
    print(
        f"| {name} | {of} | "
        + " | ".join(f"{100 * counts[key] / of:.1f} %" for key in ("right", "wrong", "silent"))
        + " |"
    )


NOISES = {
    "white, 0.25 px per star": {},
    "and 3 arcsec of the boresight over 3 s": {"wander": (3.0, 3.0)},
    "and 3 arcsec of the boresight over 30 s": {"wander": (3.0, 30.0)},
    "and 3 arcsec of the boresight over 300 s": {"wander": (3.0, 300.0)},
    "whole pixels": {"whole_pixels": True},
}


def clean_table(sessions):
    rng = np.random.default_rng(11)
    print("\n| clean sessions | sessions | with a finding |\n|---|---|---|")
    for title, noise in NOISES.items():
        settings = itertools.islice(itertools.cycle(itertools.product(SETTINGS, DURATIONS_S)), sessions)
        found = [findings_of(Truth(*at), *at, duration_s, rng, **noise) for at, duration_s in settings]
        causes = dict(Counter(one[0].cause for one in found if one))
        print(f"| {title} | {sessions} | {sum(bool(one) for one in found)} {causes or ''} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sessions", type=int, default=5, help="of each cause, site and duration")
    parser.add_argument("--sigmas", type=float, default=6.0)
    parser.add_argument("--clean", type=int, default=200)
    options = parser.parse_args()
    cause_table(options.sessions, options.sigmas)
    clean_table(options.clean)
