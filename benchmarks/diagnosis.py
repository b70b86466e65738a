"""Diagnosis against injected causes: how often the right one is named, how often a wrong one, and on clean sessions.

Sessions are made of stars on a detector, without bytes and without an identifier (tests/skies/star_errors.py). Each
cause is injected at a number of standard errors of its own estimate, which the finding of a great one gives.
Run: python benchmarks/diagnosis.py [--sessions 20] [--sigmas 6] [--clean 200]
"""

import argparse
import itertools
import math
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from gse.assessment.fine_causes import fine_causes
from gse.mount import Mount

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from skies.star_errors import CAMERA, SETTINGS, Truth, findings_of, made, model_of

DURATIONS_S = (60.0, 600.0, 7200.0)


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
