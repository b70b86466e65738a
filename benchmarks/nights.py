"""Natural nights, from dusk to dawn: how many of a good sensor pass, and how many of a bad one do not.

Each night is a simulated sensor with own answers, at one of three latitudes and four seasons, with what nights have:
banks of cloud, an overcast hour, dew, caps, restarts, hot pixels, satellites, a mount that sinks, swings and slips. Its
figures lie up to half of their limits. Two twins have the same night: one sensor whose own answers have 1.3 limits of
error on one axis, and one that leaves 8 % of them out.

    python benchmarks/nights.py --nights 10 --rate-hz 1 [--first 0] [--hours 6] [--twins]
"""

import argparse
import contextlib
import io
import json
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gse.cli import main
from gse.truth.solar_system import sun_altitude_deg
from gse.values.instant import NS_PER_S, from_text, to_text
from gse.values.site import Site

SITES = ((-6.53, 106.7, 250.0), (48.2, 11.6, 500.0), (-33.3, -70.2, 2400.0))
DATES = ("2026-03-20", "2026-06-21", "2026-09-22", "2026-12-21")
DUSK_DEG = -6.0
_CAUSES = {
    "slips": ("slip", "mount", "drift"),
    "drift": ("drift", "mount", "clock"),
    "swing": ("thermal", "swing", "mount", "drift"),
    "dew": ("dew", "transparency", "focus"),
    "hot": ("hot pixel",),
}
"""Words of findings that a night with such a feature may have."""


@dataclass(frozen=True)
class Night:
    """One night: its scenario and station, and the features that it has."""

    number: int
    scenario: dict[str, Any]
    features: tuple[str, ...]


def night(number: int, rate_hz: float, hours: float) -> Night:
    """The night of a number, always the same."""
    random = np.random.default_rng((40, number))
    latitude, longitude, height = SITES[number % 3]
    site = Site(latitude_deg=latitude, longitude_deg=longitude, height_m=height)
    start_ns, end_ns = _dark_hours(site, DATES[(number // 3) % 4])
    seconds = min((end_ns - start_ns) / NS_PER_S, 3600 * hours)
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
        air["capped_s"] = [[at, at + float(random.uniform(30, 300))] for at in random.uniform(0.1, 0.8, 2) * seconds]
    if has["satellites"]:
        air["satellites_per_minute"] = float(random.uniform(0.1, 1))
    motion: dict[str, Any] = {}
    if has["drift"]:
        motion["drift_arcsec_per_h"] = [float(random.uniform(-5, 5)), float(random.uniform(-5, 5)), 0.0]
    if has["swing"]:
        motion |= {"sinusoid_arcsec": [float(x) for x in random.uniform(0, 10, 2)], "sinusoid_period_s": 2400.0}
    if has["slips"]:
        motion["slips"] = [
            [float(random.uniform(0.2, 0.8)) * seconds, *(float(x) for x in random.uniform(-7, 7, 2)), 0.0]
        ]
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
            "optics": {"position_noise_arcsec": float(random.uniform(5, 25))},
            "detector": {"hot_pixels": int(has["hot"]) * 6, "missing": float(random.uniform(0, 0.03))},
            "air": air,
            "motion": motion,
            "firmware": {"resets_s": [0.4 * seconds] if has["resets"] else []},
            "attitude": {"sends": True, "noise_arcsec": float(random.uniform(2, 12)), "roll_noise_arcsec": 40.0},
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


TWINS: dict[str, dict[str, Any]] = {
    "good": {},
    "1.3 limits": {"attitude": {"bias_arcsec": [0.0, 78.0, 0.0]}},
    "8 % missing": {"attitude": {"lost": 0.08}},
}


def report_of(scenario: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The report of a session of a scenario."""
    path = folder / "night.yaml"
    path.write_text(yaml.safe_dump(scenario))
    command = ["run", "--port", f"sim://?scenario={path}", "--no-plots", "--out", str(folder / "out"), "--json"]
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(io.StringIO()), contextlib.suppress(SystemExit):
        main(command)
    found: dict[str, Any] = json.loads(told.getvalue())
    return found


def unexplained(report: dict[str, Any], features: tuple[str, ...]) -> list[str]:
    """Causes that are named and not there."""
    allowed = [word for name in features for word in _CAUSES.get(name, ())]
    causes = [item["cause"] for item in report["diagnosis"]]
    return [cause for cause in causes if not any(word in cause for word in allowed)]


def run(numbers: range, rate_hz: float, hours: float, twins: bool) -> None:
    """Run nights and print a line each, and the table."""
    words: Counter[tuple[str, str]] = Counter()
    extra = 0
    for number in numbers:
        made = night(number, rate_hz, hours)
        for name, change in TWINS.items():
            if name != "good" and not twins:
                continue
            scenario = dict(made.scenario)
            scenario["attitude"] = scenario["attitude"] | change.get("attitude", {})
            with tempfile.TemporaryDirectory() as folder:
                began_s = time.process_time()
                report = report_of(scenario, Path(folder))
            words[name, report["word"]] += 1
            causes = unexplained(report, made.features) if name == "good" else []
            reasons = report["reasons"][:2] if report["word"] != "PASS" else []
            extra += bool(causes)
            print(
                f"{number:3d} {name:12s} {report['word']:14s} {time.process_time() - began_s:5.1f} s  "
                f"{' '.join(made.features)}  {causes or ''} {reasons or ''}",
                flush=True,
            )
    print()
    for (name, word), count in sorted(words.items()):
        print(f"{name:12s} {word:24s} {count}")
    print(f"nights with a cause that is not there: {extra}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nights", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rate-hz", type=float, default=1.0)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--twins", action="store_true")
    asked = parser.parse_args()
    sys.exit(run(range(asked.first, asked.first + asked.nights), asked.rate_hz, asked.hours, asked.twins))
