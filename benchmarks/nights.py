"""Natural nights, from dusk to dawn: how many of a good sensor pass, and how many of a bad one do not.

Each night is a simulated sensor with own answers, at one of three latitudes and four seasons, 6 to 10 h long where it
is dark that long, with what nights have: banks of cloud, an overcast hour, dew, caps, restarts, hot pixels, satellites,
a mount that sinks, swings and slips. 95 % of its errors lie within half of the limit. Two twins are the same session
with other answers of the sensor: 1.3 limits off along rows, or 8 % of them left out.

    python benchmarks/nights.py --nights 10 [--first 0] [--rate-hz 0.25]
"""

import argparse
import contextlib
import io
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gse.cli import main
from gse.sessions.replay import replay_session
from gse.station.session_data import SessionData
from gse.station.session_tables import ANGLES, QUATERNION
from gse.truth.solar_system import sun_altitude_deg
from gse.values.attitude_convention import from_angles, state_angles, to_quaternions
from gse.values.constants import ARCSEC_RAD
from gse.values.instant import NS_PER_S, from_text, to_text
from gse.values.matrices import product
from gse.values.site import Site
from gse.verdict.assessment import Assessment, judge

SITES = ((-6.53, 106.7, 250.0), (48.2, 11.6, 500.0), (-33.3, -70.2, 2400.0))
DATES = ("2026-03-20", "2026-06-21", "2026-09-22", "2026-12-21")
DUSK_DEG = -6.0
HALF_ARCSEC = 30.0
"""Half of the limit of dRA* and dDE, for 95 % of the errors."""
OFF_ARCSEC, MISSING = 78.0, 0.08
_CAUSES = {
    "slips": ("slip of the mount",),
    "drift": ("mount moves",),
    "swing": ("thermal sinusoid",),
    "dew": ("brightness scale",),
    "hot": ("hot pixels",),
}
"""What findings may name in a night with such a feature."""
_ALWAYS = {"sensor noise"}
"""The sensor's own answers are made noisier than its panoramas."""


@dataclass(frozen=True)
class Night:
    """One night: its scenario and station, and the features that it has."""

    number: int
    scenario: dict[str, Any]
    features: tuple[str, ...]


def night(number: int, rate_hz: float) -> Night:
    """The night of a number, always the same."""
    random = np.random.default_rng((40, number))
    latitude, longitude, height = SITES[number % 3]
    site = Site(latitude_deg=latitude, longitude_deg=longitude, height_m=height)
    start_ns, end_ns = _dark_hours(site, DATES[(number // 3) % 4])
    seconds = min((end_ns - start_ns) / NS_PER_S, 3600 * random.uniform(6, 10))
    if random.random() < 0.5:  # a session that ends with the dawn
        start_ns = end_ns - round(seconds * NS_PER_S)
    has = {name: random.random() < share for name, share in _SHARES.items()}
    air: dict[str, Any] = {"cloud_cover": float(random.uniform(0.6, 1.0)), "cloud_magnitudes": [[0, 0]]}
    if has["banks"]:
        for at in np.sort(random.uniform(0.05, 0.9, int(random.integers(1, 4)))).tolist():
            _cloud(air, at * seconds, float(random.uniform(300, 1200)), float(random.uniform(2, 4)))
    elif has["overcast"]:
        _cloud(air, float(random.uniform(0.2, 0.6)) * seconds, 3600.0, 6.0)
    if has["dew"]:
        air["dew_magnitudes"] = [[0, 0], [0.8 * seconds, 0], [seconds, float(random.uniform(0.5, 2.5))]]
    if has["caps"]:
        air["capped_s"] = [
            [at, at + float(random.uniform(30, 300))] for at in (random.uniform(0.1, 0.8, 2) * seconds).tolist()
        ]
    if has["satellites"]:
        air["satellites_per_minute"] = float(random.uniform(0.1, 1))
    noise_arcsec = float(random.uniform(2, 12))
    motion = _motion(random, has, seconds, (HALF_ARCSEC**2 - (2 * noise_arcsec) ** 2) ** 0.5)
    return Night(
        number,
        {
            "text": f"natural night {number}",
            "start": to_text(start_ns, 0),
            "seconds": float(seconds),
            "rate_hz": rate_hz,
            "station": {
                "site": {"latitude_deg": latitude, "longitude_deg": longitude, "height_m": height},
                "mount": {"azimuth_deg": float(random.uniform(0, 360)), "altitude_deg": float(random.uniform(50, 90))},
                "protocol": "panorama-v1-subpixel",
            },
            "optics": {"position_noise_arcsec": float(random.uniform(5, 15))},
            "detector": {"hot_pixels": int(has["hot"]) * 6, "missing": float(random.uniform(0, 0.03))},
            "air": air,
            "motion": motion,
            "firmware": {"resets_s": [0.4 * seconds] if has["resets"] else []},
            "attitude": {"sends": True, "noise_arcsec": noise_arcsec, "roll_noise_arcsec": 40.0},
        },
        tuple(name for name, is_there in has.items() if is_there),
    )


_SHARES = {
    "banks": 0.4, "overcast": 0.15, "dew": 0.15, "caps": 0.2, "satellites": 0.3, "drift": 0.25, "swing": 0.2,
    "slips": 0.2, "hot": 0.3, "resets": 0.2,
}  # fmt: skip


def _dark_hours(site: Site, date: str) -> tuple[int, int]:
    """From the dusk of a date, by the Sun, to the dawn after it."""
    noon_ns = from_text(f"{date}T12:00:00Z") - round(site.longitude_deg / 15 * 3600) * NS_PER_S
    minutes = noon_ns + np.arange(24 * 60) * 60 * NS_PER_S
    down = [minute for minute in minutes.tolist() if sun_altitude_deg(site, minute) < DUSK_DEG]
    return down[0], down[-1]


def _cloud(air: dict[str, Any], at_s: float, long_s: float, deep_mag: float) -> None:
    edge_s = long_s / 4
    last_s = air["cloud_magnitudes"][-1][0]
    if at_s > last_s:
        points = [[at_s, 0], [at_s + edge_s, deep_mag], [at_s + long_s - edge_s, deep_mag], [at_s + long_s, 0]]
        air["cloud_magnitudes"] += [[float(second), float(mag)] for second, mag in points]


def _motion(random: np.random.Generator, has: dict[str, bool], seconds: float, most_arcsec: float) -> dict[str, Any]:
    """What the mount does; smaller where it would move by more than ``most_arcsec`` along one axis."""
    drift, swing, slip = (random.uniform(-most, most, 2) for most in (5.0, 10.0, 10.0))
    drift, swing, slip = drift * has["drift"], abs(swing) * has["swing"], slip / 2**0.5 * has["slips"]
    moved = float((abs(drift) * seconds / 3600 + swing + abs(slip)).max())
    scale = min(most_arcsec / moved, 1.0) if moved else 1.0
    at_s = float(random.uniform(0.2, 0.8)) * seconds
    return {
        "drift_arcsec_per_h": [*(scale * drift).tolist(), 0.0],
        "sinusoid_arcsec": (scale * swing).tolist(),
        "sinusoid_period_s": 2400.0,
        "slips": [[at_s, *(scale * slip).tolist(), 0.0]] if has["slips"] else [],
    }


def session_of(scenario: dict[str, Any], folder: Path) -> SessionData:
    """The session of a scenario; a replay gives what ``gse run`` gives, but for the times of this host."""
    path = folder / "night.yaml"
    path.write_text(yaml.safe_dump(scenario))
    hushed = contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO())
    with hushed[0], hushed[1], contextlib.suppress(SystemExit):
        main(["simulate", "--scenario", str(path), "--out", str(folder)])
    return replay_session(next(folder.glob("*/session.mcap"))).session


def turned(session: SessionData, random: np.random.Generator) -> None:
    """All own answers 1.3 limits off along rows."""
    rows = session.sensor_attitudes.columns
    off = np.array([[1.0, 0, 0], [0, 1, OFF_ARCSEC * ARCSEC_RAD], [0, -OFF_ARCSEC * ARCSEC_RAD, 1]])
    turned = np.asarray(product(off, from_angles(*(rows[name] for name in ANGLES))))
    for name, values in zip(ANGLES, state_angles(turned, session.station.sensor.attitude).T, strict=True):
        rows[name] = values
    for name, values in zip(QUATERNION, to_quaternions(turned).T, strict=True):
        rows[name] = values


def left_out(session: SessionData, random: np.random.Generator) -> None:
    """8 % of the own answers are none."""
    rows = session.sensor_attitudes.columns
    rows["acquired"] &= random.random(len(rows)) >= MISSING


TWINS: dict[str, Callable[[SessionData, np.random.Generator], None]] = {
    "1.3 limits": turned,
    "8 % missing": left_out,
}


def unexplained(assessment: Assessment, features: tuple[str, ...]) -> list[str]:
    """Causes that are named and not there."""
    allowed = {cause for name in features for cause in _CAUSES.get(name, ())} | _ALWAYS
    return [str(one) for one in assessment.findings if one.cause not in allowed]


def run(numbers: range, rate_hz: float) -> None:
    """Run nights and print a line each, and the table."""
    words: Counter[tuple[str, str]] = Counter()
    extra = 0
    for number in numbers:
        made = night(number, rate_hz)
        with tempfile.TemporaryDirectory() as folder:
            began_s = time.process_time()
            session = session_of(made.scenario, Path(folder))
            extra += told(words, made, "good", judge(session))
            own = session.sensor_attitudes.columns.copy()
            for name, change in TWINS.items():
                session.sensor_attitudes.columns[:] = own
                change(session, np.random.default_rng((41, number)))
                told(words, made, name, judge(session))
        print(f"    {time.process_time() - began_s:.0f} s of CPU", flush=True)
    print()
    for (name, word), count in sorted(words.items()):
        print(f"{name:12s} {word:24s} {count}")
    print(f"nights with a cause that is not there: {extra}")


def told(words: Counter[tuple[str, str]], made: Night, name: str, assessment: Assessment) -> bool:
    """Count and print a night; whether it names a cause that is not there."""
    words[name, assessment.word] += 1
    causes = unexplained(assessment, made.features) if name == "good" else []
    reasons = (
        assessment.reasons[:2] if assessment.word != "PASS" and (name == "good" or assessment.word != "FAIL") else ()
    )
    print(
        f"{made.number:3d} {name:12s} {assessment.word:14s} {' '.join(made.features)}  {causes or ''} {reasons or ''}",
        flush=True,
    )
    return bool(causes)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nights", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rate-hz", type=float, default=0.25)
    asked = parser.parse_args()
    run(range(asked.first, asked.first + asked.nights), asked.rate_hz)
